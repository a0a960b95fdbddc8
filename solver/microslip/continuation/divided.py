"""Curves divided into parts that are followed at the same time (docs/theory.md, section 7).

A coarse curve, in few harmonics and long steps, shows where the branch leads, folds included.  At some of its points the problem
itself is solved on the plane normal to the coarse curve, and from each of these solutions the branch is followed until it passes
the next one.  A part that passes none, because the coarse curve is elsewhere, continues to the end of the range.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..fourier.harmonics import Harmonics
from ..messages.errors import ConvergenceError
from ..messages.words import counted
from ..points.branch import NOTHING, Branch, Point
from .acceptance import accept
from .accuracy import LEAST_SAMPLES
from .checkpoint import Arrays, from_arrays, over, point_arrays, point_state, state_arrays, under
from .constraint_rows import Plane
from .follow import advance, with_facts
from .iterate import Iterate, PointState
from .levels import ResponseProblem, most_points, task_of
from .point_solver import PointSolver, Workspace
from .predictor import difference
from .steps import ArcLength
from .task import BranchTask
from .ways_out import MOSTLY, regularised

PARTS = 2  # of a level, for each group of ranks
STEP = 0.1  # effort of a step in addition to that of the sliding pairs, as a share of all pairs
LONGER = 4.0  # ratio of the steps of the coarse curve to those of the curve
TURN, EASY = 0.5, 8  # rad between two steps of the coarse curve, and Newton iterations, at which their length is unchanged
COARSE = 1e-4  # tolerance of its points
NEAR = 0.3  # largest distance of the chord of a step from a beginning that it passes, over its length


@dataclass(frozen=True, eq=False)
class Beginning:
    """The first point of a part, and the state from which the branch continues, as arrays for any number of ranks."""

    point: Point
    state: Arrays

    def last_two(self, solver: PointSolver) -> tuple[PointState, PointState]:
        """Return the last two points of the state, in the harmonics of a solver.  Local."""
        owned = solver.equation.model.owned
        return solver.carried(point_state(under("before", self.state), owned)), self.of(solver)

    def of(self, solver: PointSolver) -> PointState:
        """Return the first point, in the harmonics of a solver.  Local."""
        return solver.carried(point_state(under("now", self.state), solver.equation.model.owned))


# -- the coarse curve ---------------------------------------------------------------------------------------------


def coarse_curve(of: ResponseProblem, level: float) -> list[Arrays]:
    """Return the points of a level [N] in its loads' harmonics and long steps, as arrays; none of a linear one.  Collective.

    A curve that ends early has the points so far.
    """
    fine = task_of(of, level)
    if of.model.n_pairs == 0 or fine.is_linear:
        return []
    equation = fine.problem.equation
    harmonics = Harmonics(tuple(n for n in equation.harmonics.chosen if n <= of.settings.loaded))
    problem = fine.problem.with_equation(equation.resolved(harmonics, min(LEAST_SAMPLES, equation.n_samples)))
    tolerance, steps, sweep = max(COARSE, fine.tolerance), longer(fine.steps), replace(of.sweep, at=())
    task = BranchTask(problem, of.selection, sweep, steps, tolerance)
    points, workspace = list[PointState](), task.workspace()
    state, failure = task.start(workspace), None
    try:
        while not state.is_done and failure is None and len(points) < most_points(of.settings.points):
            advanced = advance(task, state)
            state, failure = advanced.state, advanced.failure
            if failure is None and state.now is not None and advanced.points:
                points.append(state.now)
        return [point_arrays(problem.equation, point) for point in points]
    finally:
        workspace.destroy()


def longer(steps: ArcLength) -> ArcLength:
    """Return the step lengths of a coarse curve.  Local."""
    return replace(steps, ds=LONGER * steps.ds, ds_max=LONGER * steps.ds_max, turn=TURN, easy=EASY)


def places(curve: Sequence[Arrays], n_parts: int) -> list[int]:
    """Return the points of a coarse curve at which parts begin, at most one a step: parts of about the same effort.  Local."""
    points = [point_state(point, slice(None)) for point in curve]
    steps = [np.linalg.norm(b.iterate.U - a.iterate.U) / a.size * (STEP + a.sliding + b.sliding) for a, b in pairwise(points)]
    effort = np.concatenate([[0.0], np.cumsum(steps)])
    ideal = np.arange(1, n_parts) / n_parts * effort[-1]
    return sorted({int(i) for i in np.searchsorted(effort, ideal) if 0 < i < len(curve) - 1})


# -- a part ------------------------------------------------------------------------------------------------------------


def beginning(of: ResponseProblem, level: float, curve: Sequence[Arrays], i: int) -> Beginning | None:
    """Return the solution at the ``i``-th point of a coarse curve; None where Newton's method finds none.  Collective."""
    task, owned = task_of(of, level), of.model.owned
    workspace = task.workspace()
    state = task.start(workspace)
    back, here, ahead = (state.solver.carried(point_state(curve[k], owned)) for k in (i - 1, i, i + 1))
    try:
        held = regularised(state.solver, here.sliding, MOSTLY) if task.may_hold else None
        state = replace(state, solver=held or state.solver)
        d_U, d_nu, length = difference(state.solver, back, ahead, here.size)
        solution = state.solver.solve(
            here.iterate, plane_at(state.solver, here, d_U, d_nu, length), here.size, here.selected, here.force
        )
        if solution[0].failure is not None:
            return None
        first = accept(task, state, solution)
        solver, now, ds = first.state.solver, first.now, task.steps.ds
        d_U = state.solver.harmonics.carry(d_U, solver.harmonics)
        before = replace(now, iterate=solver.stepped(now.iterate, -ds / length * d_U, -ds / length * d_nu))
        state = first.state.after(before, now, ds)
        arrays = over("before", point_arrays(solver.equation, before)) | over("now", point_arrays(solver.equation, now))
        return Beginning(first.point, state_arrays(state) | arrays)
    except ConvergenceError:
        return None
    finally:
        _destroy(task, workspace)


