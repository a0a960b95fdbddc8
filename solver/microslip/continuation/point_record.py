"""The record of a converged point: motion, forces, energies and states, gathered on rank 0."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..contact.energy import contact_work, pair_energy
from ..error_estimate.adjoint import Adjoint
from ..error_estimate.estimate import ErrorEstimator
from ..error_estimate.sensitivities import sensitivities_of
from ..fourier.coefficients import cycle_work
from ..harmonic.adjoint_solver import AdjointSolver
from ..harmonic.operating_point import OperatingPoint
from ..messages.errors import ConvergenceError
from ..points.branch import Point
from ..points.selection import Selection
from ..receptance.motions import load_motion, modal_motion, output_motion
from ..receptance.reduced_model import ReducedModel
from ..stability.multipliers import multipliers_at
from .corrector import Correction
from .iterate import Iterate
from .point_solver import Solution
from .problems import Problem

IMBALANCE = 1e-6  # of the energy balance, beyond which a point is rejected, at a tolerance of 1e-8
HELD = "mean slip held by springs"  # the note of such a point
FAR = "with more harmonics no solution is found near this one"  # note of a point that may solve only the truncated equations
NO_ADJOINT = "sensitivities not found: the linearisation is singular"
DOUBTFUL = "stability uncertain: more harmonics or samples change the largest multiplier by more than its distance from 1"
DRIFTS = "a slider drifts without end"  # note of a point where a march does not reach its cycle


class Unbalanced(ConvergenceError):
    """A solution that is none, for lack of digits: its motion has outgrown the forces."""


def point_record(
    problem: Problem, selection: Selection, solution: Solution, requested: bool, estimator: ErrorEstimator | None = None
) -> tuple[Point, np.ndarray]:
    """Return the record of a converged point and which pairs of all have p != 0, (n_pairs,) bool.

    Collective.  State, energy and the set of moving pairs come from all pairs; ``p`` is that of the selected
    pairs, which the motion solves for.  With an ``estimator`` the point has error bars.

    Raises
    ------
    Unbalanced : work and losses do not balance, although the residual is small relative to the motion; on every rank
    """
    (correction, selected), at = solution, problem.at(solution[0].iterate.parameters)
    equation = problem.equation.under(at)
    U, model = correction.iterate.U, equation.model_at(at)
    of_all = equation.contact_forces(U, equation.every_pair, tangents=estimator is not None)
    used = of_all if selected.all() else equation.contact_forces(U, selected, tangents=False)
    p = equation.full_force(used)
    shape, harmonics, recorded = (model.n_pairs, 3, model.N_H), model.harmonics, model.recorded
    U_all, state = equation.gather(U), equation.gather(of_all.state)
    moves, energy = np.zeros(model.n_pairs, dtype=bool), np.zeros(model.n_pairs)
    moves[of_all.active] = True
    energy[of_all.active] = pair_energy(U_all[of_all.active], of_all.p.reshape(-1, *shape[1:]), harmonics)
    friction = float(contact_work(U_all[used.active], used.p.reshape(-1, *shape[1:]), harmonics).sum())
    damping, work = damping_loss(model, at, p), input_work(model, at, p)
    drifts = equation.gather(np.array([of_all.drifts])).any()
    most = max(abs(work), damping + abs(friction), apparent_work(model, at, p))
    _check_balance(problem, correction, work - damping - friction, most)
    estimate = None if estimator is None else estimator.at(equation, U, at, selected, of_all)
    is_far = estimate is not None and not estimate.is_near
    response = harmonics.carry(output_motion(model, at.level, at.omega, p), recorded)
    point = Point(
        omega=at.omega,
        response=response,
        U=harmonics.carry(U_all, recorded),
        p=harmonics.carry(p.reshape(shape), recorded),
        energy=energy,
        state=state,
        unknowns=selection.unknowns(selected, moves, model.n_modes, model.N_H),
        newton=correction.newton,
        krylov=correction.krylov,
        friction=friction,
        damping=damping,
        input=work,
        seconds=0.0,
        harmonics=harmonics.highest,
        samples=equation.n_samples,
        requested=requested,
        parameters=correction.iterate.parameters,
        notes=tuple(note for note, holds in ((HELD, equation.held is not None), (DRIFTS, drifts), (FAR, is_far)) if holds),
        error=None if estimate is None else estimate.parts,
        corrected=None if estimate is None else response[:, 1:3] + quadratures(estimate.correction),
        error_corrected=None if estimate is None else estimate.remaining,
    )
    return point, moves


def with_stability(problem: Problem, there: Iterate, point: Point, estimator: ErrorEstimator | None = None) -> Point:
    """Return the record of a point with its multipliers; with a note where the error of its motion may change the stability.

    Collective.  The ``estimator`` has estimated the error of the point last.  docs/theory.md, section 16.
    """
    at = problem.at(there.parameters)
    multipliers, notes = multipliers_at(problem.equation.under(at), at, there.U), point.notes
    if multipliers.is_doubtful and estimator is not None and estimator.motion is not None:
        equation, U = estimator.motion
        better = multipliers_at(equation, at, U).largest
        if abs(better - 1.0) <= abs(better - multipliers.largest):
            notes = (*notes, DOUBTFUL)
    parts = np.stack([multipliers.values.real, multipliers.values.imag], axis=-1)
    return replace(point, multipliers=parts, neutral=np.array(multipliers.n_neutral), notes=notes)


def with_sensitivities(
    problem: Problem, solution: Solution, point: Point, solver: AdjointSolver, known: Adjoint | None = None
) -> Point:
    """Return the record of a point with the derivatives of its outputs; without them if the adjoint solve fails.  Collective.

    ``solver`` is that of exact adjoints, ``known`` one that error bars have solved for last.
    """
    (correction, selected), at = solution, problem.at(solution[0].iterate.parameters)
    rates = sensitivities_of(problem.equation.under(at), at, correction.iterate.U, selected, solver, known)
    by_pairs, by_common = (np.stack(np.split(values * rates.is_solved, 2), axis=1) for values in (rates.of_pairs, rates.common))
    notes = point.notes if rates.is_solved else (*point.notes, NO_ADJOINT)
    return replace(point, by_pairs=by_pairs, by_common=by_common, notes=notes)


def quadratures(amplitudes: np.ndarray) -> np.ndarray:
    """Return cosine and sine, (n, 2), of complex amplitudes cos - i sin, (n,).  Local."""
    return np.stack([amplitudes.real, -amplitudes.imag], axis=-1)


def _check_balance(problem: Problem, solution: Correction, gap: float, most: float) -> None:
    """Raise Unbalanced where a motion has outgrown the forces so far that its residual hides them.  Collective."""
    gap, most = problem.equation.comm.bcast((gap, most))
    if not abs(gap) <= max(IMBALANCE, 100.0 * solution.bound) * most:
        raise Unbalanced(
            f"hb: at {problem.where(solution.iterate.parameter)} the work of the loads and the losses differ by {abs(gap):.1e} J "
            f"a cycle, {abs(gap) / most:.1e} of what they are; the motion has outgrown the forces: a resonance that neither "
            "damping nor friction holds? State [damping], or end the range before it"
        )


def apparent_work(model: ReducedModel, at: OperatingPoint, p: np.ndarray) -> float:
    """Return the largest work that the loads could do on their motion at any phase [J per cycle].  Local.

    A constant load does none; a thousandth of its largest work is added for its rounding.
    """
    y, f = load_motion(model, at.level, at.omega, p), at.level * model.f
    n, cos, sin, mean = model.harmonics.above_mean, model.harmonics.cos, model.harmonics.sin, model.harmonics.mean
    vibration = np.sum(n * np.hypot(f[:, cos], f[:, sin]) * np.hypot(y[:, cos], y[:, sin]))
    return float(np.pi * (vibration + 1e-3 * np.sum(np.abs(f[:, mean] * y[:, mean]))))


def damping_loss(model: ReducedModel, at: OperatingPoint, p: np.ndarray) -> float:
    """Return the viscous loss D of eq. (9.1) and the structural one of eq. (13.3), together [J per cycle].  Local."""
    viscous, structural = [], []
    for group, eta in zip(model.groups, modal_motion(model, at.level, at.omega, p)):
        n, damping = group.harmonics.numbers, group.receptance.modes.damping
        viscous.append(_real_product(n**2, eta, damping.apply(eta)))
        structural.append(_real_product(n, eta, damping.apply_structural(eta)))
        rigid = group.receptance.rigid
        if rigid is not None:
            structural.append(rigid.loss(at.level * model.f[:, group.columns], n, at.omega) / np.pi)
    return float(np.pi * at.omega * sum(viscous)) + float(np.pi * sum(structural))


def _real_product(weights: np.ndarray, eta: np.ndarray, forces: np.ndarray) -> float:
    """Return the sum of the harmonics' weights (n_harmonics,) times Re eta^H forces, (m, n_harmonics) both.  Local."""
    return np.sum(weights * (eta.conj() * forces).real)


def input_work(model: ReducedModel, at: OperatingPoint, p: np.ndarray) -> float:
    """Return the work of the loads, W of eq. (9.1) [J per cycle]: closed integral of f . du over each load.  Local."""
    return float(cycle_work(at.level * model.f, load_motion(model, at.level, at.omega, p), model.harmonics).sum())
