"""The error bar of a converged point: five parts, each through the adjoint of the requested output.

docs/theory.md, section 10.  The solution U of (5.1) is put into a better problem: all pairs, more harmonics, more samples, the
modes left out.  To first order, what that changes in the output is the change of the contact forces times the adjoint mu of the
output, which one linear solve gives:

    (1 + G^T P^T) mu = B^T,      d output = - mu . d p,

with B = d output / d p at fixed motion of the pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..harmonic.harmonics import Harmonics
from ..harmonic.newton import Gatherer, Linearisation, NewtonStep
from ..harmonic.preconditioner import HarmonicPreconditioner
from ..harmonic.residual import ContactForces, HarmonicBalance
from ..reduction import receptance
from ..reduction.model import ReducedModel
from .parts import PARTS
from .truth import Truth

FINER = 4               # times the samples of the better problem
ORDER = 1               # of the sampled law in 1 / N_t
MANY_KRYLOV = 50        # GMRES iterations of an adjoint beyond which the next ones are preconditioned


@dataclass(frozen=True)
class Refined:
    """Contact forces of all pairs in better problems, in the harmonics solved for, (3 n_pairs, N_H) [N]."""

    finer: np.ndarray           # with more samples
    richer: np.ndarray          # and with the higher harmonics that these forces excite


class ErrorEstimator:
    """Error bars of the points of a branch.  Collective on the communicator of its model.

    Parameters
    ----------
    truth : the receptance of the stuck structure, exact but for the modes left out; of the model that is solved, or a better one
    """

    def __init__(self, truth: Truth):
        self.truth, self.left_out = truth.model, truth.left_out
        self._step: NewtonStep | None = None
        self._harmonics: Harmonics | None = None

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        if self._step is not None:
            self._step.destroy()
            self._step = None

    def at(self, problem: HarmonicBalance, U: np.ndarray, parameter: float, selected: np.ndarray) -> np.ndarray:
        """Return the parts of the error of the complex amplitude of harmonic 1, (n_outputs, len(PARTS)) [m], each >= 0.

        Collective.  ``U`` (n_owned, 3, N_H) solves ``problem`` with the ``selected`` pairs at ``parameter``.
        """
        model, harmonics = problem.model, problem.model.harmonics
        n_out = model.o.shape[0]
        if 1 not in harmonics:
            return np.zeros((n_out, len(PARTS)))
        truth = model if self.truth is model else self.truth.with_harmonics(harmonics)
        exact = problem if truth is model else problem.of(truth)
        everything = np.ones(model.n_pairs, dtype=bool)
        forces = exact.contact_forces(U, everything, tangents=True)
        used = forces if selected.all() else problem.contact_forces(U, selected, tangents=False)
        p, p_all = problem.full_force(used), problem.full_force(forces)
        refined = self.refined(exact, U, parameter, p_all)
        omega, level = problem.omega_at(parameter), problem.level_at(parameter)
        B = sensitivity(truth, omega)                                               # (2 n_out, 3 n_pairs, N_H)
        own = truth.owned_rows
        theta, on_stuck = np.zeros((2 * n_out, *exact.shape)), len(forces.active) == 0
        mu = B[:, own] if on_stuck else self.adjoints(exact, forces, parameter, B, theta)
        changes = np.stack([refined.richer - refined.finer, (refined.finer - p_all) * _RICHARDSON, p_all - p])
        residual = _residual(problem, U, parameter, used)
        model_residual = np.zeros_like(residual)
        direct = np.zeros((n_out, truth.N_H))
        if truth is not model:
            model_residual = _residual(exact, U, parameter, replace(used, active=np.arange(truth.n_pairs), p=p)) - residual
            direct = receptance.output_motion(truth, level, omega, p) - receptance.output_motion(model, level, omega, p)
        flat = theta.reshape(2 * n_out, -1)
        sums = [-mu.reshape(2 * n_out, -1) @ change[own].ravel() for change in changes]
        sums += [flat @ residual.ravel(), flat @ model_residual.ravel()]
        felt = np.zeros((0, 0, 0))
        if self.left_out is not None:
            felt = np.einsum("sk,qsh->qkh", self.left_out.of_pairs[own], theta.reshape(2 * n_out, -1, truth.N_H))
        totals = problem.comm.bcast(problem.gather_sum(np.concatenate([np.ravel(sums), felt.ravel()])))
        by_harmonic, by_sampling, by_pairs, by_solver, by_basis = totals[: 10 * n_out].reshape(5, 2 * n_out)
        by_basis = by_basis + first_harmonic(direct, truth)
        by_modes = np.abs(by_basis)
        if self.left_out is not None:
            by_modes = by_modes + self.by_modes_left_out(truth, level, omega, p, totals[10 * n_out:].reshape(felt.shape))
        parts = np.stack([by_modes, by_harmonic, by_sampling, by_pairs, by_solver], axis=-1)
        return np.hypot(parts[:n_out], parts[n_out:])

    def refined(self, exact: HarmonicBalance, U: np.ndarray, parameter: float, p_all: np.ndarray) -> Refined:
        """Return the forces that the same motion meets in better problems.  Collective.

        The higher harmonics are those that the contact forces excite, U_n = -G_n p_n: one step of a fixed-point iteration.
        """
        harmonics = exact.model.harmonics
        better = exact.resolved(extended(harmonics), FINER * exact.n_samples)
        everything, U_better = np.ones(exact.model.n_pairs, dtype=bool), harmonics.carry(U, better.model.harmonics)
        finer = better.contact_forces(U_better, everything, tangents=False)
        if len(finer.active) == 0:
            return Refined(np.zeros_like(p_all), np.zeros_like(p_all))
        excited = -better.receptance_at(parameter, finer.active).apply(finer.p)
        richer = better.contact_forces(U_better + _beyond(excited, better.model.harmonics, harmonics), everything, tangents=False)
        back = [better.model.harmonics.carry(better.full_force(forces), harmonics) for forces in (finer, richer)]
        return Refined(*back)

    def adjoints(self, exact: HarmonicBalance, forces: ContactForces, parameter: float, B: np.ndarray,
                 theta: np.ndarray) -> np.ndarray:
        """Return mu of this rank's pairs, (n_quantities, 3 n_owned, N_H); put P^T mu into ``theta``.  Collective."""
        if self._step is None or self._harmonics != exact.model.harmonics:
            self.destroy()
            self._step, self._harmonics = NewtonStep(exact), exact.model.harmonics
        self._step.problem = exact
        assert forces.P is not None, "asked for with tangents"
        adjoint = replace(forces, P=np.ascontiguousarray(forces.P.transpose(0, 2, 1)))
        G = exact.receptance_at(parameter, forces.active).adjoint()
        gatherer = Gatherer(exact.comm, 3 * len(forces.active_owned) * exact.model.N_H, 2)
        at = Linearisation(adjoint, G, np.zeros(exact.shape), np.zeros(exact.shape), 1.0, gatherer)
        mu = np.empty((len(B), *exact.shape))
        for i, b in enumerate(B[:, exact.model.owned_rows]):
            unit = float(np.abs(B[i]).max(initial=0.0)) or 1.0                      # the same on every rank
            mu_i, _, iterations, _ = self._step.solve(at, b.reshape(exact.shape) / unit, 0.0)
            if iterations > MANY_KRYLOV:
                self._step.preconditioner = HarmonicPreconditioner(exact, adjoint, G)
            mu[i] = unit * mu_i
            owned = forces.active_owned
            theta[i, owned] = at.pair_forces(mu[i, owned]).reshape(len(owned), *exact.shape[1:])
        return mu.reshape(len(B), -1, exact.model.N_H)

    def by_modes_left_out(self, truth: ReducedModel, level: float, omega: float, p: np.ndarray, felt: np.ndarray) -> np.ndarray:
        """Return what the modes left out would change, (2 n_outputs,) [m].  Local.

        ``felt`` (2 n_outputs, SAMPLES, N_H): what reaches them from the outputs by way of the pairs.
        """
        out, f = self.left_out, level * truth.f
        weights = -felt
        cos = truth.harmonics.columns(1).start
        n_out = len(out.of_outputs)
        weights[:n_out, :, cos] += out.of_outputs
        weights[n_out:, :, cos + 1] += out.of_outputs
        return out.changes(weights, out.of_loads.T @ f - out.of_pairs.T @ p, truth, omega)