def plane_at(solver: PointSolver, here: PointState, d_U: np.ndarray, d_nu: np.ndarray, length: float) -> Plane:
    """Return the plane through a point normal to a step of that length in its norm; the mean does not count.  Local."""
    normal = d_U / (here.size * length)
    normal[..., solver.harmonics.mean] = 0.0
    return Plane(here.iterate, normal, tuple(d_nu / length))


@dataclass
class Part(Branch):
    """A part of a branch; it ends before the first point of another one, or at the end of the range."""

    leads_to: int | None = None


def follow_part(
    of: ResponseProblem,
    level: float,
    beginnings: Sequence[Beginning],
    k: int,
    on_point: Callable[[Point], None] = lambda point: None,
) -> Part:
    """Return the ``k``-th part of a level [N], until it passes the beginning of a later one.  Collective.

    Part 0 begins at the start of the range, part k at ``beginnings[k - 1]``.
    """
    task, branch = task_of(of, level), Part(level)
    workspace, is_root = task.workspace(), of.model.comm.rank == 0

    def take(points: Sequence[Point]) -> None:
        for point in points:
            on_point(point)
            branch.points.append(point if is_root else replace(point, U=NOTHING, p=NOTHING))

    try:
        state = task.start(workspace)
        if k > 0:
            state = from_arrays(task, beginnings[k - 1].state, workspace)
            take([beginnings[k - 1].point])
        while not state.is_done and branch.failure is None and branch.leads_to is None:
            before, advanced = state.now, advance(task, state)
            state, branch.failure, points = advanced.state, advanced.failure, advanced.points
            branch.leads_to = passed(state.solver, before, state.now, beginnings, k)
            if branch.leads_to is not None and before is not None:  # requested points may lie before it
                ends = before.iterate.parameter, beginnings[branch.leads_to - 1].of(state.solver).iterate.parameter
                points = [point for point in points[:-1] if min(ends) < point.omega < max(ends)]
            take(points)
            if len(branch.points) >= most_points(of.settings.points):
                branch.failure = f"{counted(len(branch.points), 'point')} without reaching another part"
        with_facts(branch, task, state)
        return branch
    finally:
        _destroy(task, workspace)


def passed(
    solver: PointSolver, a: PointState | None, b: PointState | None, beginnings: Sequence[Beginning], k: int
) -> int | None:
    """Return the first part after the ``k``-th whose beginning the step from ``a`` to ``b`` passes, None if there is none.

    Collective.  The step passes the plane at the beginning, and its chord is near to the beginning there.
    """
    if a is None or b is None:
        return None
    a, b = solver.carried(a), solver.carried(b)
    for m, begin in enumerate(beginnings[k:], k + 1):
        back, there = begin.last_two(solver)
        d_U, d_nu, length = difference(solver, back, there, there.size)
        plane = plane_at(solver, there, d_U, d_nu, length)
        from_a, from_b = (_side(solver, plane, there, end) for end in (a, b))
        if not from_a < 0.0 <= from_b:
            continue
        share = from_a / (from_a - from_b)
        U = a.iterate.U + share * (b.iterate.U - a.iterate.U)
        omega = a.iterate.parameter + share * (b.iterate.parameter - a.iterate.parameter)
        chord = Iterate(U, (omega,), solver.harmonics)
        step = difference(solver, a, b, there.size)[2]
        if solver.distance(there, chord) <= NEAR * step:
            return m
    return None


def _side(solver: PointSolver, plane: Plane, about: PointState, there: PointState) -> float:
    """Return the distance of a point from a plane, in the norm of the steps; negative before it.  Collective."""
    d_U = (there.iterate.U - about.iterate.U) / about.size
    along = solver.comm.allreduce(float(np.vdot(plane.n_U, d_U)))
    return along + float(np.dot(plane.n_nu, solver.d_nu(about.iterate, there.iterate)))


def _destroy(task: BranchTask, workspace: Workspace) -> None:
    """Free the solvers of a task.  Collective."""
    workspace.destroy()
    if task.estimator is not None:
        task.estimator.destroy()


# -- the whole ---------------------------------------------------------------------------------------------------------


def joined(parts: Sequence[Part]) -> Branch | None:
    """Return the parts of a level as one branch, from the start of the range; None where one ends early.  Local."""
    first = parts[0]
    branch = Branch(first.level, is_linear=first.is_linear, closes_to=first.closes_to, odd=first.odd, solver=first.solver)
    k: int | None = 0
    while k is not None:
        if parts[k].failure is not None:
            return None
        branch.points += parts[k].points
        k = parts[k].leads_to
    return branch
