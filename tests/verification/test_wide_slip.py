"""Joints whose pairs all come near gross slip: the branch has corners, and is followed round them."""

import pytest
from mpi4py import MPI
from verification import chain, ranks


@pytest.mark.parametrize("level", [5.0, 6.0])
def test_branch_is_followed_round_its_corners(level, tmp_path):
    case = ranks.two_elements()
    case.keys["levels"] = [level]
    done = chain.solve(ranks.write_case(tmp_path, case), MPI.COMM_SELF)     # an early end is an error there
    steps = [b.omega - a.omega for a, b in zip(done.branches[0].points, done.branches[0].points[1:])]
    assert len(steps) > 20 and min(steps) > 0.0
    assert done.worst_closure < 1e-6
