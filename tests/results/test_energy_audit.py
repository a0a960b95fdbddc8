"""The error of the energy balance."""

import dataclasses

import numpy as np
import pytest
from synthetic_results import branch, two_flanks

from microslip.points.branch import Branch
from microslip.results.audit import audit_text, closure, energy_closure


def test_closure_is_the_imbalance_relative_to_the_input():
    assert closure(np.array([2.0]), np.array([1.5]), np.array([0.3])) == pytest.approx([0.1])


def test_zero_energy_is_balanced():
    assert closure(np.zeros(2), np.zeros(2), np.zeros(2)).tolist() == [0.0, 0.0]


def test_rounding_without_loss_is_no_input():
    # undamped and stuck: the work of the load is rounding, of the size of 1e-16 F a
    assert closure(np.array([1e-17]), np.zeros(1), np.zeros(1), np.array([1.0]))[0] < 1e-6


def test_closure_of_a_branch_detects_an_unbalanced_point():
    curve = branch(5.0, two_flanks(), n_points=9)
    assert energy_closure(curve).max() < 2e-9
    curve.points[4] = dataclasses.replace(curve.points[4], input=1.01 * curve.points[4].input)
    assert np.argmax(energy_closure(curve)) == 4
    assert energy_closure(curve)[4] == pytest.approx(0.01 / 1.01, rel=1e-5)
    assert "1 of 9 points close worse than 1e-06" in audit_text([curve])


def test_text_names_levels_without_a_point():
    assert "no point" in audit_text([Branch(3.0)])
    assert energy_closure(Branch(3.0)).shape == (0,)
