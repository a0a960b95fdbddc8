"""A branch of a narrower range continued in a wider one: the part before it is followed up to its first point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..points.branch import Point

if TYPE_CHECKING:
    from .checkpointer import Narrower, Restored
    from .point_solver import Workspace
    from .state import BranchState
    from .task import BranchTask

SAME = 1e-6  # relative difference of responses where both parts meet: beyond it they are not of one branch
Follow = Callable[["BranchTask", "BranchState"], list[Point] | None]  # collective; the points to the end of the range, or none


def widened(task: BranchTask, shorter: Narrower, workspace: Workspace, follow: Follow) -> Restored | None:
    """Return the state at the end of a shorter range and all points up to there; None if the branch cannot be used.

    Collective.  It cannot if the wider range requests points within the shorter one, or if the part from the new start
    arrives at another solution.
    """
    sweep, state, points = shorter
    if not set(task.sweep.requested_between(sweep.start, sweep.stop)) <= {point.omega for point in points if point.requested}:
        return None
    if sweep.start != task.sweep.start:
        ahead = replace(task, sweep=task.sweep.until(sweep.start))
        before = follow(ahead, ahead.start(workspace))
        if before is None or not _meet(before[-1], points[0]):
            return None
        points = before[:-1] + points
    solver = replace(state.solver, is_linear=state.solver.is_linear and task.is_linear)
    return replace(state, solver=solver, is_done=sweep.stop == task.sweep.stop), points


def _meet(point: Point, other: Point) -> bool:
    """Return whether two points at one frequency are the same.  Local; responses are the same on all ranks."""
    n = min(point.response.shape[-1], other.response.shape[-1])
    gap = np.abs(point.response[:, :n] - other.response[:, :n]).max()
    return bool(gap <= SAME * np.abs(other.response).max())
