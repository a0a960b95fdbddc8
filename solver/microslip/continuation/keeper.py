"""What keeps a branch somewhere safe as it is followed, so that it need not be followed again.  Nothing does by default."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

from ..points.branch import Branch, Point

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..points.sweep import Sweep
    from .point_solver import Workspace
    from .state import BranchState
    from .task import BranchTask

Begun = tuple["BranchState", list[Point]]
Shorter = tuple["Sweep", "BranchState", list[Point]]


class Keeper(Protocol):
    """Keeps one way through a range.  All methods but one are collective on the ranks that follow it.

    Points that are handed back have their motion on rank 0, as those of a branch.
    """

    def ended(self) -> Branch | None:
        """Return the branch if it was followed to its end before."""

    def begun(self, task: BranchTask, workspace: Workspace) -> Begun | None:
        """Return the state from which to go on and the points before it, if the branch was begun before."""

    def shorter(self, task: BranchTask, workspace: Workspace) -> Shorter | None:
        """Return a range within that of the task over which the branch was followed to its end, the state there, its points."""

    def keep(self, task: BranchTask, state: BranchState | None, points: Sequence[Point]) -> None:
        """Keep a state between two steps, None where there are none, and the points that have come since the last one.

        One step may be put off until the next one is kept.
        """

    def let_go(self) -> None:
        """Keep what was put off, as well as that can be done: the branch is given up.  Local."""

    def end(self, branch: Branch) -> None:
        """Keep that the branch has come to its end, and how."""


class KeepsNothing:
    """The keeper that has nothing and keeps nothing; what its methods are for, :class:`Keeper` says."""

    def ended(self) -> Branch | None:
        return None

    def begun(self, task: BranchTask, workspace: Workspace) -> Begun | None:
        return None

    def shorter(self, task: BranchTask, workspace: Workspace) -> Shorter | None:
        return None

    def keep(self, task: BranchTask, state: BranchState | None, points: Sequence[Point]) -> None:
        pass

    def let_go(self) -> None:
        pass

    def end(self, branch: Branch) -> None:
        pass


KEEPS_NOTHING = KeepsNothing()
Keepers = Callable[["MPI.Comm", float, int], Keeper]  # of the ranks at work, a level [N] and a segment of its branch


def keep_nothing(comm: MPI.Comm, level: float, segment: int) -> Keeper:
    """Return the keeper that keeps nothing.  Local."""
    return KEEPS_NOTHING
