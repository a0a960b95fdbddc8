"""Solve at given frequencies, so that methods can be compared point by point."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..error_estimate.estimate import ErrorEstimator
from ..messages.errors import ConvergenceError
from ..points.branch import NOTHING, Branch, Point
from ..points.selection import Selection
from ..points.sweep import Sweep
from .acceptance import Accepted, accept
from .accuracy import Accuracy
from .follow import Leg, first_point, solved
from .iterate import Iterate, PointState, interpolate
from .problems import Problem
from .state import BranchState
from .stepping import second, step
from .steps import ArcLength
from .task import BranchTask

FURTHEST = 2.0  # times the distance of the last two points: range in which their secant is used
GRID_STEPS = ArcLength(ds=0.1, ds_min=1e-5, ds_max=0.2)  # along the branch, to a frequency that Newton does not reach at once
MOST_STEPS = 1000


def advancing(points: Sequence[Point], direction: float) -> list[float]:
    """Return the frequencies of a branch, each further in the direction of the sweep than all before.

    Local.  None comes twice behind a fold.
    """
    omegas: list[float] = []
    for point in points:
        if not omegas or direction * (point.omega - omegas[-1]) > 1e-9 * point.omega:
            omegas.append(point.omega)
    return omegas


def secant(before: Iterate | None, now: Iterate, omega: float) -> Iterate:
    """Return a guess at ``omega`` [rad/s]: on the secant through two points where it reaches that far, else the last point.

    Local.  If ``omega`` is behind the last point, that point is the guess: the branch may have folded.
    """
    if before is None or not 0.0 < (omega - now.parameter) / (now.parameter - before.parameter) <= FURTHEST:
        return now.at(omega)
    return interpolate(before, now, omega)


def at_frequencies(
    problem: Problem,
    selection: Selection,
    omegas: Sequence[float],
    *,
    tolerance: float,
    on_point: Callable[[Point], None] = lambda point: None,
) -> Branch:
    """Solve one level at ``omegas`` (n,) [rad/s], consecutive ones different, each from the points before it.

    Collective.  Divergence does not raise: the branch has the points so far, and the reason in
    ``failure``.  If several solutions exist at a frequency, the result is one near the last point.

    Notes
    -----
    Every method starts from its own last two points by the same predictor, the secant.  If Newton does not
    reach a frequency so, as beyond a fold, the branch is followed by arc length; points on the way are not recorded, but
    their iterations and time count.
    """
    return solved_at(task_at(problem, selection, omegas, tolerance), omegas, on_point)


def task_at(
    problem: Problem,
    selection: Selection,
    omegas: Sequence[float],
    tolerance: float,
    estimator: ErrorEstimator | None = None,
    accuracy: Accuracy | None = None,
) -> BranchTask:
    """Return the task for :func:`solved_at`.  Local."""
    # springs would stay, and another problem would be compared
    return BranchTask(problem, selection, range_of(omegas), GRID_STEPS, tolerance, estimator, accuracy, may_hold=False)


def solved_at(task: BranchTask, omegas: Sequence[float], on_point: Callable[[Point], None] = lambda point: None) -> Branch:
    """Return the points of a task at ``omegas``, as :func:`at_frequencies`, with error bars and an accuracy if it has them.

    Collective.
    """
    problem = task.problem
    branch, workspace = Branch(problem.at((omegas[0],)).level), task.workspace()
    try:
        for point in _points(task, task.start(workspace), omegas):
            on_point(point)
            branch.points.append(point if workspace.comm.rank == 0 else replace(point, U=NOTHING, p=NOTHING))
    except ConvergenceError as failure:
        branch.failure = str(failure)
    finally:
        workspace.destroy()
        if task.estimator is not None:
            task.estimator.destroy()
    return branch


def range_of(omegas: Sequence[float]) -> Sweep:
    """Return the range of some frequencies [rad/s], from the first of them.  Local."""
    return Sweep(omegas[0], omegas[0] + (float(np.ptp(omegas)) or 1e-3 * omegas[0]))


def _points(task: BranchTask, state: BranchState, omegas: Sequence[float]) -> Iterator[Point]:
    """Yield the point at each frequency."""
    solution = first_point(task, state, requested=True)
    yield solution.point
    before: PointState | None = None
    for omega in omegas[1:]:
        solver = solution.state.solver
        before, now = before and solver.carried(before), solver.carried(solution.now)
        solution = _reach(task, solution.state, before, now, omega)
        yield solution.point
        before = now


def _reach(task: BranchTask, state: BranchState, before: PointState | None, now: PointState, omega: float) -> Accepted:
    """Return the point at ``omega``: from the secant, from the last point, or along the branch."""
    guess, spent = secant(None if before is None else before.iterate, now.iterate, omega), Spent()
    for start in [guess] if guess.U is now.iterate.U else [guess, now.iterate.at(omega)]:
        solution = state.solver.solve_near(start, now)
        if solution[0].failure is None:
            return spent.added_to(accept(task, state, solution, requested=True))
        spent.add(solution[0].newton, solution[0].krylov)
    return spent.added_to(_follow_to(task, state, before, now, omega))


def _follow_to(task: BranchTask, state: BranchState, before: PointState | None, now: PointState, omega: float) -> Accepted:
    """Return the point at which the branch, followed from ``now`` towards ``omega``, first has that frequency."""
    start, ds, earlier, spent = now.iterate.parameter, GRID_STEPS.ds, None, Spent()
    way, scale = omega - start, task.sweep.scale
    solver = replace(state.solver, sweep=Sweep(start, start + float(np.copysign(scale, way))))
    state, direction = replace(state, solver=solver), solver.sweep.direction
    if before is None or (start - before.iterate.parameter) * way <= 0.0:
        before, solution = None, second(solver, solver.carried(now), GRID_STEPS).solution
    else:
        stepped = step(solver, None, before, now, ds, GRID_STEPS)
        solution, ds = stepped.solution, stepped.ds
    for _ in range(MOST_STEPS):
        there = solution[0].iterate
        if (start - there.parameter) * direction > scale:
            break
        if (there.parameter - omega) * (now.iterate.parameter - omega) <= 0.0:
            spent.add(solution[0].newton, solution[0].krylov)
            goal = interpolate(now.iterate.on(solver.harmonics), there, omega)
            return spent.added_to(solved(Leg(task, state, now), goal, solution, requested=True))
        after = accept(task, state, solution, on_the_way=True)
        state, solver = after.state, after.state.solver
        spent.add(after.point.newton, after.point.krylov, after.point.seconds)
        if before is not None:
            ds = GRID_STEPS.next(ds, solution[0].newton, solver.turn(before.iterate, now.iterate, after.now.iterate, now.size))
        earlier, before, now = before, now, after.now
        stepped = step(solver, earlier, before, now, ds, GRID_STEPS)
        solution, ds = stepped.solution, stepped.ds
    where = (task.problem.where(parameter) for parameter in (omega, start))
    raise ConvergenceError("hb: {} not reached along the branch from {}; state frequencies closer to each other".format(*where))


@dataclass
class Spent:
    """Effort of intermediate solves for a point, in addition to that of its solve."""

    newton: int = 0
    krylov: int = 0
    seconds: float = 0.0

    def add(self, newton: int, krylov: int, seconds: float = 0.0) -> None:
        """Add Newton iterations, Krylov iterations and seconds.  Local."""
        self.newton, self.krylov, self.seconds = self.newton + newton, self.krylov + krylov, self.seconds + seconds

    def added_to(self, solution: Accepted) -> Accepted:
        """Return a point with this effort added to its record."""
        point = solution.point
        return replace(
            solution,
            point=replace(
                point, newton=point.newton + self.newton, krylov=point.krylov + self.krylov, seconds=point.seconds + self.seconds
            ),
        )
