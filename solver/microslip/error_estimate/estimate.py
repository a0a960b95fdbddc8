"""The error bar of a converged point: six parts, each through the adjoint of the requested output.

docs/theory.md, section 11.  The solution U of (5.1) is inserted into an enriched problem: all pairs, more harmonics, more
samples, more elements per divided pair, the truncated modes.  To first order, the change of the output is the change of the
contact forces times the adjoint chi of the output, the solution of one linear system:

    (1 + G^T P^T) chi = B^T,      d output = - chi . d p,

with B = d output / d p at fixed motion of the pairs.  The signed parts correct the output (correction.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from ..fourier.harmonics import Harmonics
from ..harmonic.adjoint_solver import AdjointSolver
from ..harmonic.anderson import Anderson
from ..harmonic.balance import HarmonicBalance
from ..harmonic.linearisation import Linearisation
from ..harmonic.operating_point import ContactForces, OperatingPoint
from ..parallel.ownership import rows_of
from ..receptance.motions import output_motion
from ..receptance.other_springs import enriched_with_springs
from ..receptance.reduced_model import ReducedModel
from ..receptance.truncated_modes import SAMPLES as SAMPLES_OF_MODES
from ..receptance.truncated_modes import EnrichedModel, Truncation
from .adjoint import Adjoint
from .correction import MOST_STEPS, Estimate, corrected

FINER = 2  # factor of the number of samples in the enriched problem
SAMPLES = 4  # least number of samples per additional harmonic
MOST_SWEEPS = 20  # steps of the iteration for the higher harmonics
SETTLED = 0.1  # relative residual at which this iteration ends
STEP = 1e-2  # relative residual of its linear systems, whose solutions are steps towards the point that it ends at
FOLLOWED = 0.1  # step relative to the distance from the point, at which the iteration (11.4) ends


@dataclass(frozen=True)
class Changes:
    """Changes of the contact forces in enriched problems, in the harmonics of the solution, (3 n_pairs, N_H) [N]."""

    harmonics: np.ndarray
    samples: np.ndarray
    pairs: np.ndarray
    sliders: np.ndarray
    wider: HarmonicBalance  # the equation with more harmonics
    higher: np.ndarray  # (n_owned, 3, N_H of wider) motion in the additional harmonics, as far as converged [m]
    without: np.ndarray  # (3 n_pairs, N_H) forces of ``wider`` without ``higher``, to which ``harmonics`` is the change [N]
    unsettled: float = 1.0  # residual of ``higher`` divided by ``SETTLED``; 1 if converged

    @property
    def signed(self) -> tuple[np.ndarray, ...]:
        """The changes that have a sign, by cause: harmonics, samples, pairs, sliders."""
        return self.harmonics, self.samples, self.pairs, self.sliders

    @property
    def of_all(self) -> np.ndarray:
        """Their sum."""
        return sum(self.signed, np.zeros_like(self.harmonics))

    @property
    def are_any(self) -> bool:
        """Whether any of them is not zero."""
        return any(change.any() for change in self.signed)


@dataclass(frozen=True)
class Higher:
    """The harmonics above those of the solution, as far as converged."""

    motion: np.ndarray  # (n_owned, 3, N_H of the wider set) m
    forces: ContactForces  # under all harmonics
    miss: float = 0.0  # relative residual


@dataclass(frozen=True)
class JointChanges:
    """Changes of the outputs' cos 1, then sin 1, through the motion of the pairs; n = 2 n_outputs."""

    linear: np.ndarray  # (6, n) by harmonics, samples, pairs, sliders, solver and basis, to first order [m]
    steps: np.ndarray  # (n_steps, n) by all, to all orders, in each step of the iteration; n_steps = 1 if all pairs stick [m]
    is_settled: bool  # the iteration converged
    modes: np.ndarray  # (n, n_samples, N_H) samples of the truncated modes, R^T tau
    is_adjoint_solved: bool
    adjoint: Adjoint | None = None  # None where all pairs stick

    @classmethod
    def nothing(cls, n: int, n_samples: int, N_H: int) -> JointChanges:
        """Return changes of zero."""
        return cls(np.zeros((6, n)), np.zeros((1, n)), True, np.zeros((n, n_samples, N_H)), True)


