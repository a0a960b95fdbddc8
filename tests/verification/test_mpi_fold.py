"""Folded resonances: both turning points, and the same branch in both directions.  Every test runs on any number of ranks."""

import numpy as np
import pytest
from mpi4py import MPI
from verification import fold

from microslip.continuation import stepping
from microslip.continuation.ways_out import across_the_corner

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("name", ["softening", pytest.param("hardening", marks=pytest.mark.ranks(1))])
def test_both_directions_pass_two_turning_points_on_the_same_branch(name, shared_path):
    case = fold.FOLDS[name]
    up, down = (fold.followed(case, way, shared_path, COMM) for way in ("up", "down"))
    first, last = case.band
    assert [up.points[0].omega, up.points[-1].omega] == pytest.approx([first, last])
    assert [down.points[0].omega, down.points[-1].omega] == pytest.approx([last, first])
    turns = [[branch.points[i].omega for i in fold.turning_points(branch)] for branch in (up, down)]
    assert len(turns[0]) == len(turns[1]) == 2
    assert turns[1][::-1] == pytest.approx(turns[0], rel=2e-3)  # the points nearest the folds, one step apart
    solutions = [len(each) for each in fold.at_requested(case, up)]
    assert set(solutions) == {1, 3} and solutions.count(3) >= 2
    assert fold.difference(case, up, down) < 1e-8
    assert max(fold.amplitudes(up)) == pytest.approx(max(fold.amplitudes(down)), rel=2e-3)
    assert np.unique(np.concatenate([point.state for point in up.points])).tolist() == ([1, 2] if name == "softening" else [2])


@pytest.mark.parametrize("name", ["hardening", pytest.param("softening", marks=pytest.mark.ranks(1))])
def test_usual_steps_after_any_failure_stay_on_the_branch(name, shared_path, monkeypatch):
    """The steps used near a corner are tried after every failed step: the solutions are the same."""
    case, taken = fold.FOLDS[name], []

    def counted(stuck):
        for on in across_the_corner(stuck):
            taken.append(on)
            yield on

    up = fold.followed(case, "up", shared_path, COMM, points=15)
    monkeypatch.setattr(stepping, "SHORT", np.inf)
    monkeypatch.setattr(stepping, "across_the_corner", counted)
    second = fold.followed(case, "up", shared_path, COMM, points=15)
    assert taken and fold.difference(case, up, second) < 1e-8 and len(fold.turning_points(second)) == 2
