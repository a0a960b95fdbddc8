"""One rank compared with all ranks on whole scenes; tests/verification/ranks.py prints the numbers."""

from dataclasses import replace

import pytest
from mpi4py import MPI
from verification import ranks

COMM = MPI.COMM_WORLD


# with three ranks, one owns none of the 36 rows of "two hex8"
@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("name", ["two hex8", "lap joint of tet4"])
def test_results_of_all_ranks_agree_with_those_of_one(name, shared_path):
    case = ranks.CASES[name]
    if name == "two hex8":  # the rising flank at one level
        case = replace(case, response=case.response | {"levels": [3.0], "frequencies": [6700.0, 6880.0], "points": 6})
    if COMM.rank == 0:
        ranks.write_case(shared_path, case)
    COMM.barrier()
    computed = ranks.difference(shared_path / "case.toml", COMM)
    assert computed.frequencies < 1e-9
    assert computed.response < 1e-6
    assert computed.closure < 1e-6
    assert computed.states == [0, 1]  # some pairs slip: the comparison is not of a linear curve only
