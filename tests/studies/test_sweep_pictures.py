"""Pictures of sweeps: labels that fit, and the designs with percentiles."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from microslip.library.design import Scatter, grid, one_by_one, scattered
from microslip.results.layout import _numbers, log_scale
from microslip.studies.sweep.pictures import _edges, _in_lines, _is_log


@pytest.mark.parametrize(
    ("label", "lines"),
    [
        ("level [N]", ["level [N]"]),
        ("joints.slider.friction [× that of the scene]", ["joints.slider.friction", "[× that of the scene]"]),
        ("joints.slider.tangential_stiffness [GN/m³]", ["joints.slider.", "tangential_stiffness", "[GN/m³]"]),
    ],
)
def test_long_labels_are_broken_at_the_dot_and_the_unit(label, lines):
    assert _in_lines(label, 26).split("\n") == lines and _in_lines(label, 99) == label


def test_designed_samples_have_no_percentiles():
    values = {"level": np.array([1.0, 2.0])}
    assert not grid(values).is_random and not one_by_one(values, {"level": 1.5}).is_random
    assert scattered({"level": Scatter(1.0, 10.0, "normal")}, 4).is_random


@pytest.mark.parametrize(
    ("values", "is_log"),
    [
        (np.geomspace(0.1, 0.6, 5), True),
        (np.linspace(0.1, 0.6, 5), False),
        (np.linspace(0.1, 0.9, 5), True),
        (np.array([0.1, 0.6]), False),
        (np.geomspace(1.0, 1.1, 5), False),
        (np.linspace(0.0, 10.0, 5), False),
    ],
)
def test_wide_or_logarithmically_spaced_values_have_a_logarithmic_axis(values, is_log):
    assert _is_log(values) == is_log


def test_cells_of_logarithmically_spaced_values_have_equal_width():
    assert np.diff(np.log(_edges(np.geomspace(0.1, 0.6, 5)))) == pytest.approx(np.log(6.0) / 4.0)


@pytest.mark.parametrize("ends", [(0.1, 0.6), (0.19, 2.5), (0.35, 3.9), (1.1, 95.0), (3e-5, 2e-4)])
def test_a_logarithmic_axis_of_few_decades_has_several_labels(ends):
    axes = Figure().add_subplot()
    axes.set_xlim(*ends)
    log_scale(axes, "x")
    labels = [number for number in _numbers(axes.xaxis) if number]
    assert 2 <= len(labels) <= 5 and len(set(labels)) == len(labels)
    assert ends[0] < 0.01 or all(ends[0] <= float(number) <= ends[1] for number in labels)
