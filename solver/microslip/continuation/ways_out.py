"""Fallbacks where Newton's method fails: a list, tried in order (docs/theory.md, section 7).

A branch is stuck before its first point, after a point from which no step converges, or at a solution of rounding errors.  A way
out yields solutions, each with the solver of the next point, and a note that is recorded with the point.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..contact.law import STICK
from ..points.sweep import Sweep
from .constraint_rows import Plane
from .corrector import BorderedSystem
from .iterate import Iterate, PointState
from .point_solver import PointSolver, Solution
from .predictor import difference, predict
from .problems import DampingHomotopy, LevelHomotopy, Problem
from .resonances import PASSED, passed_over
from .state import BranchState
from .steps import ArcLength
from .task import Advance, BranchTask

HOMOTOPY_STEPS = ArcLength(ds=0.2, ds_min=2e-4, ds_max=1.0)  # along a homotopy
FROM_LEVEL, FROM_DAMPING = (1e-2, 1e-4), (1e-1, 1e-3)  # of the parameter at the end of a homotopy, where it begins
MOST_NEWTON = 1500  # iterations on one homotopy; successful ones need some hundreds
MOST_POINTS = 1000
CORNERS = 4.0 ** np.arange(1, 5)  # shortest steps beyond a sharp corner at which the branch is sought
USUAL = 1.0, 0.5, 1.5  # usual steps that lead across a corner too near for shorter ones
ACROSS = 0.25 * np.pi  # rad by which such a step turns at most
PATIENT = *0.1 ** np.arange(4), 0.5, 1.5, 0.25, 2.0  # of a step, at which the branch is sought by many small Newton steps
BACK = 0.05  # rad between a step and the reversed last step, below which the step goes back
FARTHEST = 4.0  # lengths of a requested step that it may have: on the plane normal to it, a turn of 75 degrees
NEAREST = 1e-3  # lengths of it below which the step is rejected
MOSTLY = 0.8  # share of the pairs that slip or are open, from which the mean slip is regularised, and below which it is released
MOVED = 0.5  # share of the pairs with p not zero, from which it is regularised where no step converges
OFF = 4.0 ** np.arange(5)  # times the distance of the last point from a resonance, at which a branch begins beyond it
BEYOND = "the motion grows without bound before this point, at a resonance that neither damping nor friction holds: begun again"

Where = Literal["first", "ahead", "sliding", "unbalanced"]


@dataclass(frozen=True, eq=False)
class Stuck:
    """Where a branch is stuck: before its first point, ahead of ``now``, there with all pairs sliding, or without digits."""

    where: Where
    solver: PointSolver
    steps: ArcLength
    may_hold: bool = True  # the mean slip, by springs
    task: BranchTask | None = None  # of a first point
    advance: Advance | None = None  # one step of a homotopy, itself a branch
    earlier: PointState | None = None  # the last points, none before the first
    before: PointState | None = None
    now: PointState | None = None

    @property
    def last_two(self) -> tuple[PointState, PointState]:
        """The last two points, of a branch that has them."""
        assert self.before is not None and self.now is not None
        return self.before, self.now

    @property
    def first(self) -> tuple[BranchTask, Advance]:
        """The task of a first point, and the function that continues homotopies."""
        assert self.task is not None and self.advance is not None
        return self.task, self.advance


@dataclass(frozen=True, eq=False)
class WayOn:
    """The result of a way out: a solution, or only a solver with which a shorter step is tried."""

    solver: PointSolver  # of the next point
    solved: Solution | None = None
    notes: tuple[str, ...] = ()
    ds: float | None = None  # length of the step to it; None: about the shortest

    @property
    def solution(self) -> Solution:
        """The solution, if the way has one."""
        assert self.solved is not None
        return self.solved


@dataclass(frozen=True)
class WayOut:
    """A way out of trouble."""

    where: Where
    attempt: Callable[[Stuck], Iterator[WayOn]]  # collective; yields its results, if any
    note: str = ""  # recorded with its point
    of_homotopies: bool = True  # whether it also serves the first points of homotopies
    of_maxima: bool = True  # whether it serves maxima, whose row has no tangent and a separate search


def ways_on(stuck: Stuck) -> Iterator[WayOn]:
    """Yield the results of the ways out, in their order, with their notes.  Collective."""
    is_homotopy, is_maximum = stuck.task is not None and stuck.task.is_homotopy, stuck.solver.problem.maximum is not None
    for way in WAYS_OUT:
        leads = (way.of_homotopies or not is_homotopy) and (way.of_maxima or not is_maximum)
        if way.where == stuck.where and leads:
            for on in way.attempt(stuck):
                yield replace(on, notes=(*on.notes, way.note)) if way.note else on


# -- to a first point ----------------------------------------------------------------------------------------------


def with_mean_slip_of_known(stuck: Stuck) -> Iterator[WayOn]:
    """Solve a maximum from a known motion in which most pairs slip, with its mean slip regularised.  Collective."""
    solver = stuck.solver
    known, every = solver.on_curve(solver.sweep.start), solver.equation.every_pair
    state = solver.equation_at(known).contact_forces(known.U, every, tangents=False).state
    sliding = float(np.mean(solver.equation.gather(state) != STICK))
    held = regularised(solver, sliding, MOSTLY) if solver.problem.maximum is not None and stuck.may_hold else None
    if held is not None and (solution := held.first())[0].failure is None:
        yield WayOn(held, solution)


def over_the_level(stuck: Stuck) -> Iterator[WayOn]:
    """Solve from a small level up, by arc length at the frequency of the first point, folds included.  Collective."""
    task, solver = stuck.first[0], stuck.solver
    at = task.problem.at(solver.on_curve(task.sweep.start).parameters)
    yield from _over(stuck, LevelHomotopy(solver.equation, at.omega), at.level, FROM_LEVEL)


def over_damping(stuck: Stuck) -> Iterator[WayOn]:
    """Solve from a damping that leaves one solution down to none in addition to the scene's.  Collective."""
    task, solver = stuck.first[0], stuck.solver
    at = task.problem.at(solver.on_curve(task.sweep.start).parameters)
    yield from _over(stuck, DampingHomotopy(solver.equation, at.omega, at.level), 1.0, FROM_DAMPING)


