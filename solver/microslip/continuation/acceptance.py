"""Take a solution for a point of the branch: recorded, judged by its error bar, solved again with more where that asks for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..contact.law import STICK
from ..fourier.harmonics import Harmonics
from ..parallel.errors import ConvergenceError
from ..points.branch import Point
from .accuracy import Accuracy, Memory, Resolution
from .corrector import Correction
from .iterate import PointState
from .point_record import point_record
from .point_solver import Found, PointSolver
from .state import BranchState
from .task import BranchTask

MISSED = "accuracy not met: more harmonics or samples than the program uses or the scene states, or no convergence with them"
UNBALANCED = 5e-6  # of the forces beyond which a point is not one, at a tolerance of 1e-8


@dataclass(frozen=True, eq=False)
class Accepted:
    """A point of the branch, on record and as the next step needs it, and the state with the resolution of the next one."""

    state: BranchState
    now: PointState
    point: Point


def accept(
    task: BranchTask,
    state: BranchState,
    found: Found,
    *,
    asked: bool = False,
    on_the_way: bool = False,
    notes: tuple[str, ...] = (),
) -> Accepted:
    """Evaluate all pairs at a converged point, record it and choose B of the next one.  Collective.

    A point ``on_the_way`` to one that counts has no error bar, and leaves harmonics and samples as they are.

    Raises
    ------
    ConvergenceError : the solution is none, for want of digits; on every rank
    """
    solver, memory, accuracy = state.solver, state.memory, task.accuracy
    estimator = None if on_the_way else task.estimator
    while True:
        try:
            point, moves = point_record(solver.problem, solver.selection, found, asked, estimator)
            check_forces(solver, found[0], point)
        except ConvergenceError:  # its residual alone may be to blame
            tighter, memory = accuracy.tighter(solver.resolution, memory) if accuracy else (None, memory)
            better = tighter and solve_with(solver, tighter, found)
            if not better:
                raise
            found, solver = better
            continue
        ratios, memory = judged(solver, accuracy, memory, point)
        finer, memory = accuracy.finer(solver.resolution, ratios, memory) if accuracy else (None, memory)
        better = finer and solve_with(solver, finer, found, force_at(solver, found[0], point))
        if not better:
            break
        found, solver = better
    missed = (MISSED,) if max(ratios.values(), default=0.0) > 1.0 else ()
    force, is_linear = force_at(solver, found[0], point), solver.is_linear and found[0].is_linear
    if accuracy:
        next_resolution, memory = accuracy.coarser(solver.resolution, ratios, memory)
        found, solver = solver.resolved(next_resolution).still(found, solver)
    point = replace(point, seconds=solver.workspace.lap(), notes=(*point.notes, *missed, *notes))
    U = found[0].iterate.U
    now = PointState(
        iterate=found[0].iterate,
        selected=solver.selection.update(moves, point.state, point.energy),
        size=solver.norm(U),
        force=force,
        sticks=not moves.any(),
        sliding=float((point.state != STICK).mean()),
        moved=float(point.p.any(axis=(1, 2)).mean()),
        amplitude=point.response[:, 1] - 1j * point.response[:, 2],
    )
    return Accepted(replace(state, solver=replace(solver, is_linear=is_linear), memory=memory), now, point)


def solve_with(
    solver: PointSolver, finer: Resolution, found: Found, force: float | None = None
) -> tuple[Found, PointSolver] | None:
    """Solve a point of contact forces ``force`` [N] again with more; None where Newton fails.  Collective."""
    better = solver.resolved(finer)
    guess = found[0].iterate.on(better.harmonics)
    again, used = better.solve_at(guess, better.norm(guess.U), found[1], force)
    return None if again.failure else ((again.with_effort_of(found[0]), used), better)


def judged(solver: PointSolver, accuracy: Accuracy | None, memory: Memory, point: Point) -> tuple[dict[str, float], Memory]:
    """Return what is wrong with a point for want of harmonics, samples and tolerance, over what is allowed.  Collective."""
    if accuracy is None or point.error is None:
        return {}, memory
    amplitudes = np.hypot(point.response[:, 1::2], point.response[:, 2::2]).max(axis=1)
    return solver.comm.bcast(accuracy.ratios(amplitudes, point.error, memory))


def check_forces(solver: PointSolver, found: Correction, point: Point) -> None:
    """Raise ConvergenceError where a motion has outgrown the forces so far that they have no digits left.  Collective."""
    equation, there = solver.equation, found.iterate
    loads = abs(solver.problem.at(there.parameters).level) * float(np.linalg.norm(equation.model.f))
    forces, unbalanced = loads + force_at(solver, found, point), solver.workspace.stiffest * found.gap
    if unbalanced > max(UNBALANCED, 500.0 * found.bound) * forces:
        raise ConvergenceError(
            f"hb: at {solver.problem.where(there.parameter)} contact forces of {unbalanced:.1e} N are lost beside a motion of "
            f"{solver.norm(there.U):.1e} m, {unbalanced / forces:.1e} of all forces: a body that nothing but its joint holds, "
            "or a joint far too stiff? Hold the body, or lower the stiffness"
        )


def force_at(solver: PointSolver, found: Correction, point: Point) -> float:
    """Return |f_nl| over all ranks [N] at a point on record.  Collective."""
    p = Harmonics.full(point.p.shape[-1]).carry(point.p[solver.equation.model.owned], solver.harmonics)
    return solver.force_of(found.iterate.U, p)
