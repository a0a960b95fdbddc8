"""Follow one branch through a range by arc length: a single step, and the whole branch (docs/theory.md, section 7)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..messages.errors import ConvergenceError
from ..points.branch import NOTHING, Branch, Point
from .acceptance import Accepted, accept
from .checkpointer import NO_CHECKPOINTS, Checkpointer, Restored
from .closed_curve import goes_round
from .iterate import Iterate, PointState, interpolate, parabola
from .point_record import Unbalanced
from .point_solver import PointSolver, Solution, Workspace
from .state import BranchState
from .stepping import message, second, step
from .steps import ArcLength
from .task import Advanced, BranchTask
from .ways_out import MOSTLY, Stuck, WayOn, regularised, ways_on
from .widen import widened

HELD_HERE = 0.02  # of the usual step: the first one with the mean slip held, from a point that has the same motion with it held
HELD_BEFORE = 0.25  # the same from another point
FINEST_WAY = 1e-2  # of the distance from a point to a requested value: the smallest intermediate step
Emit = Callable[[Point], None]


@dataclass(frozen=True, eq=False)
class Leg:
    """A part of a branch, from its last point."""

    task: BranchTask
    state: BranchState
    now: PointState  # the last point
    emit: Emit = lambda point: None  # is called with each point


def advance(task: BranchTask, state: BranchState, on_point: Emit = lambda point: None) -> Advanced:
    """Advance a branch by one step: to its first point, its second point, or by a further step.  Collective.

    Divergence raises nothing: the points so far remain, and ``failure`` has the reason.
    ``on_point`` is called with each point as it comes.
    """
    points: list[Point] = []

    def emit(point: Point) -> None:
        points.append(point)
        on_point(point)

    take = onward if state.before else to_second if state.now else to_first
    workspace, failure = state.solver.workspace, None
    before = workspace.spent
    try:
        state = take(task, state, emit)
    except ConvergenceError as problem:
        state, failure = replace(state, is_done=True), str(problem)
    return Advanced(state, points, failure, workspace.spent - before)


def to_first(task: BranchTask, state: BranchState, emit: Emit) -> BranchState:
    """Solve the first point.  Collective."""
    after = first_point(task, state, requested=task.sweep.start in task.sweep.at)
    emit(after.point)
    return replace(after.state, now=after.now, is_done=task.problem.is_constant)


def first_point(task: BranchTask, state: BranchState, requested: bool) -> Accepted:
    """Return the first point, from the linear response or by one of the ways out.  Collective.

    Raises
    ------
    ConvergenceError : none leads there; on every rank
    """
    solver, solution = state.solver, state.solver.first()
    ways = (
        iter((WayOn(solver, solution),))
        if solution[0].failure is None
        else ways_on(Stuck("first", solver, task.steps, task.may_hold, task=task, advance=advance))
    )
    for on in ways:
        return accept(task, replace(state, solver=on.solver), on.solution, requested=requested, notes=on.notes)
    raise ConvergenceError(task.problem.without_solution(task.sweep.start, str(solution[0].failure)))


def to_second(task: BranchTask, state: BranchState, emit: Emit) -> BranchState:
    """Solve the second point, and requested points before it.  Collective."""
    assert state.now is not None
    before = state.now
    stepped = second(state.solver, state.solver.carried(before), task.steps)
    solution, ds, notes = stepped.solution, stepped.ds, stepped.notes
    was, after = state.solver, _arrive(Leg(task, state, before, emit), solution, notes)
    if after.state.solver.resolution != was.resolution:
        before = after.state.solver.solved_again(before)
    return after.state.after(before, after.now, ds)


def onward(task: BranchTask, state: BranchState, emit: Emit) -> BranchState:
    """Take a step along the branch; solve requested points on the way, and the end of the range when it is passed.

    Collective.

    Raises
    ------
    ConvergenceError : no step converges; on every rank
    """
    assert state.before is not None and state.now is not None
    was, now, sweep = state.solver, state.solver.carried(state.now), task.sweep
    leg = Leg(task, state, now, emit)
    stepped = step(was, state.earlier, state.before, now, state.ds, task.steps, task.may_hold)
    if stepped.solved is None:
        there = with_other_mean(stepped.solver, now, task.steps.ds_min)
        ds = (HELD_BEFORE if there is None else HELD_HERE) * task.steps.ds
        return replace(state, solver=stepped.solver, now=there or now, ds=ds)
    solution, ds, notes = stepped.solution, stepped.ds, stepped.notes
    if sweep.before(solution[0].iterate.parameter):
        _to_limit(leg, solution, sweep.start)
        where = task.problem.where(sweep.start)
        raise ConvergenceError(f"hb: a fold leads the branch back out of the range at its start, {where}; begin further off")
    if sweep.beyond(solution[0].iterate.parameter):
        end = _to_limit(leg, solution, sweep.stop, notes)
        return replace(end.state, before=now, now=end.now, is_done=True)
    try:
        after = _arrive(leg, solution, notes)
    except Unbalanced:
        beyond = _begun_beyond(leg)
        if beyond is None:
            raise
        return beyond
    ds = next_step(task, after.state, ds, solution[0].newton, (state.before, now, after.now))
    if after.state.solver.equation.held is not None and after.now.sliding < MOSTLY:
        after = released(after, task.steps)
    elif task.may_hold and (held := regularised(after.state.solver, after.now.sliding, MOSTLY)):
        after = replace(after, state=replace(after.state, solver=held))
    if after.state.solver.resolution == was.resolution:
        return after.state.after(now, after.now, ds, earlier=state.before)
    return after.state.after(after.state.solver.solved_again(now), after.now, ds)


def _begun_beyond(leg: Leg) -> BranchState | None:
    """Return the state at a first point beyond an unbounded resonance; None if there is none.  Collective."""
    state, solver = leg.state, leg.state.solver
    assert state.before is not None
    for on in ways_on(Stuck("unbalanced", solver, leg.task.steps, before=solver.carried(state.before), now=leg.now)):
        try:
            after = accept(leg.task, state, on.solution, notes=on.notes)
        except Unbalanced:  # still too near
            continue
        leg.emit(after.point)
        return after.state.after(None, after.now, 0.0)
    return None


def released(after: Accepted, steps: ArcLength) -> Accepted:
    """Return a point with the mean slip released; still regularised if Newton's method fails without.  Collective."""
    solver = after.state.solver.holding(None)
    free = with_other_mean(solver, after.now, steps.ds_max)
    return after if free is None else replace(after, state=replace(after.state, solver=solver), now=free)


