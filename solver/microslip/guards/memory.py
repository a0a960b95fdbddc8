"""Memory available to the ranks of a run by machine, control group and limit, and checks before allocations.

A limit is shared by all ranks of a machine or of a control group, or belongs to one rank.  The memory of a stage is compared with
every limit before its allocation: a process beyond a limit is killed without a message.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

from ..messages.errors import ResourceError
from ..messages.words import counted
from ..system.memory import Limit, gigabytes, give_back, limits_here, resident_memory


@dataclass(frozen=True)
class Shortage:
    """Needed and available memory of a limit that does not suffice."""

    limit: str
    n_ranks: int  # number of ranks that share it
    needed: float  # bytes, all these ranks
    available: float  # bytes

    def __str__(self) -> str:
        who = "one rank needs" if self.n_ranks == 1 else f"its {counted(self.n_ranks, 'rank')} need"
        return f"{who} {gigabytes(self.needed)} more, but only {gigabytes(self.available)} of {self.limit} are left"


def memory_left(comm: MPI.Comm) -> float:
    """Return the memory available to all ranks of ``comm`` [bytes]; infinite if unknown.

    Collective: shared memory is divided evenly, and the rank with the least memory determines the result.
    """
    of_ranks = limits_of_ranks(comm)
    sharing = Counter(limit.shared_by for limits in of_ranks for limit in limits)
    shares = [limit.available / sharing[limit.shared_by] for limits in of_ranks for limit in limits]
    return comm.size * min(shares, default=float("inf"))


def refuse_beyond(comm: MPI.Comm, needed: float, what: str, advice: str) -> None:
    """Raise ResourceError if the ranks need more memory than is available, before its allocation.

    Collective on ``comm``: two gathers.

    Parameters
    ----------
    needed : bytes that this rank will allocate
    what, advice : parts of the message: the purpose, and what to do

    Raises
    ------
    ResourceError : on every rank
    """
    lacking = shortage(comm, needed)
    if lacking is not None:
        raise ResourceError(f"{what}: not enough memory: {lacking}; {advice}")


def shortage(comm: MPI.Comm, needed: float) -> Shortage | None:
    """Return the limit exceeded most by ``needed`` further bytes on each rank; None if the memory suffices.

    Collective on ``comm``; the same on every rank.
    """
    return worst(limits_of_ranks(comm), comm.allgather(float(needed)))


def worst(of_ranks: Sequence[Sequence[Limit]], needed: Sequence[float]) -> Shortage | None:
    """Return the limit that is exceeded most, from the limits and the need [bytes] of each rank.  Local."""
    sums: dict[str, float] = {}
    for limits, more in zip(of_ranks, needed):
        for limit in limits:
            sums[limit.shared_by] = sums.get(limit.shared_by, 0.0) + more
    sharing = Counter(limit.shared_by for limits in of_ranks for limit in limits)
    exceeded = [limit for limits in of_ranks for limit in limits if sums[limit.shared_by] > limit.available]
    if not exceeded:
        return None
    first = min(exceeded, key=lambda limit: (limit.available - sums[limit.shared_by], limit.shared_by))
    return Shortage(first.name, sharing[first.shared_by], sums[first.shared_by], max(first.available, 0.0))


def limits_of_ranks(comm: MPI.Comm) -> list[list[Limit]]:
    """Return the limits of each rank, on every rank.  Collective: each rank queries its machine once."""
    give_back()
    of_machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
    machine, resident = of_machine.allreduce(comm.rank, op=MPI.MIN), of_machine.allreduce(resident_memory())
    of_machine.Free()
    limits = limits_here(f"machine {machine}", f"rank {comm.rank}", resident)
    return comm.allgather(limits)