def from_rest(stuck: Stuck) -> Iterator[WayOn]:
    """Solve from no motion, where gaps are open.  Collective."""
    solver = stuck.solver
    linear = solver.on_curve(solver.sweep.start)
    selected = solver.selection.first(solver.equation.model.n_pairs)
    solution = solver.solve_at(replace(linear, U=np.zeros_like(linear.U)), solver.norm(linear.U), selected)
    if solution[0].failure is None:
        yield WayOn(solver, solution)


def with_mean_slip_regularised(stuck: Stuck) -> Iterator[WayOn]:
    """Solve with the mean slip regularised about zero, for a body that is supported by its joint alone.  Collective."""
    held = regularised(stuck.solver, 1.0, 0.0) if stuck.may_hold else None
    if held is None:
        return
    solution, with_springs = held.first(), replace(stuck, solver=held)
    if solution[0].failure is None:
        yield WayOn(held, solution)
    else:
        yield from over_the_level(with_springs)
        yield from over_damping(with_springs)


def patiently(stuck: Stuck) -> Iterator[WayOn]:
    """Solve by many small Newton steps, from the linear response and from rest.  Collective."""
    patient = replace(stuck.solver, is_patient=True)
    solution = patient.first()
    if solution[0].failure is None:
        yield WayOn(stuck.solver, solution)
    else:
        yield from (replace(on, solver=stuck.solver) for on in from_rest(replace(stuck, solver=patient)))


def _over(stuck: Stuck, homotopy: Problem, end: float, beginnings: tuple[float, ...]) -> Iterator[WayOn]:
    """Solve at the end of a homotopy, where it is the problem, from near its beginning.  Collective."""
    (task, advance), solver = stuck.first, stuck.solver
    plain = replace(task, estimator=None, accuracy=None, has_stability=False, has_sensitivities=False)
    plain = replace(plain, is_linear=False, is_homotopy=True)
    for share in beginnings:
        way = replace(plain, problem=homotopy, sweep=Sweep(share * end, end), steps=HOMOTOPY_STEPS, tolerance=solver.tolerance)
        arrived = _end_of(way, advance)
        if arrived is None or arrived.now is None:
            continue
        there, now = solver.holding(arrived.solver.equation.held), arrived.now
        guess = replace(solver.on_curve(task.sweep.start), U=now.iterate.U, harmonics=now.iterate.harmonics)
        solution = there.solve_near(guess, now)
        if solution[0].failure is None:
            yield WayOn(there, solution)


def _end_of(way: BranchTask, advance: Advance) -> BranchState | None:
    """Return the state at the end of a homotopy; None where it is not reached.  Collective."""
    workspace, n_points, newton = way.workspace(), 0, 0
    state = way.start(workspace)
    try:
        while not state.is_done and n_points < MOST_POINTS:
            step = advance(way, state)
            state, n_points, newton = step.state, n_points + len(step.points), newton + step.newton
            if step.failure or newton > MOST_NEWTON:
                return None
    finally:
        workspace.destroy()
    return state if state.is_done else None


