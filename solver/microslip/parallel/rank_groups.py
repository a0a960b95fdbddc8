"""Groups of ranks that work concurrently: the split, a counter that distributes the tasks, and reports to rank 0.

Rank 0 works in the first group like any other rank.  The root of a group is its lowest rank.  Its messages to rank 0 are
non-blocking; rank 0 receives them whenever it reports itself, and at the end until all groups have finished.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from mpi4py import MPI

from ..messages.errors import CaseError, Interrupted, MicroslipError
from ..system.watchdog import unwatched
from .agree import on_root
from .ownership import split_evenly

_REPORT, _END = 1, 2  # tags: from a root to rank 0, and back
_PAUSE = 0.002  # s between two probes for a message: other ranks may compute on this processor


def refuse_too_many(n_groups: int, n_ranks: int) -> None:
    """Raise an error if a group would have no rank.  Local.

    Raises
    ------
    CaseError : there are more groups than ranks
    """
    if n_groups > n_ranks:
        ranks = "is only 1 rank" if n_ranks == 1 else f"are only {n_ranks} ranks"
        raise CaseError(
            f"--groups {n_groups}: there {ranks}, and a group needs one at least; start {n_groups} or more: "
            f"mpirun -n {n_groups} before the command"
        )


@dataclass(frozen=True)
class Groups:
    """The ranks of ``world`` in groups of consecutive ranks, as equal in size as possible."""

    world: Any
    comm: Any  # of this rank's group
    number: int  # of this rank's group, from 0
    limits: np.ndarray  # (n + 1,) group g has the ranks limits[g]:limits[g + 1] of world

    @property
    def n(self) -> int:
        """The number of groups."""
        return len(self.limits) - 1

    @property
    def is_root(self) -> bool:
        """Whether this rank is the lowest of its group."""
        return self.comm.rank == 0

    @property
    def where(self) -> str:
        """The ranks of this group, for messages."""
        first, last = self.limits[self.number], self.limits[self.number + 1] - 1
        return f"rank {first}" if first == last else f"ranks {first} to {last}"


def split(world, n_groups: int) -> Groups:
    """Return the ranks of ``world`` in ``n_groups`` groups, at most as many as ranks.  Collective on ``world``."""
    limits = split_evenly(world.size, n_groups)
    number = int(np.searchsorted(limits, world.rank, side="right")) - 1
    return Groups(world, world.Split(number, world.rank), number, limits)


class Counter:
    """Returns 0, 1, 2, ..., each number once over all ranks, in the order of calls.  Collective on ``world``, as is ``free``.

    The counter is in the memory of rank 0; other ranks increment it by one-sided communication, without action of rank 0.
    """

    def __init__(self, world):
        self._window = MPI.Win.Allocate(8 if world.rank == 0 else 0, 8, comm=world)
        if world.rank == 0:
            self._window.Lock(0)
            self._window.tomemory()[:] = bytes(8)
            self._window.Unlock(0)
        world.Barrier()

    def next(self) -> int:
        """Return the next number.  Local."""
        increment, number = np.ones(1, dtype=np.int64), np.empty(1, dtype=np.int64)
        self._window.Lock(0)
        self._window.Fetch_and_op(increment, number, 0, 0, MPI.SUM)
        self._window.Unlock(0)
        return int(number[0])

    def free(self) -> None:
        """Release the memory of rank 0."""
        self._window.Free()


def dealt(groups: Groups, counter: Counter, n_tasks: int) -> Iterator[int]:
    """Yield the tasks of this rank's group out of 0 to ``n_tasks`` - 1: a new task whenever it has finished one.

    Collective on ``groups.comm``.
    """
    while (task := groups.comm.bcast(counter.next() if groups.is_root else None)) < n_tasks:
        yield task


class Reports:
    """Messages of the groups to rank 0 of the world while all of them work.  Collective on ``groups.world``, as is ``free``.

    All other methods are local, and act on the roots of the groups only.

    Parameters
    ----------
    on_message : called on rank 0 with the arguments of each ``notify``; messages of a group arrive in order
    """

    def __init__(self, groups: Groups, on_message: Callable[..., None]):
        self._world, self._on_message = groups.world.Dup(), on_message
        self._is_root = groups.is_root
        self._at_work = {int(rank) for rank in groups.limits[1:-1]}  # roots that may still send to rank 0
        self._other_ranks = sorted(self._at_work)
        self._sent: list[MPI.Request] = []

    def notify(self, *news: Any) -> None:
        """Send a message to rank 0; on rank 0, also receive the messages of the other groups.

        Raises
        ------
        MicroslipError : the error that ended another group
        """
        if self._world.rank == 0:
            self._on_message(*news)
            self.listen()
        else:
            self._go_on()
            self._send(0, _REPORT, news)

    def listen(self) -> None:
        """Receive all messages that have arrived.  On rank 0.

        Raises
        ------
        MicroslipError : the error that ended another group
        """
        status = MPI.Status()
        while self._world.iprobe(tag=_REPORT, status=status):
            news = self._world.recv(source=status.source, tag=_REPORT)
            if isinstance(news, MicroslipError):
                raise news
            if news is None:
                self._at_work.discard(status.source)
            else:
                self._on_message(*news)

    def finish(self) -> None:
        """Wait until rank 0 has received all messages of all groups.

        Raises
        ------
        MicroslipError : the error that ended another group
        """
        if self._world.rank > 0:
            self._send(0, _REPORT, None)
            while not self._go_on():
                time.sleep(_PAUSE)
            return
        while self._at_work:
            self.listen()
            time.sleep(_PAUSE)
        self._end_all(None)

    @contextmanager
    def shared_failure(self) -> Iterator[None]:
        """Let an error in one group end all groups: rank 0 forwards the error, and each group raises it at its next report.

        If rank 0 is interrupted, it first receives the messages that have arrived.
        """
        try:
            yield
        except MicroslipError as problem:
            if self._world.rank == 0:
                if isinstance(problem, Interrupted):
                    with suppress(MicroslipError):
                        self.listen()
                self._end_all(problem)
            elif self._is_root:
                self._send(0, _REPORT, problem)
            raise

    def free(self) -> None:
        """Release the communicator, after ``finish``."""
        MPI.Request.Waitall(self._sent)
        self._world.Free()

    def _go_on(self) -> bool:
        """Return whether rank 0 has ended the work; raise the error that it forwarded, if any."""
        if not self._world.iprobe(source=0, tag=_END):
            return False
        problem = self._world.recv(source=0, tag=_END)
        if problem is not None:
            raise problem
        return True

    def _end_all(self, problem: MicroslipError | None) -> None:
        for rank in self._other_ranks:
            self._send(rank, _END, problem)

    def _send(self, rank: int, tag: int, what: Any) -> None:
        """Send without blocking; a request stores its message until it is sent."""
        self._sent = [request for request in self._sent if not request.Test()]
        self._sent.append(self._world.isend(what, rank, tag))


Task = Callable[[Callable[..., None]], Any]  # collective on a group; gets a function that sends a message to rank 0


def nothing(*news: Any) -> None:
    """Take no notice of a message."""


def results_of(groups: Groups, tasks: Sequence[Task], on_message: Callable[..., None] = nothing) -> list[Any]:
    """Return on rank 0 the results of tasks, in their order; each group takes the next task whenever it is free.

    Collective on ``groups.world``; the list is empty on other ranks.  The result of a task is that of the group's root;
    ``on_message`` is called on rank 0 with the messages of the tasks.

    Raises
    ------
    MicroslipError : the error that ended a group, on the ranks of all groups
    """
    results: dict[int, Any] = {}

    def receive(kind: str, *news: Any) -> None:
        results.update([news]) if kind == "result" else on_message(*news)

    counter, reports = Counter(groups.world), Reports(groups, receive)
    with reports.shared_failure():
        for number in dealt(groups, counter, len(tasks)):
            result = tasks[number](partial(on_root, groups.comm, reports.notify, "news"))
            on_root(groups.comm, reports.notify, "result", number, result)
        with unwatched():
            on_root(groups.comm, reports.finish)
    reports.free()
    counter.free()
    return [results[number] for number in sorted(results)]
