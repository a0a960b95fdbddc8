"""How much memory is left on the machines of a run."""

from __future__ import annotations

from mpi4py import MPI


def memory_left(comm: MPI.Comm) -> float:
    """Return the memory that the ranks of ``comm`` may still take together [bytes]; infinite where nothing tells.

    Collective: every machine shares what it has left among its ranks, and the rank with least counts for all.
    """
    here = comm.Split_type(MPI.COMM_TYPE_SHARED)
    share = _available() / here.size
    here.Free()
    return comm.size * comm.allreduce(share, op=MPI.MIN)


def _available() -> float:
    """Return what this machine has left [bytes].  Local."""
    try:
        with open("/proc/meminfo") as file:
            return next(1024.0 * float(line.split()[1]) for line in file if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError):
        return float("inf")
