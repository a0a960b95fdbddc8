"""The state of a branch between two points: input and output of a step."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .accuracy import Memory
from .iterate import PointState
from .point_solver import PointSolver


@dataclass(frozen=True, eq=False)
class BranchState:
    """The solver of the next point, and the last points, from which the next step starts; none before the first."""

    solver: PointSolver  # its resolution, hold and whether all points so far are linear; its workspace is no part of the state
    memory: Memory  # of the accuracy
    ds: float = 0.0  # of the next step, in the relative norm
    earlier: PointState | None = None  # the last three points, the latest ``now``
    before: PointState | None = None
    now: PointState | None = None
    is_done: bool = False  # the end of the range is reached

    def after(self, before: PointState | None, now: PointState, ds: float, earlier: PointState | None = None) -> BranchState:
        """Return the state with other last points and step.  Local."""
        return replace(self, earlier=earlier, before=before, now=now, ds=ds)
