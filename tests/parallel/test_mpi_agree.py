"""Work shared by the ranks, and errors raised by all of them."""

import pytest
from mpi4py import MPI

from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_each

COMM = MPI.COMM_WORLD


def test_each_rank_gets_its_own_result():
    assert on_each(COMM, lambda rank: rank + 1, COMM.rank) == COMM.rank + 1


@pytest.mark.parametrize("rank", range(COMM.size))
def test_an_error_on_one_rank_is_raised_on_all(rank):
    def work():
        if COMM.rank == rank:
            raise CaseError(f"rank {rank} cannot")

    with pytest.raises(CaseError, match=f"rank {rank} cannot"):
        on_each(COMM, work)