# -- ahead of a point: corners, where a sample of a pair begins or ends to slip ------------------------------------


def across_the_corner(stuck: Stuck) -> Iterator[WayOn]:
    """Solve ahead with steps of usual length: where a corner is very near, shorter ones end at it.  Collective.

    A step that turns by more than 45 degrees is rejected: it leads to another part of the curve, or out of the range.
    """
    solver, (before, now) = stuck.solver, stuck.last_two
    for ds in stuck.steps.ds * np.array(USUAL):
        guess, plane = predict(solver, stuck.earlier, before, now, ds)
        solution = solver.solve(guess, plane, now.size, now.selected, now.force)
        there = solution[0].iterate
        if solution[0].failure is not None or left(solver, before, now, there, ds, most=ACROSS):
            continue
        if passed_over(solver, now, there) is None:
            yield WayOn(solver, solution, ds=ds)


def just_ahead(stuck: Stuck) -> Iterator[WayOn]:
    """Solve at a fixed parameter within the shortest step.  Collective.

    On the plane normal to the branch's old direction Newton may oscillate between the two sides of a corner; at a fixed parameter
    it does not.
    """
    solver, steps, (before, now) = stuck.solver, stuck.steps, stuck.last_two
    direction = np.sign(now.iterate.parameter - before.iterate.parameter) or solver.sweep.direction
    for share in 2.0 ** -np.arange(6):
        there = now.iterate.parameter + direction * share * steps.ds_min * solver.sweep.scale
        solution = solver.solve_near(now.iterate.at(there), now)
        if solution[0].failure is None and solver.distance(now, solution[0].iterate) <= steps.ds_max:
            yield WayOn(solver, solution)


def beyond_sharp_corner(stuck: Stuck) -> Iterator[WayOn]:
    """Solve beyond a corner at which the branch turns by more than 90 degrees.  Collective.

    Beyond the corner another set of samples slips: the tangent of the linearisation there, with either sign, is that of the
    branch.  Solutions back on the last step are rejected.
    """
    solver, (before, now) = stuck.solver, stuck.last_two
    d_U, d_nu, length = difference(solver, before, now, now.size)
    normal = d_U / (now.size * length), d_nu / length
    come_from = tangent(solver, now, now.iterate, *normal)
    for ds in stuck.steps.ds_min * CORNERS:
        ahead = solver.stepped(now.iterate, ds / length * d_U, ds / length * d_nu)
        t_xi, t_nu = tangent(solver, now, ahead, *normal)
        for way in (-ds, ds):
            guess = along(solver, now, way, t_xi, t_nu)
            plane = Plane(guess, np.sign(way) * t_xi, tuple(np.sign(way) * t_nu))
            solution = solver.solve(guess, plane, now.size, now.selected, now.force)
            there = solution[0].iterate
            if solution[0].failure or not NEAREST * ds <= solver.distance(now, there) <= FARTHEST * ds:
                continue
            if solver.turn(along(solver, now, -ds, *come_from), now.iterate, there, now.size) < np.pi - BACK:
                yield WayOn(solver, solution)


def patiently_ahead(stuck: Stuck) -> Iterator[WayOn]:
    """Solve ahead by many small Newton steps, where the mean slip is not regularised.  Collective.

    Near a corner of a joint much stiffer than its structure about one in four of these solves converges: several lengths.
    A point beyond a resonance that no point shows is accepted only if no shorter step converges, with a note.
    """
    solver, (before, now) = stuck.solver, stuck.last_two
    if solver.equation.held is None and solver.is_loose:
        return
    patient, passing = replace(solver, is_patient=True), []
    for ds in stuck.steps.ds * np.array(PATIENT):
        guess, plane = predict(patient, stuck.earlier, before, now, ds)
        solution = patient.solve(guess, plane, now.size, now.selected, now.force)
        if solution[0].failure is None and not left(solver, before, now, solution[0].iterate, ds):
            if passed_over(solver, now, solution[0].iterate) is None:
                yield WayOn(solver, solution)
            else:
                passing.append(WayOn(solver, solution, notes=(PASSED,)))
    yield from passing


def mean_slip_ahead(stuck: Stuck) -> Iterator[WayOn]:
    """Regularise the mean slip from the last point on, where most sliders have moved.  Collective."""
    now = stuck.last_two[1]
    held = regularised(stuck.solver, now.moved, 0.0 if now.sticks else MOVED) if stuck.may_hold else None
    if held is not None:
        yield WayOn(held)


