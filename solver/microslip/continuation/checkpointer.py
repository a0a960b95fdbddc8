"""Checkpoints of a branch while it is followed; by default none are written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol, TypeVar

from ..points.bifurcation import Bifurcation
from ..points.branch import Branch, Point
from ..points.peak import Peak

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..points.sweep import Sweep
    from .point_solver import Workspace
    from .state import BranchState
    from .task import BranchTask

T = TypeVar("T", Peak, Bifurcation)
Restored = tuple["BranchState", list[Point]]
Narrower = tuple["Sweep", "BranchState", list[Point]]


class Checkpointer(Protocol):
    """Checkpoints of one segment of a branch.  All methods but ``flush`` are collective on the ranks that follow the branch.

    As in a branch, rank 0 alone has the motion of the points that these methods return.
    """

    def finished(self) -> Branch | None:
        """Return the branch if an earlier run followed it to its end."""

    def restored(self, task: BranchTask, workspace: Workspace) -> Restored | None:
        """Return the last state of an interrupted branch and the points before it, None if there is no checkpoint."""

    def narrower(self, task: BranchTask, workspace: Workspace) -> Narrower | None:
        """Return a narrower range over which the branch was followed to its end, with the state there and its points."""

    def save(self, task: BranchTask, state: BranchState | None, points: Sequence[Point]) -> None:
        """Save the state between two steps, None if there is none, and the points since the last call.

        Writing may be postponed until the next call, for one step at most.
        """

    def flush(self) -> None:
        """Write a postponed step if possible, because the branch is abandoned.  Local."""

    def finish(self, branch: Branch) -> None:
        """Save the outcome of a branch that has ended."""

    def solved_for(self, kind: type[T], solve: Callable[[], list[T]]) -> list[T]:
        """Return the peaks or the bifurcations (``kind``) of a branch that has ended: the saved ones, or by ``solve``, saved."""


class NoCheckpoints:
    """A :class:`Checkpointer` that writes nothing and restores nothing."""

    def finished(self) -> Branch | None:
        """Return None.  Local."""
        return None

    def restored(self, task: BranchTask, workspace: Workspace) -> Restored | None:
        """Return None.  Local."""
        return None

    def narrower(self, task: BranchTask, workspace: Workspace) -> Narrower | None:
        """Return None.  Local."""
        return None

    def save(self, task: BranchTask, state: BranchState | None, points: Sequence[Point]) -> None:
        """Do nothing.  Local."""

    def flush(self) -> None:
        """Do nothing.  Local."""

    def finish(self, branch: Branch) -> None:
        """Do nothing.  Local."""

    def solved_for(self, kind: type[T], solve: Callable[[], list[T]]) -> list[T]:
        """Return the result of ``solve``.  Collective as ``solve``."""
        return solve()


def finished_or(
    checkpointer: Checkpointer, follow: Callable[[], Branch], on_point: Callable[[Point], None], stores_empty: bool = True
) -> Branch:
    """Return the branch that an earlier run followed to its end, or that of ``follow``, and store its end.  Collective.

    A branch without points is not stored, and thus followed again, unless ``stores_empty``.
    """
    branch = checkpointer.finished()
    if branch is None:
        branch = follow()
        if branch.points or stores_empty:
            checkpointer.finish(branch)
        return branch
    for point in branch.points:
        on_point(point)
    return branch


NO_CHECKPOINTS = NoCheckpoints()
Checkpointers = Callable[["MPI.Comm", float, int], Checkpointer]  # of the ranks at work, a level [N] and a segment of its branch


def no_checkpoints(comm: MPI.Comm, level: float, segment: int) -> Checkpointer:
    """Return the checkpointer that writes nothing.  Local."""
    return NO_CHECKPOINTS
