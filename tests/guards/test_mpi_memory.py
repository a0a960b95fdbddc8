"""A lack of memory on any rank is an error on all ranks."""

import pytest
from mpi4py import MPI

from microslip.guards import memory
from microslip.guards.memory import memory_left, refuse_beyond
from microslip.messages.errors import ResourceError
from microslip.system.memory import Limit

COMM = MPI.COMM_WORLD


def has(monkeypatch, left, shared=True):
    def limits(machine, process, resident):
        assert resident > 1e7 * COMM.size
        return [Limit("the test", machine if shared else process, left)]

    monkeypatch.setattr(memory, "limits_here", limits)


@pytest.mark.parametrize("rank", range(COMM.size))
def test_one_rank_that_needs_too_much_memory_ends_all(monkeypatch, rank):
    has(monkeypatch, 1e9, shared=False)
    with pytest.raises(
        ResourceError,
        match="^the modes: not enough memory: one rank needs 2 GB more, but only 1 GB of the test are left; state fewer$",
    ):
        refuse_beyond(COMM, 2e9 if COMM.rank == rank else 0.0, "the modes", "state fewer")
    refuse_beyond(COMM, 0.9e9, "the modes", "state fewer")


def test_ranks_of_a_machine_share_its_memory(monkeypatch):
    has(monkeypatch, 1e9)
    assert memory_left(COMM) == pytest.approx(1e9)
    refuse_beyond(COMM, 0.99e9 / COMM.size, "the modes", "")
    with pytest.raises(
        ResourceError, match="needs? 1.2 GB more" if COMM.size == 1 else f"its {COMM.size} ranks need 1.2 GB more"
    ):
        refuse_beyond(COMM, 1.2e9 / COMM.size, "the modes", "")


def test_memory_of_this_machine_is_plausible():
    assert 1e7 < memory_left(COMM) < 1e16