def left(
    solver: PointSolver,
    before: PointState,
    now: PointState,
    there: Iterate,
    ds: float,
    may_turn: bool = False,
    most: float = 0.5 * np.pi,
) -> bool:
    """Return whether a step left the branch or fell back on it: by a turn of more than ``most`` [rad] or another length.

    A step that was shortened before a resonance ``may_turn`` away from the last chord if the parameter still advances.
    """
    here = now.iterate.parameter
    is_same_direction = (there.parameter - here) * (here - before.iterate.parameter) > 0.0
    turns = solver.turn(before.iterate, now.iterate, there, now.size) > most and not (may_turn and is_same_direction)
    return turns or not NEAREST * ds <= solver.distance(now, there) <= FARTHEST * ds


def tangent(
    solver: PointSolver, now: PointState, there: Iterate, n_U: np.ndarray, n_nu: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit tangent of the linearisation at ``there``, on the side of the normal (n_U, n_nu).  Collective."""
    rows = Plane(there, n_U, tuple(n_nu)), *solver.problem.constraints
    system = BorderedSystem(solver.problem, rows, solver.scaling(now.size, now.force), now.selected)
    t_xi, t_nu = solver.workspace.corrector(solver.equation, solver.resolution).tangent(system, there)
    size = solver.length(t_xi, t_nu)
    if not np.isfinite(size) or size == 0.0:  # the linearisation is singular there: no tangent
        return np.zeros_like(t_xi), np.zeros_like(t_nu)
    return t_xi / size, t_nu / size


def along(solver: PointSolver, now: PointState, ds: float, t_xi: np.ndarray, t_nu: np.ndarray) -> Iterate:
    """Return the place a step ``ds`` along a tangent.  Local."""
    return solver.stepped(now.iterate, ds * now.size * t_xi, ds * t_nu)


def regularised(solver: PointSolver, moving: float, least: float) -> PointSolver | None:
    """Return the solver with the mean slip regularised about the state of rest; None if it already is, or need not be.

    Collective.  ``moving`` is a share of the pairs, ``least`` its lower bound; only if a joint is the sole support of a body.
    """
    if solver.equation.held is not None or moving < least or not solver.is_loose:
        return None
    return solver.holding(np.zeros((solver.equation.n_owned, 2)))


# -- beyond a resonance that neither damping nor friction holds ----------------------------------------------------


def beyond_resonance(stuck: Stuck) -> Iterator[WayOn]:
    """Restart beyond the resonance towards which the last two points grow, from the linear response.  Collective.

    The new point is before the next requested value and before the end of the range.
    """
    solver, (before, now) = stuck.solver, stuck.last_two
    here, resonance = now.iterate.parameter, where_unbounded(solver, before, now)
    for there in [] if resonance is None else [float(resonance + off * (resonance - here)) for off in OFF]:
        if solver.sweep.beyond(there) or solver.sweep.requested_between(here, there):
            continue
        guess = solver.on_curve(there)
        solution = solver.solve_at(guess, solver.norm(guess.U), solver.selection.first(solver.equation.model.n_pairs))
        if solution[0].failure is None:
            yield WayOn(solver, solution)


def where_unbounded(solver: PointSolver, before: PointState, now: PointState) -> float | None:
    """Return where 1 / |U'| falls to 0 on the straight line through the last two points, docs/theory.md, eq. (7.5).

    Collective.  None where it does not, where the branch has turned back, or if the parameter is not a frequency.
    """
    a, b = (solver.norm(solver.vibration(state.iterate.U)) for state in (before, now))
    step = now.iterate.parameter - before.iterate.parameter
    is_frequency = "omega" in solver.problem.rates(now.iterate.parameters)[0]
    if not b > a > 0.0 or step * solver.sweep.direction <= 0.0 or not is_frequency:
        return None
    return now.iterate.parameter + step * a / (b - a)


FIRST = "first point {}, where there may be other solutions"
WAYS_OUT = (
    WayOut("first", with_mean_slip_of_known),
    WayOut("first", over_the_level, FIRST.format("reached over the level"), of_homotopies=False),
    WayOut("first", from_rest, FIRST.format("found from rest")),
    WayOut("first", with_mean_slip_regularised, of_homotopies=False),
    WayOut("first", patiently, FIRST.format("found by small Newton steps"), of_maxima=False),
    WayOut("first", over_damping, FIRST.format("reached over further damping"), of_homotopies=False),
    WayOut("ahead", across_the_corner, of_maxima=False),
    WayOut("ahead", just_ahead, of_maxima=False),
    WayOut("ahead", beyond_sharp_corner, of_maxima=False),
    WayOut("ahead", patiently_ahead, of_maxima=False),
    WayOut("ahead", mean_slip_ahead),
    WayOut("sliding", mean_slip_ahead),
    WayOut("unbalanced", beyond_resonance, BEYOND),
)