class ErrorEstimator:
    """Error bars of the points of a branch.  Collective on the communicator of the model."""

    def __init__(self, enriched: EnrichedModel, adjoint_solver: AdjointSolver | None = None):
        comm = enriched.structure.comm
        self.enriched = enriched
        self.last: Adjoint | None = None  # adjoint of the last point; None where all pairs stick
        self.motion: tuple[HarmonicBalance, np.ndarray] | None = None  # that of the last point in the enriched equation
        self.adjoint_solver, self.forward_solver = adjoint_solver or AdjointSolver(comm), AdjointSolver(comm, STEP)
        self._models: dict[Harmonics, ReducedModel] = {}  # enriched models, by harmonics
        self._with_springs: tuple[object, EnrichedModel] = None, enriched  # springs and structure of the cached models

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        self.adjoint_solver.destroy()
        self.forward_solver.destroy()

    def enriched_of(self, model: ReducedModel) -> EnrichedModel:
        """Return the enriched model with the contact stiffness of a model; cached for the last stiffness.  Local."""
        if self._with_springs[0] is not model.spring_updates:
            self._models.clear()
            self._with_springs = model.spring_updates, enriched_with_springs(self.enriched, model)
        return self._with_springs[1]

    def enriched_model(self, model: ReducedModel, harmonics: Harmonics) -> ReducedModel:
        """Return the enriched model under the loads of another, in a set of harmonics; cached.  Local."""
        enriched = self.enriched_of(model)
        if harmonics not in self._models:
            self._models[harmonics] = model.on(enriched.structure).with_harmonics(harmonics)
        return self._models[harmonics]

    def exact(self, equation: HarmonicBalance) -> HarmonicBalance:
        """Return the same equation for the enriched model.  Local."""
        return equation if self.enriched.is_solved else equation.of(self.enriched_model(equation.model, equation.harmonics))

    def at(
        self,
        equation: HarmonicBalance,
        U: np.ndarray,
        at: OperatingPoint,
        selected: np.ndarray,
        of_all: ContactForces | None = None,
    ) -> Estimate | None:
        """Return the error estimate of the complex amplitude of harmonic 1 of the outputs.

        Collective.  None without harmonic 1.  If the adjoint solve fails, the solver part is the amplitude itself.
        ``U`` (n_owned, 3, N_H) solves ``equation`` with the ``selected`` pairs at a point; ``of_all`` are the contact forces
        of all pairs at the point, with tangents, if available.
        """
        model, n_out, self.motion = equation.model, equation.model.n_outputs, None
        if 1 not in model.harmonics:
            return None
        exact = self.exact(equation)
        here, there = equation.model_at(at), exact.model_at(at)  # with the damping of the point
        forces = of_all or exact.contact_forces(U, equation.every_pair, tangents=True)
        used = forces if selected.all() else equation.contact_forces(U, selected, tangents=False)
        p = equation.full_force(used)
        changes = self.changes(exact, U, at, equation.full_force(forces), p)
        truncation = self.enriched_of(equation.model).truncation(there, at.sigma, at.damping)
        n_samples = 0 if truncation.is_exact else SAMPLES_OF_MODES
        through_joint = JointChanges.nothing(2 * n_out, n_samples, exact.model.N_H)
        all_stick = len(forces.active) == 0 and not changes.are_any  # also in the enriched problems
        if all_stick and self.enriched.is_solved:
            self.last = None
            return Estimate.of_modes_alone(truncation.changes(at.level, at.omega, p, through_joint.modes))
        if not all_stick:
            through_joint = self.through_the_joint(equation, Linearisation.of(exact, at, forces), U, used, changes, truncation)
        by_harmonics, by_samples, by_pairs, by_sliders, by_solver, by_basis = through_joint.linear
        if not self.enriched.is_solved:
            by_basis = by_basis + (output_amplitude(there, at, p) - output_amplitude(here, at, p))
        truncated = np.zeros(2 * n_out)
        if not truncation.is_exact:
            truncated = truncation.changes(at.level, at.omega, p, through_joint.modes)
        lost = np.abs(output_amplitude(here, at, p))
        parts = [
            np.abs(by_basis) + truncated,
            changes.unsettled * by_harmonics,
            by_samples,
            by_pairs,
            np.abs(by_solver),
            by_sliders,
        ]
        if not through_joint.is_adjoint_solved:
            parts[4] = parts[4] + lost
        linear = np.stack([by_basis, by_harmonics, by_samples, by_pairs, by_solver, by_sliders])
        settled = through_joint.is_settled and through_joint.is_adjoint_solved
        estimate = corrected(np.stack(parts), linear, through_joint.steps, settled, truncated, lost)
        self.last = through_joint.adjoint
        return replace(estimate, adjoint=through_joint.adjoint)

    def through_the_joint(
        self,
        equation: HarmonicBalance,
        linear: Linearisation,
        U: np.ndarray,
        used: ContactForces,
        changes: Changes,
        truncation: Truncation,
    ) -> JointChanges:
        """Return the changes of the outputs through the motion of the pairs; ``linear`` is the enriched model's linearisation.

        Collective: sums over the ranks, and a broadcast.  docs/theory.md, eq. (11.2).
        """
        exact, at = linear.equation, linear.at
        owned, N_H = exact.model.owned_rows, exact.model.N_H
        B = sensitivity(exact.model_at(at), at.omega)
        chi, tau, is_adjoint_solved = linear.solve_transposed(B, self.adjoint_solver)
        adjoint = Adjoint(linear, chi, tau, is_adjoint_solved)
        residual = equation.residual(U, at, used, linear.G if used is linear.forces and exact is equation else None)
        sums = [-chi @ change[owned].ravel() for change in changes.signed]
        sums += [tau @ residual.ravel(), np.zeros(len(tau))]
        if not self.enriched.is_solved:
            sums[-1] = tau @ (exact.residual(U, at, used) - residual).ravel()

        def of_outputs(d_p: np.ndarray, residual: np.ndarray) -> np.ndarray:
            return -B[:, owned].reshape(chi.shape) @ d_p[owned].ravel() + tau @ residual.ravel()

        steps, is_settled = self.followed(linear, U, equation.full_force(used), changes, of_outputs)
        modes = np.zeros((len(tau), 0, N_H))
        if not truncation.is_exact:
            modes = truncation.samples_of(tau.reshape(len(tau), -1, N_H))
        totals = equation.agreed_sum(np.concatenate([*sums, *steps, modes.ravel()]))
        first, of_steps, of_modes = np.split(totals, np.cumsum([6 * len(tau), len(steps) * len(tau)]))
        return JointChanges(
            first.reshape(6, -1),
            of_steps.reshape(len(steps), -1),
            is_settled,
            of_modes.reshape(modes.shape),
            is_adjoint_solved,
            adjoint,
        )

    def followed(
        self,
        linear: Linearisation,
        U: np.ndarray,
        p: np.ndarray,
        changes: Changes,
        of_outputs: Callable[[np.ndarray, np.ndarray], np.ndarray],
    ) -> tuple[list[np.ndarray], bool]:
        """Return the change of the outputs in each step of the iteration (11.4), and whether it converged.

        Collective.  The limit is a solution of the enriched equations near the point.  ``p`` (3 n_pairs, N_H) are the forces
        under ``U``; ``of_outputs`` returns this rank's part of the change of the outputs by a change of p and a residual.
        docs/theory.md, eq. (11.4): Newton's method with the tangents of the point, and the fixed-point iteration of the higher
        harmonics, with a common Anderson acceleration.
        """
        steps: list[np.ndarray] = []
        exact, more, wider = linear.equation, changes.wider.harmonics, changes.wider
        start = exact.harmonics.carry(U, more) + changes.higher
        others = changes.of_all - changes.harmonics - changes.without
        x, mixing = start, Anderson(wider)
        for _ in range(MOST_STEPS):
            forces = wider.contact_forces(x, exact.every_pair, tangents=False)
            d_p = more.carry(wider.full_force(forces), exact.harmonics) + others
            p_now = p + d_p
            loaded = np.flatnonzero(p_now.reshape(exact.model.n_pairs, -1).any(axis=1))
            low = more.carry(x, exact.harmonics)
            residual = exact.residual_under(low, linear.at, loaded, p_now[rows_of(loaded)])
            B = -exact.gather(residual).reshape(1, -1, exact.model.N_H)
            d_U, _, is_solved = linear.solve_several(B, self.forward_solver)
            value = above(wider, linear.at, exact.harmonics, forces) + exact.harmonics.carry(low + d_U.reshape(U.shape), more)
            way, miss = np.sqrt(wider.agreed_sum(np.array([norm2(value - start), norm2(value - x)])))
            if not (is_solved and np.isfinite(miss)):
                break
            steps.append(of_outputs(d_p, residual))
            if miss <= FOLLOWED * way:
                self.motion = wider, value
                return steps, True
            x, _ = mixing.next(x, value)
        return steps, False

    def changes(self, exact: HarmonicBalance, U: np.ndarray, at: OperatingPoint, p_all: np.ndarray, p: np.ndarray) -> Changes:
        """Return the changes in enriched problems of ``p`` of the selected pairs; ``p_all`` is p of all pairs.  Collective.

        The higher harmonics are excited by the contact forces, U_n = -G_n p_n: a few steps of this fixed-point iteration, with
        Anderson acceleration, so that it also converges with a harmonic near a resonance.
        """
        harmonics, more, everything = exact.harmonics, extended(exact.harmonics), exact.every_pair
        finer = exact.resolved(harmonics, FINER * exact.n_samples)
        by_samples = finer.full_force(finer.contact_forces(U, everything, tangents=False)) - p_all
        by_samples *= FINER**exact.law.order / (FINER**exact.law.order - 1.0)  # the limit of many samples, from N_t and FINER N_t
        wider = exact.of(self.enriched_model(exact.model, more)).resolved(
            more, max(exact.n_samples, SAMPLES * (more.highest + 1))
        )
        U_more = harmonics.carry(U, more)
        at_wider = wider.contact_forces(U_more, everything, tangents=False)
        solution = with_higher(wider, at, harmonics, U_more, Higher(np.zeros_like(U_more), at_wider), SETTLED)
        without = more.carry(wider.full_force(at_wider), harmonics)
        by_harmonics = more.carry(wider.full_force(solution.forces), harmonics) - without
        unsettled = max(1.0, solution.miss / SETTLED)  # without convergence the error is larger in proportion
        by_sliders = self.by_sliders(exact, U, p_all)
        return Changes(by_harmonics, by_samples, p_all - p, by_sliders, wider, solution.motion, without, unsettled)

    @staticmethod
    def by_sliders(exact: HarmonicBalance, U: np.ndarray, p_all: np.ndarray) -> np.ndarray:
        """Return the change of ``p_all`` in the limit of infinitely many elements per divided pair, (3 n_pairs, N_H) [N].

        Collective: one maximum over the ranks, and a gather if any pair is divided.
        """
        order = exact.comm.allreduce(exact.law.elements_order, MPI.MAX)
        if order == 0:
            return np.zeros_like(p_all)
        finer = replace(exact, law=exact.law.refined)
        change = finer.full_force(finer.contact_forces(U, exact.every_pair, tangents=False)) - p_all
        return change * 2**order / (2**order - 1)


