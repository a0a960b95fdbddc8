"""Joints whose pairs all approach gross slip: the branch has corners, and is followed round them."""

import numpy as np
import pytest
from mpi4py import MPI
from verification import chain, ranks, wide_slip

from microslip.contact.law import OPEN, STICK
from microslip.continuation.point_record import HELD


@pytest.mark.parametrize("level", [5.0, pytest.param(6.0, marks=pytest.mark.study)])
def test_a_branch_is_followed_round_its_corners(level, tmp_path):
    case = ranks.two_elements()
    case.response["levels"] = [level]
    done = chain.solve(ranks.write_case(tmp_path, case), MPI.COMM_SELF)  # an early end of the branch raises an error
    steps = [b.omega - a.omega for a, b in zip(done.branches[0].points, done.branches[0].points[1:])]
    assert len(steps) > 10 and min(steps) > 0.0
    assert done.worst_closure < 1e-6


@pytest.mark.study
def test_the_mean_slip_of_the_demo_is_held_where_nearly_all_pairs_slip():
    """At 200 N; other levels: verification/wide_slip.py."""
    done = wide_slip.demo([40.0], MPI.COMM_SELF)
    points = done.branches[0].points
    sliding = np.array([(point.state != STICK).mean() for point in points])
    is_held = np.array([HELD in point.notes for point in points])
    assert is_held.any() and sliding[is_held].min() > 0.7  # points held by springs
    assert not is_held[sliding < 0.5].any()
    assert done.worst_closure < 2e-6
    assert max(int((point.state == OPEN).sum()) for point in points) >= 14