def with_other_mean(solver: PointSolver, now: PointState, farthest: float) -> PointState | None:
    """Return a point as the solver has it, whose mean slip is released or held; None where Newton's method fails.  Collective.

    It is solved for from the mean of the linear motion, from which slip may have let it drift, then from its own; a solution
    beyond a distance ``farthest`` is another one.
    """
    at_rest, mean = now.iterate.U.copy(), solver.harmonics.mean
    at_rest[..., mean] = solver.on_curve(now.iterate.parameter).U[..., mean]
    for guess in (replace(now.iterate, U=at_rest), now.iterate):
        solution, selected = solver.solve_near(guess, now)
        if solution.failure is None and solver.distance(now, solution.iterate) <= farthest:
            return replace(now, iterate=solution.iterate, selected=selected)
    return None


def next_step(
    task: BranchTask, state: BranchState, ds: float, newton: int, last: tuple[PointState, PointState, PointState]
) -> float:
    """Return the length of the next step: from the turn between the last ones, or from the accuracy of straight lines."""
    (before, now, after), solver = last, state.solver
    turn = solver.turn(before.iterate, now.iterate, after.iterate, now.size)
    if task.accuracy is None or not task.accuracy.chooses_steps:
        return task.steps.next(ds, newton, turn)
    steps = solver.distance(before, now.iterate), solver.distance(now, after.iterate)
    stretch = solver.comm.bcast(task.accuracy.stretch([point.amplitude for point in last], steps, state.memory))
    return task.steps.stretched(ds, newton, turn, stretch)