def with_higher(
    wider: HarmonicBalance, at: OperatingPoint, low: Harmonics, U: np.ndarray, start: Higher, settled: float
) -> Higher:
    """Return the harmonics above ``low`` that the contact forces excite, under ``U`` (n_owned, 3, N_H of ``wider``) plus them.

    Collective.  The iteration ends at the relative residual ``settled``.
    """
    forces, higher, miss = start.forces, start.motion, start.miss
    mixing = Anderson(wider)
    for _ in range(MOST_SWEEPS if len(forces.active) > 0 else 0):
        higher, miss = mixing.next(higher, above(wider, at, low, forces))
        if miss <= settled:
            break
        forces = wider.contact_forces(U + higher, forces.selected, tangents=False)
    return Higher(higher, forces, miss)


def above(wider: HarmonicBalance, at: OperatingPoint, low: Harmonics, forces: ContactForces) -> np.ndarray:
    """Return the motion above the harmonics ``low`` that contact forces excite, (n_owned, 3, N_H of ``wider``) [m].

    Collective where static columns are missing, and of a whole disc.
    """
    if len(forces.active) == 0:
        return np.zeros(wider.shape)
    excited = -wider.receptance(at, forces.active).apply(forces.p)
    return excited - low.carry(wider.harmonics.carry(excited, low), wider.harmonics)


