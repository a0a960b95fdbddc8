"""Joints whose pairs all come near gross slip: the branch has corners, and is followed round them."""

import pytest
from mpi4py import MPI
from verification import chain, ranks, wide_slip


@pytest.mark.parametrize("level", [5.0, 6.0])
def test_branch_is_followed_round_its_corners(level, tmp_path):
    case = ranks.two_elements()
    case.keys["levels"] = [level]
    done = chain.solve(ranks.write_case(tmp_path, case), MPI.COMM_SELF)     # an early end is an error there
    steps = [b.omega - a.omega for a, b in zip(done.branches[0].points, done.branches[0].points[1:])]
    assert len(steps) > 15 and min(steps) > 0.0
    assert done.worst_closure < 1e-6


def test_the_demo_in_gross_slip_with_its_mean_held():
    done = wide_slip.demo([200.0], MPI.COMM_SELF)
    points = done.branches[0].points
    assert any(point.notes for point in points)                             # somewhere no pair sticks
    assert done.worst_closure < 1e-6
    assert max(int((point.state == 2).sum()) for point in points) > 20      # and half of them lift off