def _arrive(leg: Leg, solution: Solution, notes: tuple[str, ...] = ()) -> Accepted:
    """Accept a new point, after requested points between the last one and it.  Collective."""
    was = leg.state.solver
    state, missed = _requested(leg, solution, solution[0].iterate.parameter)
    solution, solver = state.solver.still(solution, was)
    is_requested = solution[0].iterate.parameter in leg.task.sweep.at
    after = accept(leg.task, replace(state, solver=solver), solution, requested=is_requested, notes=(*notes, *missed))
    leg.emit(after.point)
    return after


def _to_limit(leg: Leg, solution: Solution, limit: float, notes: tuple[str, ...] = ()) -> Accepted:
    """Solve at the end of the range that a step has passed, after requested points before it.  Collective."""
    there = interpolate(leg.now.iterate, solution[0].iterate, limit)
    state, missed = _requested(leg, solution, limit)
    end = solved(replace(leg, state=state), there, solution, requested=limit in leg.task.sweep.at, notes=(*notes, *missed))
    leg.emit(end.point)
    return end


def _requested(leg: Leg, beyond: Solution, end: float) -> tuple[BranchState, tuple[str, ...]]:
    """Solve at the requested values between the last point and ``end``, which is not further than the solution ``beyond``.

    Collective.  Returns the state after them, and notes.
    """
    missed: list[str] = []
    for value in leg.task.sweep.requested_between(leg.now.iterate.parameter, end):
        harmonics, there = leg.state.solver.harmonics, beyond[0].iterate
        before = None if leg.state.before is None else leg.state.before.iterate
        between = parabola(before, leg.now.iterate.on(harmonics), there.on(harmonics), value)
        try:
            solution = solved(leg, between, beyond, requested=True)
        except ConvergenceError:
            if not leg.task.sweep.may_miss:
                raise
            missed.append(f"no point before this one at the requested value {value:g}: Newton's method fails there")
            continue
        leg.emit(solution.point)
        leg = replace(leg, state=solution.state)
    return leg.state, tuple(missed)


def solved(leg: Leg, guess: Iterate, beyond: Solution, requested: bool, notes: tuple[str, ...] = ()) -> Accepted:
    """Solve at the parameter of a guess between the last point and the solution ``beyond`` it.  Collective.

    Where Newton's method fails from the guess, through intermediate points.
    """
    solver, selected = leg.state.solver, leg.now.selected | beyond[1]
    now, guess = solver.carried(leg.now), guess.on(solver.harmonics)
    solution = solver.solve_near(guess, now, selected)
    if solution[0].failure:
        solution = approach(solver, now, guess, beyond[0].iterate.on(solver.harmonics), selected, leg.task.steps)
    return accept(leg.task, leg.state, solution, requested=requested, notes=notes)


def approach(
    solver: PointSolver, now: PointState, goal: Iterate, beyond: Iterate, selected: np.ndarray, steps: ArcLength
) -> Solution:
    """Solve at the parameter of ``goal`` in steps of the parameter from the last point, or from the point beyond.  Collective.

    Where neither leads there, as where the curve has a corner, by many small Newton steps from the goal.

    Raises
    ------
    ConvergenceError : from neither; on every rank
    """
    solution, here = _stepped_to(goal, now.iterate, solver, now, selected)
    if solution[0].failure is not None and beyond.parameter != goal.parameter:
        solution, _ = _stepped_to(goal, beyond, solver, now, selected)
    if solution[0].failure is not None:
        solution = replace(solver, is_patient=True).solve_near(goal, now, selected)
    if solution[0].failure is not None:
        raise ConvergenceError(message(solver, here.parameter, solution[0], steps))
    return solution


def _stepped_to(
    goal: Iterate, start: Iterate, solver: PointSolver, now: PointState, selected: np.ndarray
) -> tuple[Solution, Iterate]:
    """Solve at the parameter of ``goal`` in steps from ``start``, halved until Newton converges.

    Collective.  Returns the last solution, also one that failed, and the place before it.
    """
    here, towards, way = start, goal, 0.5 * (goal.parameter - start.parameter)
    while True:
        is_last = abs(goal.parameter - here.parameter) <= 1.001 * abs(way)
        there = goal.parameter if is_last else here.parameter + way
        solution, used = solver.solve_near(interpolate(here, towards, there), now, selected)
        if solution.failure is None and is_last:
            return (solution, used), here
        if solution.failure is None:
            here, towards, selected = solution.iterate, interpolate(here, solution.iterate, goal.parameter), used
            continue
        way /= 2.0
        if abs(way) < FINEST_WAY * abs(goal.parameter - start.parameter):
            return (solution, used), here