def norm2(values: np.ndarray) -> float:
    """Return the sum of squares.  Local."""
    return float(np.vdot(values, values))


def sensitivity(model: ReducedModel, omega: float) -> np.ndarray:
    """Return B, minus the derivative of the outputs' cos 1, then sin 1, with respect to p, (2 n_outputs, 3 n_pairs, N_H).  Local.

    docs/theory.md, eq. (11.1).  With A = o (K_L^-1 + phi c_1 phi^T) R^T the amplitude is u_lin - A p: the cosine changes by
    -(Re A p_c + Im A p_s), the sine by Im A p_c - Re A p_s.
    """
    A = model.output_receptance(omega, 1)
    n_out, cos = len(A), model.harmonics.columns(1).start
    B = np.zeros((2 * n_out, A.shape[1], model.N_H))
    B[:n_out, :, cos], B[:n_out, :, cos + 1] = A.real, A.imag
    B[n_out:, :, cos], B[n_out:, :, cos + 1] = -A.imag, A.real
    return B


def output_amplitude(model: ReducedModel, at: OperatingPoint, p: np.ndarray) -> np.ndarray:
    """Return cos 1 and then sin 1 of the outputs under loads and ``p`` (3 n_pairs, N_H), (2 n_outputs,) [m].  Local."""
    motion = output_motion(model, at.level, at.omega, p)
    return motion[:, model.harmonics.columns(1)].T.ravel()


def extended(harmonics: Harmonics) -> Harmonics:
    """Return the harmonics of the enriched problem, about twice as many; only odd ones if ``harmonics`` are odd.  Local."""
    highest = 2 * harmonics.highest + 3
    return Harmonics.odd_up_to(highest) if all(n % 2 for n in harmonics.chosen) else Harmonics.up_to(highest)
