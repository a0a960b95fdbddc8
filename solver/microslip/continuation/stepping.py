"""Steps from point to point of a branch by arc length, round its corners (docs/theory.md, section 7)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..messages.errors import ConvergenceError
from .constraint_rows import Plane
from .corrector import BorderedSystem, Correction
from .iterate import Iterate, PointState
from .point_solver import Found, PointSolver
from .predictor import difference, linear_step, predict
from .resonances import passed_over, stay_stuck
from .steps import ArcLength

FARTHEST = 4.0  # lengths of a step asked for that it may have: on the plane normal to it, a turn of 75 degrees
NEAREST = 1e-3  # lengths of it below which it leads nowhere
CORNERS = 4.0 ** np.arange(1, 5)  # shortest steps in which the branch is looked for beyond a sharp corner
TENTHS = 0.1 ** np.arange(4)  # of a step, at which the branch is looked for by many small Newton steps
BACK = 0.05  # rad between a step and the way back, below which it is that
PASSED = "a resonance may lie between the point before and this one, too sharp for the shortest step"


class Stepped(NamedTuple):
    """A step on: the point it found, its length, and what there is to say of it."""

    found: Found
    ds: float
    notes: tuple[str, ...] = ()


def second(solver: PointSolver, first: PointState, steps: ArcLength) -> Stepped:
    """Solve the second point, a little further along the sweep; halve the way until it converges nearby.  Collective.

    A point further off than ``ds_max`` may lie beyond folds, with the resonance between them, as may one beyond a resonance.
    It is taken only where none is nearer: where the set B has changed since the first point, and the solution with it.
    """
    sweep, far = solver.sweep, None  # the first that converged, and its notes
    way = min(linear_step(solver, first, 0.5 * steps.ds), 0.5 * sweep.scale)
    while True:
        there = first.iterate.parameter + sweep.direction * way
        guess = solver.on_curve(there) if first.sticks else first.iterate.at(there)
        found, selected = solver.solve_near(guess, first)
        if found.failure is None:
            is_passed = passed_over(solver, first, found.iterate) is not None
            if solver.distance(first, found.iterate) <= steps.ds_max and not is_passed:
                return Stepped((found, selected), steps.ds)
            far = far or Stepped((found, selected), steps.ds, (PASSED,) if is_passed else ())
        way /= 2.0
        if way < steps.ds_min * sweep.scale:
            if far:
                return far
            raise ConvergenceError(message(solver, first.iterate.parameter, found, steps))


def step(
    solver: PointSolver, earlier: PointState | None, before: PointState, now: PointState, ds: float, steps: ArcLength
) -> Stepped:
    """Return the next converged point and the step that reached it, shortened until Newton converges and no resonance is passed.

    Collective.  Where the shortest step passes one yet, or none leads to it, the step says so.

    Raises
    ------
    ConvergenceError : no step down to the shortest leads on; on every rank
    """
    earlier, before, now = earlier and solver.carried(earlier), solver.carried(before), solver.carried(now)
    passing: Stepped | None = None
    while True:
        guess, plane = predict(solver, earlier, before, now, ds)
        found, selected = solver.solve(guess, plane, now.size, now.selected, now.force)
        leads_on = found.failure is None and (
            not left(solver, before, now, found, ds, may_turn=passing is not None) or stay_stuck(solver, now, found.iterate)
        )
        share = passed_over(solver, now, found.iterate) if leads_on else None
        if leads_on and share is None:
            return Stepped((found, selected), ds)
        if share is not None:
            passing = Stepped((found, selected), ds, (PASSED,))  # taken if no shorter one leads on
        ds *= share or 0.5
        if ds < steps.ds_min and passing is not None:
            return passing
        if ds < steps.ds_min:
            beyond = just_ahead(solver, before, now, steps) or beyond_sharp_corner(solver, before, now, steps)
            if beyond is None and (solver.equation.held is not None or not solver.is_loose):  # whose mean slip is not to be held
                beyond = patiently_ahead(solver, earlier, before, now, steps)
            if beyond is None:
                raise ConvergenceError(message(solver, now.iterate.parameter, found, steps))
            return Stepped(beyond, 8.0 * steps.ds_min)
        if not leads_on and now.sliding == 1.0 and solver.equation.held is None and solver.is_loose:
            raise ConvergenceError(message(solver, now.iterate.parameter, found, steps))


def left(solver: PointSolver, before: PointState, now: PointState, found: Correction, ds: float, may_turn: bool = False) -> bool:
    """Tell whether a step fell back on the branch or jumped off it: by a turn of more than 90 degrees or another length.

    One that is short beside the last, shortened before a resonance, ``may_turn`` off that chord if the parameter goes on.
    """
    here = now.iterate.parameter
    goes_on = (found.iterate.parameter - here) * (here - before.iterate.parameter) > 0.0
    turns = solver.turn(before.iterate, now.iterate, found.iterate, now.size) > 0.5 * np.pi and not (may_turn and goes_on)
    return turns or not NEAREST * ds <= solver.distance(now, found.iterate) <= FARTHEST * ds


def message(solver: PointSolver, parameter: float, found: Correction, steps: ArcLength) -> str:
    """Say that and why a branch ends."""
    return (
        f"hb: no convergence beyond {solver.problem.where(parameter)} after {found.newton} iterations: "
        f"{found.failure or 'the branch turns back'}; the step was halved down to [continuation] "
        f"ds_min = {steps.ds_min:.1e}: reduce ds_min or ds, or the level"
    )


# -- corners: where a sample of a pair begins or ends to slip ------------------------------------------------------


def just_ahead(solver: PointSolver, before: PointState, now: PointState, steps: ArcLength) -> Found | None:
    """Return a point at a fixed parameter within the shortest step; None if Newton finds none.  Collective.

    On the plane normal to the branch's old direction Newton may go back and forth between the two sides of a corner.  A fixed
    parameter favours none.
    """
    direction = np.sign(now.iterate.parameter - before.iterate.parameter) or solver.sweep.direction
    for share in 2.0 ** -np.arange(6):
        there = now.iterate.parameter + direction * share * steps.ds_min * solver.sweep.scale
        found, selected = solver.solve_near(now.iterate.at(there), now)
        if found.failure is None and solver.distance(now, found.iterate) <= steps.ds_max:
            return found, selected
    return None


def beyond_sharp_corner(solver: PointSolver, before: PointState, now: PointState, steps: ArcLength) -> Found | None:
    """Return a point beyond a corner at which the branch turns by more than 90 degrees; None if there is none.  Collective.

    Beyond the corner another set of samples slips: the direction in which the linearisation there goes on is that of the
    branch, one way or the other.  What lies back on the way that led here is not wanted.
    """
    d_U, d_nu, length = difference(solver, before, now, now.size)
    normal = d_U / (now.size * length), d_nu / length
    come_from = tangent(solver, now, now.iterate, *normal)
    for ds in steps.ds_min * CORNERS:
        ahead = solver.beside(now.iterate, ds / length * d_U, ds / length * d_nu)
        t_xi, t_nu = tangent(solver, now, ahead, *normal)
        for way in (-ds, ds):
            guess = along(solver, now, way, t_xi, t_nu)
            plane = Plane(guess, np.sign(way) * t_xi, tuple(np.sign(way) * t_nu))
            found, selected = solver.solve(guess, plane, now.size, now.selected, now.force)
            if found.failure or not NEAREST * ds <= solver.distance(now, found.iterate) <= FARTHEST * ds:
                continue
            if solver.turn(along(solver, now, -ds, *come_from), now.iterate, found.iterate, now.size) < np.pi - BACK:
                return found, selected
    return None


def patiently_ahead(
    solver: PointSolver, earlier: PointState | None, before: PointState, now: PointState, steps: ArcLength
) -> Found | None:
    """Return a point ahead, found by many small Newton steps, the farthest first; None if there is none.  Collective."""
    patient = replace(solver, is_patient=True)
    for ds in steps.ds * TENTHS:
        guess, plane = predict(patient, earlier, before, now, ds)
        found, selected = patient.solve(guess, plane, now.size, now.selected, now.force)
        if found.failure is None and not left(solver, before, now, found, ds):
            return found, selected
    return None


def tangent(
    solver: PointSolver, now: PointState, there: Iterate, n_U: np.ndarray, n_nu: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit tangent of the linearisation at ``there``, on the side of the normal (n_U, n_nu).  Collective."""
    rows = Plane(there, n_U, tuple(n_nu)), *solver.problem.constraints
    system = BorderedSystem(solver.problem, rows, solver.scaling(now.size, now.force), now.selected)
    t_xi, t_nu = solver.workspace.corrector(solver.equation, solver.resolution).tangent(system, there)
    size = solver.length(t_xi, t_nu)
    if not np.isfinite(size) or size == 0.0:  # the linearisation is singular there: nowhere to go
        return np.zeros_like(t_xi), np.zeros_like(t_nu)
    return t_xi / size, t_nu / size


def along(solver: PointSolver, now: PointState, ds: float, t_xi: np.ndarray, t_nu: np.ndarray) -> Iterate:
    """Return the place a step ``ds`` along a tangent.  Local."""
    return solver.beside(now.iterate, ds * now.size * t_xi, ds * t_nu)
