"""The task of following a branch: the data of every step that do not change along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from ..error_estimate.estimate import ErrorEstimator
from ..points.branch import Point
from ..points.selection import Selection
from ..points.sweep import Sweep
from .accuracy import Accuracy, Memory
from .point_solver import PointSolver, Workspace
from .problems import Problem
from .state import BranchState
from .steps import ArcLength

Advance = Callable[["BranchTask", BranchState], "Advanced"]  # one step of a branch: follow.advance


@dataclass(frozen=True, eq=False)
class BranchTask:
    """A branch to be followed: problem, range, steps and tolerance."""

    problem: Problem
    selection: Selection
    sweep: Sweep
    steps: ArcLength
    tolerance: float
    estimator: ErrorEstimator | None = None
    accuracy: Accuracy | None = None
    is_linear: bool = False  # known to stay on the linear curve: scaled, not solved
    has_stability: bool = False  # whether the multipliers of every point are computed
    has_sensitivities: bool = False  # whether the derivatives of the outputs are computed at every point
    may_hold: bool = True  # the mean slip, by springs
    is_homotopy: bool = False  # on the way to a first point

    def workspace(self) -> Workspace:
        """Return the data that the solves of this branch share; to be destroyed.  Collective."""
        return Workspace(self.problem.equation, self.estimator is not None or self.has_sensitivities, 1 + len(self.problem.units))

    def start(self, workspace: Workspace) -> BranchState:
        """Return the state before the first point.  Local."""
        solver = PointSolver(self.problem, self.selection, self.sweep, self.tolerance, workspace, self.is_linear)
        if self.accuracy is not None:
            coarsest = self.accuracy.coarsest
            solver = solver.resolved(replace(coarsest, tolerance=self.tolerance) if "solver" in self.accuracy.keeps else coarsest)
        return BranchState(solver, Memory())


@dataclass(frozen=True, eq=False)
class Advanced:
    """The result of one step: the new state, the points on the way, and the reason if the branch ends here."""

    state: BranchState
    points: list[Point]
    failure: str | None
    newton: int  # iterations, failed solves included
