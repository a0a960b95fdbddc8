"""The error bar of a converged point: five parts, each through the adjoint of the requested output.

docs/theory.md, section 11.  The solution U of (5.1) is put into a better problem: all pairs, more harmonics, more samples, the
modes left out.  To first order, what that changes in the output is the change of the contact forces times the adjoint chi of the
output, which one linear solve gives:

    (1 + G^T P^T) chi = B^T,      d output = - chi . d p,

with B = d output / d p at fixed motion of the pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fourier.harmonics import Harmonics
from ..harmonic.adjoint_solver import AdjointSolver
from ..harmonic.anderson import Anderson
from ..harmonic.balance import HarmonicBalance
from ..harmonic.linearisation import Linearisation
from ..harmonic.operating_point import ContactForces, OperatingPoint
from ..receptance.model import ReducedModel
from .better_model import BetterModel

FINER = 2  # times the samples of the better problem
SAMPLES = 4  # of the more harmonics, each, at least
MOST_SWEEPS = 20  # steps of the iteration for the higher harmonics
SETTLED = 0.1  # relative miss at which it ends


@dataclass(frozen=True)
class Changes:
    """What better problems change in the contact forces, in the harmonics solved for, (3 n_pairs, N_H) [N]."""

    harmonics: np.ndarray
    samples: np.ndarray
    pairs: np.ndarray

    @property
    def are_any(self) -> bool:
        return bool(self.harmonics.any() or self.samples.any() or self.pairs.any())


class ErrorEstimator:
    """Error bars of the points of a branch.  Collective on the communicator of the model."""

    def __init__(self, better: BetterModel):
        self.better, self.left_out = better, better.left_out
        self.adjoint_solver = AdjointSolver(better.model.comm)
        self._models: dict[Harmonics, ReducedModel] = {}  # better ones, by harmonics

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        self.adjoint_solver.destroy()

    def model_on(self, harmonics: Harmonics) -> ReducedModel:
        """Return the better model on a set of harmonics, made once.  Local."""
        if harmonics not in self._models:
            self._models[harmonics] = self.better.model.with_harmonics(harmonics)
        return self._models[harmonics]

    def exact(self, equation: HarmonicBalance) -> HarmonicBalance:
        """Return the same equation of the better model.  Local."""
        return equation if self.better.is_solved else equation.of(self.model_on(equation.harmonics))

    def at(
        self,
        equation: HarmonicBalance,
        U: np.ndarray,
        at: OperatingPoint,
        selected: np.ndarray,
        of_all: ContactForces | None = None,
    ) -> np.ndarray | None:
        """Return the parts of the error of the complex amplitude of harmonic 1, (n_outputs, n_parts) [m], as in ``PARTS``.

        Collective.  None without harmonic 1.  Where an adjoint is not found the solver's part is the amplitude itself.
        ``U`` (n_owned, 3, N_H) solves ``equation`` with the ``selected`` pairs at a point; ``of_all`` are the contact forces
        of all pairs there, with tangents, where they are known.
        """
        model, n_out, is_found = equation.model, equation.model.n_outputs, True
        if 1 not in model.harmonics:
            return None
        exact = self.exact(equation)
        forces = of_all or exact.contact_forces(U, equation.every_pair, tangents=True)
        used = forces if selected.all() else equation.contact_forces(U, selected, tangents=False)
        p = equation.full_force(used)
        changes = self.changes(exact, U, at, equation.full_force(forces), p)
        n_samples = 0 if self.left_out is None else self.left_out.of_pairs.shape[1]
        if len(forces.active) > 0 or changes.are_any:
            totals, is_found = self.through_the_joint(equation, exact, U, at, forces, used, changes)
        else:  # all pairs stick, in the better problems too: no adjoint is needed
            totals = np.zeros(2 * n_out * (5 + n_samples * exact.model.N_H))
        by_harmonics, by_samples, by_pairs, by_solver, by_basis = totals[: 10 * n_out].reshape(5, -1)
        felt = totals[10 * n_out :].reshape(2 * n_out, n_samples, exact.model.N_H)
        if not self.better.is_solved:
            by_basis = by_basis + (output_amplitude(exact.model, at, p) - output_amplitude(model, at, p))
        by_modes = np.abs(by_basis)
        if self.left_out is not None:
            by_modes = by_modes + self.left_out.changes(exact.model, at.level, at.omega, p, felt)
        if not is_found:
            by_solver = by_solver + np.abs(output_amplitude(model, at, p))
        parts = np.stack([by_modes, by_harmonics, by_samples, by_pairs, by_solver], axis=-1)
        return np.hypot(parts[:n_out], parts[n_out:])

    def through_the_joint(
        self,
        equation: HarmonicBalance,
        exact: HarmonicBalance,
        U: np.ndarray,
        at: OperatingPoint,
        forces: ContactForces,
        used: ContactForces,
        changes: Changes,
    ) -> tuple[np.ndarray, bool]:
        """Return the five parts that the adjoint gives, (2 n_outputs,) each, and what it feels of the modes left out, in a row.

        And whether the adjoint was found.  Collective: sums over the ranks, and a broadcast.  docs/theory.md, eq. (11.2).
        """
        linear, own, N_H = Linearisation.of(exact, at, forces), exact.model.owned_rows, exact.model.N_H
        chi, tau, is_found = linear.solve_transposed(sensitivity(exact.model, at.omega), self.adjoint_solver)
        residual = equation.residual(U, at, used, linear.G if used is forces and exact is equation else None)
        sums = [-chi @ change[own].ravel() for change in (changes.harmonics, changes.samples, changes.pairs)]
        sums += [tau @ residual.ravel(), np.zeros(len(tau))]
        if not self.better.is_solved:
            sums[-1] = tau @ (exact.residual(U, at, used) - residual).ravel()
        felt = np.zeros((len(tau), 0, N_H))
        if self.left_out is not None:
            felt = np.matmul(self.left_out.of_pairs[own].T, tau.reshape(len(tau), -1, N_H))
        return equation.comm.bcast(equation.sum(np.concatenate([*sums, felt.ravel()]))), is_found

    def changes(self, exact: HarmonicBalance, U: np.ndarray, at: OperatingPoint, p_all: np.ndarray, p: np.ndarray) -> Changes:
        """Return what better problems change in ``p``, of the selected pairs; ``p_all`` is that of all.  Collective.

        The higher harmonics are those that the contact forces excite, U_n = -G_n p_n, by a few steps of that fixed-point
        iteration, mixed so that it also converges where a harmonic lies near a resonance.
        """
        harmonics, more, everything = exact.harmonics, extended(exact.harmonics), exact.every_pair
        finer = exact.resolved(harmonics, FINER * exact.n_samples)
        by_samples = finer.full_force(finer.contact_forces(U, everything, tangents=False)) - p_all
        by_samples *= FINER**exact.law.order / (FINER**exact.law.order - 1.0)  # the limit of many samples, from N_t and FINER N_t
        wider = exact.of(self.model_on(more)).resolved(more, max(exact.n_samples, SAMPLES * (more.highest + 1)))
        U_more = harmonics.carry(U, more)
        at_wider = forces = wider.contact_forces(U_more, everything, tangents=False)
        if len(forces.active) == 0:
            return Changes(np.zeros_like(p_all), by_samples, p_all - p)
        higher, mixing = np.zeros_like(U_more), Anderson(exact)
        for _ in range(MOST_SWEEPS):
            excited = -wider.receptance(at, forces.active).apply(forces.p)
            higher, miss = mixing.next(higher, excited - harmonics.carry(more.carry(excited, harmonics), more))
            if miss <= SETTLED:
                break
            forces = wider.contact_forces(U_more + higher, everything, tangents=False)
        by_harmonics = more.carry(wider.full_force(forces) - wider.full_force(at_wider), harmonics)
        by_harmonics *= max(1.0, miss / SETTLED)  # what never settled is known no better than that
        return Changes(by_harmonics, by_samples, p_all - p)


def sensitivity(model: ReducedModel, omega: float) -> np.ndarray:
    """Return B, minus the derivative of the outputs' cos 1, then sin 1, with respect to p, (2 n_outputs, 3 n_pairs, N_H).  Local.

    docs/theory.md, eq. (11.1).  With A = o (K_L^-1 + phi c_1 phi^T) R^T the amplitude is u_lin - A p: the cosine moves by
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
    motion = model.output_motion(at.level, at.omega, p)
    return motion[:, model.harmonics.columns(1)].T.ravel()


def extended(harmonics: Harmonics) -> Harmonics:
    """Return the set of the better problem: the same, with about twice as many; odd ones alone where it has no others.  Local."""
    highest = 2 * harmonics.highest + 3
    return Harmonics.odd_up_to(highest) if all(n % 2 for n in harmonics.chosen) else Harmonics.up_to(highest)
