"""A branch to be followed: what goes into every step and does not change along the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ..error_estimate.estimate import ErrorEstimator
from ..points.selection import Selection
from ..points.sweep import Sweep
from .accuracy import Accuracy, Memory
from .point_solver import Found, PointSolver, Workspace
from .problems import Problem
from .state import BranchState
from .steps import ArcLength

Reached = tuple[Found, PointSolver]
Advance = Callable[..., Any]  # takes a branch one step on: follow.advance, which itself begins with a first point
Way = Callable[["BranchTask", PointSolver, Advance], Reached | None]  # collective; None in vain


@dataclass(frozen=True, eq=False)
class BranchTask:
    """A branch to be followed: what is continued, over which range, in which steps, how exactly."""

    problem: Problem
    selection: Selection
    sweep: Sweep
    steps: ArcLength
    tolerance: float
    estimator: ErrorEstimator | None = None
    accuracy: Accuracy | None = None
    is_linear: bool = False  # known to stay on the linear curve: scaled, not solved
    may_hold: bool = True  # the mean slip, by springs
    ways: tuple[Way, ...] | None = None  # to a first point that Newton does not reach at once; None: all there are

    def start(self, workspace: Workspace) -> BranchState:
        """Return the state before the first point.  Local."""
        solver = PointSolver(self.problem, self.selection, self.sweep, self.tolerance, workspace, self.is_linear)
        if self.accuracy is not None:
            coarsest = self.accuracy.coarsest
            solver = solver.resolved(replace(coarsest, tolerance=self.tolerance) if "solver" in self.accuracy.keeps else coarsest)
        return BranchState(solver, Memory())
