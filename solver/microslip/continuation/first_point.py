"""Ways to a first point that Newton does not reach from the linear response, a function each (docs/theory.md, section 7)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..messages.errors import ConvergenceError
from ..points.sweep import Sweep
from .point_solver import Found, PointSolver
from .problems import DampingHomotopy, LevelHomotopy, Problem
from .state import BranchState
from .steps import ArcLength
from .task import Advance, BranchTask, Reached, Way

HOMOTOPY_STEPS = ArcLength(ds=0.2, ds_min=2e-4, ds_max=1.0)  # along a homotopy
FROM_LEVEL, FROM_DAMPING = (1e-2, 1e-4), (1e-1, 1e-3)  # of the parameter at the end of a homotopy, where it begins
MOST_NEWTON = 1500  # of Newton, on one such way; those that arrive take some hundreds
MOST_POINTS = 1000


def reach_first(task: BranchTask, solver: PointSolver, ahead: Advance) -> tuple[Found, PointSolver, tuple[str, ...]]:
    """Solve the first point, from the linear response or else by the ways in turn.  Collective.

    Returns it with the solver that found it, which may hold the mean slip, and notes on how it was reached.  ``ahead`` takes a
    branch, that of a homotopy, one step on.

    Raises
    ------
    ConvergenceError : none leads there; on every rank
    """
    found = solver.first()
    if found[0].failure is None:
        return found, solver, ()
    task = replace(task, ahead=ahead)
    for way in WAYS if task.ways is None else task.ways:
        reached = way(task, solver)
        if reached is not None:
            notes = (f"first point {NOTES[way]}, where there may be other solutions",) if way in NOTES else ()
            return *reached, notes
    raise ConvergenceError(task.problem.without_solution(task.sweep.start, found[0].failure))


def over_the_level(task: BranchTask, solver: PointSolver) -> Reached | None:
    """Solve from a small level up, by arc length at the frequency of the first point, folds included.  Collective."""
    at = task.problem.at(solver.on_curve(task.sweep.start).parameters)
    return _over(task, solver, LevelHomotopy(solver.equation, at.omega), at.level, FROM_LEVEL)


def over_damping(task: BranchTask, solver: PointSolver) -> Reached | None:
    """Solve from a damping that leaves one solution down to none beside the scene's.  Collective."""
    at = task.problem.at(solver.on_curve(task.sweep.start).parameters)
    return _over(task, solver, DampingHomotopy(solver.equation, at.omega, at.level), 1.0, FROM_DAMPING)


def from_rest(task: BranchTask, solver: PointSolver) -> Reached | None:
    """Solve from no motion, where gaps are open.  Collective."""
    linear = solver.on_curve(task.sweep.start)
    selected = solver.selection.first(solver.equation.model.n_pairs)
    found, selected = solver.solve_at(replace(linear, U=np.zeros_like(linear.U)), solver.norm(linear.U), selected)
    return ((found, selected), solver) if found.failure is None else None


def with_mean_slip_held(task: BranchTask, solver: PointSolver) -> Reached | None:
    """Solve for a body that hangs on its joint alone with its mean slip held about none.  Collective."""
    if not task.may_hold or solver.equation.held is not None or not solver.is_loose:
        return None
    held = solver.holding(np.zeros((solver.equation.n_owned, 2)))
    found = held.first()
    return over_the_level(task, held) or over_damping(task, held) if found[0].failure else (found, held)


def patiently(task: BranchTask, solver: PointSolver) -> Reached | None:
    """Solve by many small Newton steps, from the linear response and from rest.  Collective."""
    patient = replace(solver, is_patient=True)
    found = patient.first()
    reached = (found, patient) if found[0].failure is None else from_rest(task, patient)
    return reached and (reached[0], solver)


def _over(task: BranchTask, solver: PointSolver, homotopy: Problem, end: float, beginnings: tuple[float, ...]) -> Reached | None:
    """Solve at the end of a homotopy, where it is the problem, from near its beginning; None in vain.  Collective."""
    plain = replace(task, estimator=None, accuracy=None, is_linear=False, ways=(from_rest, patiently))
    for share in beginnings:
        way = replace(plain, problem=homotopy, sweep=Sweep(share * end, end), steps=HOMOTOPY_STEPS, tolerance=solver.tolerance)
        arrived = _end_of(way)
        if arrived is None or arrived.now is None:
            continue
        there, now = solver.holding(arrived.solver.equation.held), arrived.now
        guess = replace(solver.on_curve(task.sweep.start), U=now.iterate.U, harmonics=now.iterate.harmonics)
        found = there.solve_near(guess, now)
        if found[0].failure is None:
            return found, there
    return None


def _end_of(way: BranchTask) -> BranchState | None:
    """Return the state at the end of a homotopy; None where it is not reached.  Collective."""
    assert way.ahead is not None, "told by reach_first"
    workspace, n_points, newton = way.workspace(), 0, 0
    state = way.start(workspace)
    try:
        while not state.is_done and n_points < MOST_POINTS:
            found = way.ahead(way, state)
            state, n_points, newton = found.state, n_points + len(found.points), newton + found.newton
            if found.failure or newton > MOST_NEWTON:
                return None
    finally:
        workspace.destroy()
    return state if state.is_done else None


WAYS: tuple[Way, ...] = (over_the_level, from_rest, with_mean_slip_held, patiently, over_damping)
NOTES = {
    over_the_level: "reached over the level",
    from_rest: "found from rest",
    patiently: "found by small Newton steps",
    over_damping: "reached over further damping",
}
