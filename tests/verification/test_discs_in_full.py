"""A few discs of discs_in_full.py: each point of one sector solves the equations of the full ring."""

import pytest
from verification.discs_in_full import BOUNDS, extremes, judged

CASES = {case.name: case for case in extremes()}
FEW = ("two sectors, order 1 = N/2", "shrouds open at rest that never close")


@pytest.mark.parametrize("name", FEW)
def test_points_of_a_sector_solve_the_equations_of_the_full_ring(tmp_path, name):
    judgements = judged(CASES[name], tmp_path)
    assert not judgements.faults and judgements.n_points > 1


def test_the_check_detects_a_point_that_is_no_solution(tmp_path):
    """The ring is excited by another engine order."""
    judgements = judged(CASES[FEW[0]], tmp_path, h_of_ring=0)
    assert judgements.errors["motion"] > 1e3 * BOUNDS["motion"] and judgements.faults