def _wider(task: BranchTask, checkpointer: Checkpointer, workspace: Workspace) -> Restored | None:
    """Return the state and the points of a narrower range, saved as those of this range.  Collective."""
    shorter = checkpointer.narrower(task, workspace)
    begun = None if shorter is None else widened(task, shorter, workspace, _to_the_end)
    if begun is not None:
        checkpointer.save(task, *begun)
    return begun


def _to_the_end(task: BranchTask, state: BranchState) -> list[Point] | None:
    """Return the points from a state to the end of the range; None if the branch ends before.  Collective."""
    points: list[Point] = []
    while not state.is_done:
        solution = advance(task, state, points.append)
        state = solution.state
        if solution.failure is not None:
            return None
    return points


def follow_branch(
    task: BranchTask,
    max_points: int,
    on_point: Emit = lambda point: None,
    segment: int = 0,
    checkpointer: Checkpointer = NO_CHECKPOINTS,
    until: Callable[[Point], bool] = lambda point: False,
) -> Branch:
    """Follow a branch to the end of its range, or ``until`` a point, from its last checkpoint if there is one.  Collective.

    A branch that cannot be continued has its points and the reason in ``failure``; no error is raised.  ``on_point`` gets the
    points of a step when the ``checkpointer`` has saved or postponed them.
    ``max_points`` bounds a branch that never reaches the end of the range.
    """
    branch = Branch(task.problem.at(task.problem.curve.at(task.sweep.start).parameters).level)
    workspace = task.workspace()
    since: list[Point] = []  # the last step

    def take(point: Point) -> None:
        on_point(point)
        branch.points.append(point if workspace.comm.rank == 0 else replace(point, U=NOTHING, p=NOTHING))

    def record(point: Point) -> None:
        if len(branch.points) + len(since) < max_points:
            since.append(replace(point, segment=segment))

    try:
        state, before = (
            checkpointer.restored(task, workspace) or _wider(task, checkpointer, workspace) or (task.start(workspace), [])
        )
        for point in before:
            take(point)
        is_reached = bool(before) and until(before[-1])
        while not (state.is_done or is_reached) and branch.failure is None:
            solution = advance(task, state, record)
            state, branch.failure = solution.state, solution.failure
            if len(branch.points) + len(since) == max_points:
                where = task.problem.where(task.sweep.stop)
                branch.failure = f"{max_points} points without reaching {where}: raise [response] points"
            checkpointer.save(task, None if solution.failure else state, since)
            is_reached = any(map(until, since))
            for point in since:
                take(point)
            since.clear()
            if branch.failure is None and workspace.comm.bcast(goes_round(branch.points) if workspace.comm.rank == 0 else None):
                where = task.problem.where((branch.points[-1].parameters or (branch.points[-1].omega,))[0])
                branch.failure = f"goes round a closed curve about {where}, to which a long step has led: raise [response] points"
    except BaseException:  # a signal, or a problem of one rank alone
        checkpointer.flush()
        raise
    finally:
        workspace.destroy()
        if task.estimator is not None:
            task.estimator.destroy()
    return with_facts(branch, task, state)


def with_facts(branch: Branch, task: BranchTask, state: BranchState) -> Branch:
    """Return a branch that ended at a state with the data common to all its points.  Local."""
    branch.is_linear, branch.solver, accuracy = state.solver.is_linear, state.solver.workspace.solver, task.accuracy
    if accuracy is not None and "solver" not in accuracy.keeps:
        branch.closes_to = max(branch.closes_to, accuracy.target)
    branch.odd = accuracy is not None and not branch.is_linear and all(n % 2 for n in accuracy.coarsest.harmonics.chosen)
    return branch
