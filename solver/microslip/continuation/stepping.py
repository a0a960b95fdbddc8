"""Steps from point to point of a branch by arc length, also past corners (docs/theory.md, section 7)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from ..messages.errors import ConvergenceError
from ..messages.words import counted
from .corrector import Correction
from .iterate import PointState
from .point_solver import PointSolver, Solution
from .predictor import linear_step, predict, requested_ahead
from .resonances import PASSED, passed_over, stay_stuck
from .steps import ArcLength
from .ways_out import Stuck, across_the_corner, left, ways_on

SHORT = 0.1  # of the usual step: a shorter one that fails after others have succeeded meets a corner


class Stepped(NamedTuple):
    """A step: its solution and the solver of the next one, its length, and notes on it.

    Without a solution the step is to be tried again, with this solver.
    """

    solver: PointSolver
    solved: Solution | None
    ds: float
    notes: tuple[str, ...] = ()

    @property
    def solution(self) -> Solution:
        """The solution, of a step that has one."""
        assert self.solved is not None
        return self.solved


def second(solver: PointSolver, first: PointState, steps: ArcLength) -> Stepped:
    """Solve the second point, a little further along the sweep; halve the way until it converges nearby.  Collective.

    A point farther than ``ds_max`` may be beyond folds, with the resonance between them, or beyond a resonance.  It is accepted
    only if none is nearer: where the set B has changed since the first point, and the solution with it.
    """
    sweep, far = solver.sweep, None  # the first that converged, and its notes
    way = min(linear_step(solver, first, 0.5 * steps.ds), 0.5 * sweep.scale)
    while True:
        there = first.iterate.parameter + sweep.direction * way
        guess = solver.on_curve(there) if first.sticks else first.iterate.at(there)
        solution, selected = solver.solve_near(guess, first)
        if solution.failure is None:
            is_passed = passed_over(solver, first, solution.iterate) is not None
            if solver.distance(first, solution.iterate) <= steps.ds_max and not is_passed:
                return Stepped(solver, (solution, selected), steps.ds)
            far = far or Stepped(solver, (solution, selected), steps.ds, (PASSED,) if is_passed else ())
        way /= 2.0
        if way < steps.ds_min * sweep.scale:
            if far:
                return far
            raise ConvergenceError(message(solver, first.iterate.parameter, solution, steps))


def step(
    solver: PointSolver,
    earlier: PointState | None,
    before: PointState,
    now: PointState,
    ds: float,
    steps: ArcLength,
    may_hold: bool = False,
) -> Stepped:
    """Return the next converged point and the step that reached it, shortened until Newton converges and no resonance is passed.

    Collective.  A maximum is solved for at the next requested value first, if one lies within the step.  If even the
    shortest step passes a resonance, or none converges to it, the step has a note.  If no step converges, ways out are tried.

    Raises
    ------
    ConvergenceError : no step and no way out converges; on every rank
    """
    earlier, before, now = earlier and solver.carried(earlier), solver.carried(before), solver.carried(now)
    stuck, passing = Stuck("ahead", solver, steps, may_hold, earlier=earlier, before=before, now=now), None
    is_maximum, requested = solver.problem.maximum is not None, requested_ahead(solver, earlier, before, now, ds)
    is_short = ds < SHORT * steps.ds and not is_maximum
    if requested is not None:
        solution, selected = solver.solve_near(requested, now)
        if solution.failure is None and not left(solver, before, now, solution.iterate, max(ds, steps.ds), may_turn=True):
            return Stepped(solver, (solution, selected), ds)
    while True:
        guess, plane = predict(solver, earlier, before, now, ds)
        solution, selected = solver.solve(guess, plane, now.size, now.selected, now.force)
        there, reach = solution.iterate, max(ds, steps.ds) if is_maximum else ds  # a maximum may move along a flat top
        leads_on = solution.failure is None and (
            not left(solver, before, now, there, reach, may_turn=is_maximum or passing is not None)
            or stay_stuck(solver, now, there)
        )
        share = passed_over(solver, now, there) if leads_on else None
        if leads_on and share is None:
            return Stepped(solver, (solution, selected), ds)
        if share is not None:
            passing = Stepped(solver, (solution, selected), ds, (PASSED,))  # accepted if no shorter one converges
        if is_short and share is None:
            for on in across_the_corner(stuck):
                return Stepped(on.solver, on.solved, on.ds or ds)
            is_short = False
        ds *= share or 0.5
        if ds < steps.ds_min and passing is not None:
            return passing
        if not leads_on and ds >= steps.ds_min and now.sliding == 1.0 and solver.equation.held is None and solver.is_loose:
            stuck = replace(stuck, where="sliding")
        if ds < steps.ds_min or stuck.where == "sliding":
            for on in ways_on(stuck):
                return Stepped(on.solver, on.solved, on.ds or 8.0 * steps.ds_min, on.notes)
            raise ConvergenceError(message(solver, now.iterate.parameter, solution, steps))


def message(solver: PointSolver, parameter: float, solution: Correction, steps: ArcLength) -> str:
    """Return the message of a branch that ends early."""
    advice = "reduce ds_min or ds, or the level" if solver.problem.maximum is None else "the peak is followed no further"
    return (
        f"hb: no convergence beyond {solver.problem.where(parameter)} after {counted(solution.newton, 'iteration')}: "
        f"{solution.failure or 'the branch turns back'}; the step was halved down to [continuation] "
        f"ds_min = {steps.ds_min:.1e}: {advice}"
    )
