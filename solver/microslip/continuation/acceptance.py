"""Accept a solution as a point of the branch: record, error bar, and solves with finer resolution where needed."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..contact.law import STICK
from ..error_estimate.correction import FAR as FAR_AWAY
from ..error_estimate.correction import parts_of_corrected
from ..error_estimate.estimate import ErrorEstimator, extended
from ..fourier.harmonics import Harmonics
from ..messages.errors import ConvergenceError
from ..points.branch import Point
from ..points.error_parts import PARTS, total
from .accuracy import Accuracy, Memory, Resolution
from .constraint_rows import Plane
from .corrector import Correction
from .iterate import PointState
from .point_record import FAR, Unbalanced, point_record, with_sensitivities, with_stability
from .point_solver import PointSolver, Solution, Workspace
from .state import BranchState
from .task import BranchTask

if TYPE_CHECKING:
    from mpi4py import MPI

MISSED = (
    "accuracy not met: more harmonics or samples than the program uses or the scene states, "
    "no convergence with them, or error bars that they do not reduce"
)
UNBALANCED = 5e-6  # of the forces, beyond which a point is rejected, at a tolerance of 1e-8
SHARPER = 1e-2  # of its tolerance, for a second solve of a point whose work or forces do not balance
SHARPEST = 1e-13  # tolerance below which the residual is rounding


@dataclass(frozen=True, eq=False)
class Accepted:
    """An accepted point: its record, its data for the next step, and the state with the resolution of the next point."""

    state: BranchState
    now: PointState
    point: Point


class Resolved(NamedTuple):
    """A solution of sufficient resolution, and its record."""

    solution: Solution
    solver: PointSolver
    point: Point
    moves: np.ndarray  # (n_pairs,) bool, pairs with p != 0
    ratios: dict[str, float]  # errors over those that the accuracy allows
    memory: Memory


def accept(
    task: BranchTask,
    state: BranchState,
    solution: Solution,
    *,
    requested: bool = False,
    on_the_way: bool = False,
    notes: tuple[str, ...] = (),
) -> Accepted:
    """Evaluate all pairs at a converged point, record it and choose B of the next one.  Collective.

    A point ``on_the_way`` to a requested one has no error bar and does not change harmonics and samples.

    Raises
    ------
    Unbalanced : rounding errors exceed the balance of a solution; on every rank
    """
    estimator = None if on_the_way else task.estimator
    solution, solver, point, moves, ratios, memory = resolved(task.accuracy, state, solution, requested, estimator)
    if task.has_stability and not on_the_way:
        point = with_stability(solver.problem, solution[0].iterate, point, estimator)
    if task.has_sensitivities and not on_the_way:
        known, adjoints = estimator.last if estimator else None, solver.workspace.adjoints(solver.equation)
        point = with_sensitivities(solver.problem, solution, point, adjoints, known)
    recorded = at_corner(solver, solution, point, estimator)
    if estimator is not None and task.accuracy is None:  # which solves it with more harmonics itself
        recorded = with_nearby_solution(solver, solution, recorded, estimator)
    missed = (MISSED,) if max(ratios.values(), default=0.0) > 1.0 else ()
    force, is_linear = force_at(solver, solution[0], point), solver.is_linear and solution[0].is_linear
    next_one = replace(solver.resolution, tolerance=max(solver.tolerance, task.tolerance))
    if task.accuracy:
        next_one, memory = task.accuracy.coarser(next_one, ratios, memory)
    solution, solver = solver.resolved(next_one).still(solution, solver)
    recorded = replace(recorded, seconds=solver.workspace.lap(), notes=(*recorded.notes, *missed, *notes))
    U = solution[0].iterate.U
    now = PointState(
        iterate=solution[0].iterate,
        selected=solver.selection.update(moves, point.state, point.energy),
        size=solver.norm(U),
        force=force,
        sticks=not moves.any(),
        sliding=float((point.state != STICK).mean()),
        moved=float(point.p.any(axis=(1, 2)).mean()),
        amplitude=point.response[:, 1] - 1j * point.response[:, 2],
    )
    return Accepted(replace(state, solver=replace(solver, is_linear=is_linear), memory=memory), now, recorded)


def resolved(
    accuracy: Accuracy | None, state: BranchState, solution: Solution, requested: bool, estimator: ErrorEstimator | None
) -> Resolved:
    """Solve a point again, more finely, until work and forces balance and the accuracy is met or out of reach.  Collective.

    Raises Unbalanced as :func:`accept`.
    """
    solver, memory = state.solver, state.memory
    while True:
        try:
            point, moves = point_record(solver.problem, solver.selection, solution, requested, estimator)
            check_forces(solver, solution[0], point)
        except Unbalanced:  # the cause may be its residual alone
            tighter, memory = accuracy.tighter(solver.resolution, memory) if accuracy else (None, memory)
            tighter = tighter or replace(solver.resolution, tolerance=SHARPER * solver.tolerance)
            better = solve_sharper(solver, tighter, solution, requested) if tighter.tolerance >= SHARPEST else None
            if not better:
                raise
            solution, solver = better
            continue
        ratios, memory = judged(solver.comm, accuracy, memory, point)
        finer, memory = accuracy.finer(solver.resolution, ratios, memory) if accuracy else (None, memory)
        better = solve_with(solver, finer, solution, force_at(solver, solution[0], point)) if finer else None
        if not better:
            return Resolved(solution, solver, point, moves, ratios, memory.after_raising() if finer else memory)
        solution, solver = better


def at_corner(solver: PointSolver, solution: Solution, point: Point, estimator: ErrorEstimator | None) -> Point:
    """Return the record of the corner above a point that is a maximum by the phase; else that of the point.  Collective."""
    top = solver.at_corner(solution)
    if top is not solution:
        with suppress(Unbalanced):
            return point_record(solver.problem, solver.selection, top, point.requested, estimator)[0]
    return point


def with_nearby_solution(solver: PointSolver, solution: Solution, point: Point, estimator: ErrorEstimator) -> Point:
    """Return the record of a point, with errors by a solution with more harmonics if the bar has detected none near it.

    Collective.  docs/theory.md, section 11.  Newton's method starts from the point and from the linear response; unchanged if
    neither leads to a solution near the point.  Workspace and estimator are its own: the rest of the branch does not change.
    """
    if not solver.comm.bcast(FAR in point.notes) or solver.equation.held is not None or solver.problem.constraints:
        return point
    (there, selected), finer = solution, solver.resolution.with_highest(extended(solver.harmonics).highest)
    bars, workspace = ErrorEstimator(estimator.enriched), Workspace(solver.resolved(finer).equation, has_bars=True)
    solver, linear = replace(solver, workspace=workspace), replace(there, iterate=solver.on_curve(there.iterate.parameter))
    try:
        for start in (there, linear):
            with suppress(ConvergenceError):
                if better := solve_with(solver, finer, (start, selected)):
                    more, _ = point_record(better[1].problem, solver.selection, better[0], point.requested, bars)
                    if near := with_errors_by(solver.comm, more, point):
                        return near
    finally:
        bars.destroy()
        workspace.destroy()
    return point


def with_errors_by(comm: MPI.Comm, more: Point, point: Point) -> Point | None:
    """Return the record of a noted point with errors by that of a solution with ``more`` harmonics; None if that is not near.

    Collective: a broadcast.  Near: amplitudes that differ by at most a fifth of the largest, at a solution without this note.
    """
    change = np.hypot(*(more.response[:, 1:3] - point.response[:, 1:3]).T)
    error = more.error + change[:, None] * (np.array(PARTS) == "harmonics")
    is_far = FAR in more.notes or change.max() > FAR_AWAY * np.hypot(*point.response[:, 1:3].T).max()
    is_longer = (total(error) > total(np.asarray(point.error))).any()
    if comm.bcast(bool(is_far or is_longer)):
        return None
    known = {name: getattr(more, name) for name in ("newton", "krylov", "corrected", "error_corrected")}
    return replace(point, error=error, notes=tuple(note for note in point.notes if note != FAR), **known)


def solve_with(
    solver: PointSolver, finer: Resolution, solution: Solution, force: float | None = None
) -> tuple[Solution, PointSolver] | None:
    """Solve a point of contact forces ``force`` [N] with another resolution; None if Newton fails.  Collective."""
    better = solver.resolved(finer)
    guess = solution[0].iterate.on(better.harmonics)
    solved, used = better.solve_at(guess, better.norm(guess.U), solution[1], force)
    return None if solved.failure else ((solved.with_effort_of(solution[0]), used), better)


def solve_sharper(
    solver: PointSolver, sharper: Resolution, solution: Solution, requested: bool
) -> tuple[Solution, PointSolver] | None:
    """Solve a point again with a smaller tolerance; None where Newton fails.  Collective.

    Near a resonance that neither damping nor friction limits the equations are nearly singular at a fixed frequency.  A frequency
    that is neither ``requested`` nor an end of the range may change; the amplitude is fixed instead.
    """
    better, there = solver.resolved(sharper), solution[0].iterate
    size, along = better.norm(there.U), np.array(there.U)
    along[..., better.harmonics.mean] = 0.0
    if not requested and size > 0.0 and there.parameter not in (solver.sweep.start, solver.sweep.stop):
        solved, used = better.solve(there, Plane(there, along / size, (0.0,) * len(there.parameters)), size, solution[1])
        if solved.failure is None:
            return (solved.with_effort_of(solution[0]), used), better
    return solve_with(solver, sharper, solution)


def judged(
    comm: MPI.Comm, accuracy: Accuracy | None, memory: Memory, point: Point, outputs: slice = slice(None)
) -> tuple[dict[str, float], Memory]:
    """Return the errors of outputs at a point by harmonics, samples and tolerance, relative to the allowed ones.  Collective."""
    if accuracy is None or point.error is None:
        return {}, memory
    amplitudes, error = np.hypot(point.response[:, 1::2], point.response[:, 2::2]).max(axis=1), point.error
    if accuracy.is_corrected and point.error_corrected is not None:
        error = parts_of_corrected(error, point.error_corrected)
    return comm.bcast(accuracy.ratios(amplitudes[outputs], error[outputs], memory))


def check_forces(solver: PointSolver, solution: Correction, point: Point) -> None:
    """Raise Unbalanced where a motion has outgrown the forces so far that they have no digits left.  Collective."""
    equation, there = solver.equation, solution.iterate
    loads = abs(solver.problem.at(there.parameters).level) * float(np.linalg.norm(equation.model.f))
    forces, unbalanced = loads + force_at(solver, solution, point), solver.workspace.stiffest * solution.gap
    if unbalanced > max(UNBALANCED, 500.0 * solution.bound) * forces:
        raise Unbalanced(
            f"hb: at {solver.problem.where(there.parameter)} contact forces of {unbalanced:.1e} N are rounding errors of "
            f"a motion of {solver.norm(there.U):.1e} m, {unbalanced / forces:.1e} of all forces: a body held only by its "
            "joint, or a joint far too stiff? Hold the body, or lower the stiffness"
        )


def force_at(solver: PointSolver, solution: Correction, point: Point) -> float:
    """Return |f_nl| over all ranks [N] at a point on record.  Collective."""
    p = Harmonics.full(point.p.shape[-1]).carry(point.p[solver.equation.model.owned], solver.harmonics)
    return solver.force_of(solution.iterate.U, p)