_RICHARDSON = FINER**ORDER / (FINER**ORDER - 1.0)       # the limit of many samples, from N_t and FINER N_t


def sensitivity(model: ReducedModel, omega: float) -> np.ndarray:
    """Return B, minus the derivative of the outputs' cos 1, then sin 1, with respect to p, (2 n_outputs, 3 n_pairs, N_H).  Local.

    With A = o (K_L^-1 + phi c_1 phi^T) R^T the amplitude is u_lin - A p: the cosine moves by -(Re A p_c + Im A p_s), the sine
    by Im A p_c - Re A p_s.
    """
    c, _ = receptance.dynamic_part(model, omega)
    at = list(model.harmonics.numbers).index(1)
    A = model.out_R + ((model.o * c[:, at]) if c.ndim == 2 else (model.o @ c[at])) @ model.r.T
    n_out, cos = len(A), model.harmonics.columns(1).start
    B = np.zeros((2 * n_out, A.shape[1], model.N_H))
    B[:n_out, :, cos], B[:n_out, :, cos + 1] = A.real, A.imag
    B[n_out:, :, cos], B[n_out:, :, cos + 1] = -A.imag, A.real
    return B


def first_harmonic(motion: np.ndarray, model: ReducedModel) -> np.ndarray:
    """Return cos 1 and then sin 1 of the outputs, (2 n_outputs,), of coefficients (n_outputs, N_H).  Local."""
    cos = model.harmonics.columns(1).start
    return np.concatenate([motion[:, cos], motion[:, cos + 1]])


def extended(harmonics: Harmonics) -> Harmonics:
    """Return the set of the better problem: the same, with about twice as many; odd ones alone where it has no others.  Local."""
    highest = 2 * harmonics.highest + 3
    return Harmonics.odd_up_to(highest) if all(n % 2 for n in harmonics.chosen) else Harmonics.up_to(highest)


def _residual(problem: HarmonicBalance, U: np.ndarray, parameter: float, forces: ContactForces) -> np.ndarray:
    """Return this rank's rows of (5.1), (n_owned, 3, N_H) [m].  Collective where static columns are new."""
    U_lin, _ = problem.linear_motion(parameter)
    return U - U_lin + problem.receptance_at(parameter, forces.active).apply(forces.p)


def _beyond(U: np.ndarray, of, known) -> np.ndarray:
    """Return the harmonics of ``U`` that are not known yet; the others zero.  Local."""
    return U - known.carry(of.carry(U, known), of)
