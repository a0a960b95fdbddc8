"""Derivatives of the outputs by all numbers of the contact law, the level, the damping and the frequency, by one adjoint.

docs/theory.md, section 11.  With chi of (11.1) a change of the contact force p + K_J U under a motion that stays changes the
outputs by -chi times it, whether friction, preload or a stiffness of a pair makes it; tau gives what a residual does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fourier.amplitudes import adjoint_times, to_complex
from ..harmonic.adjoint_solver import AdjointSolver
from ..harmonic.balance import HarmonicBalance
from ..harmonic.linearisation import Linearisation
from ..harmonic.operating_point import OperatingPoint
from ..harmonic.parameter_rates import contact_force_rates, unit_springs
from ..points.sensitivities import NUMBERS
from ..receptance.damping import Damping
from ..receptance.motions import linear_motion, modal_motion
from ..receptance.reduced_model import HarmonicGroup, ReducedModel
from ..receptance.springs import damping_quotients
from .adjoint import Adjoint
from .estimate import output_amplitude, sensitivity

EXACT = 1e-6  # relative tolerance of the adjoint
MANY = 12  # GMRES iterations for it, beyond which the next adjoints are preconditioned
STEP = 1e-5  # of the frequency, over which outputs under given forces are differences of the fourth order


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives of cos 1, then sin 1, of the outputs along solutions; n = 2 n_outputs.  The same on all ranks."""

    of_pairs: np.ndarray  # (n, n_numbers, n_pairs) by each of ``NUMBERS`` of each pair; 0 where its law does not have it
    common: np.ndarray  # (n, n_common) by each of ``COMMON``
    is_solved: bool  # the adjoint


def exact_adjoints(equation: HarmonicBalance | ReducedModel) -> AdjointSolver:
    """Return the solver of these adjoints; to be destroyed.  Local."""
    return AdjointSolver(equation.comm, EXACT, np.float64, MANY)


def sensitivities_of(
    equation: HarmonicBalance,
    at: OperatingPoint,
    U: np.ndarray,
    selected: np.ndarray,
    solver: AdjointSolver,
    known: Adjoint | None = None,
) -> Sensitivities:
    """Return the derivatives of the outputs at a solution ``U`` (n_owned, 3, N_H) with the ``selected`` pairs.

    ``known`` is an exact adjoint that error bars have solved for, perhaps that of this solution.
    Collective: an adjoint, sums and a gather.  docs/theory.md, eq. (11.5).
    """
    linear = Linearisation.of(equation, at, equation.contact_forces(U, selected, tangents=True))
    model, p = equation.model_at(at), equation.full_force(linear.forces)
    if known is not None and known.linear.equation is equation and known.linear.forces.U is U and selected.all():
        chi, tau, is_solved = known.chi, known.tau, known.is_solved
    else:
        chi, tau, is_solved = linear.solve_transposed(sensitivity(model, at.omega), solver)
    n, shape = len(chi), (len(chi), *equation.shape)
    of_modes = [ModalAdjoint.of(*of, at, tau.reshape(shape), equation) for of in _groups(model, at, p)]
    of_pairs = np.zeros((equation.n_owned, n, len(NUMBERS)))
    for i, (name, rate) in enumerate(zip(NUMBERS, contact_force_rates(equation, linear.forces, NUMBERS))):
        if rate is not None:
            of_pairs[:, :, i] = -np.einsum("qidh,idh->iq", chi.reshape(shape), rate)
        if rate is not None and name in ("k_t", "k_n") and model.stated_damping is not None:
            unit = unit_springs(equation, name)
            of_pairs[:, :, i] += sum(modes.by_springs(model, unit) for modes in of_modes)
    common = np.array([_by_level(model, at), sum(modes.by_damping(model) for modes in of_modes), _by_omega(model, at, p)])
    rates = [-linear_motion(model, 1.0, at.omega), np.zeros((3 * equation.n_owned, model.N_H)), linear.rate({"omega": 1.0})]
    common += equation.agreed_sum(np.array([tau @ rate.ravel() for rate in rates]))
    gathered = equation.gather(of_pairs)
    return Sensitivities(np.ascontiguousarray(gathered.transpose(1, 2, 0)), equation.comm.bcast(common).T, is_solved)


def _groups(model: ReducedModel, at: OperatingPoint, p: np.ndarray) -> list[tuple[HarmonicGroup, np.ndarray, np.ndarray | None]]:
    """Return each group with its modal motion (m, n_harmonics), and the factors of the outputs in harmonic 1 where it is its."""
    factors = 1.0 if model.observed is None else (1j * at.omega) ** model.observed.order
    of_outputs = np.broadcast_to(np.asarray(factors, dtype=complex), (model.n_outputs,))
    motions = modal_motion(model, at.level, at.omega, p)
    return [(group, eta, of_outputs if 1 in group.harmonics else None) for group, eta in zip(model.groups, motions)]


@dataclass(frozen=True, eq=False)
class ModalAdjoint:
    """What a change dD_n of the dynamic stiffness between the modes of a group does: Re w_n^H dD_n eta_n, all harmonics."""

    group: HarmonicGroup
    omega: float
    w: np.ndarray  # (n, m, n_harmonics)
    eta: np.ndarray  # (m, n_harmonics) modal amplitudes

    @classmethod
    def of(
        cls,
        group: HarmonicGroup,
        eta: np.ndarray,
        factors: np.ndarray | None,
        at: OperatingPoint,
        tau: np.ndarray,
        equation: HarmonicBalance,
    ) -> ModalAdjoint:
        """Return it for the adjoint ``tau`` (n, n_owned, 3, N_H); ``factors`` (n_outputs,) of the outputs.

        Collective.  docs/theory.md, eq. (11.6).
        """
        modes, model = group.receptance.modes, equation.model_at(at)
        of_group = tau.reshape(len(tau), -1, tau.shape[-1])[:, :, group.columns]
        R_owned = modes.R_phi[model.owned_rows]
        forces = equation.agreed_sum(np.array([to_complex(adjoint_times(R_owned, x)) for x in of_group]))
        if factors is not None:
            o = (factors[:, None] * modes.o).conj()
            forces[:, :, group.harmonics.chosen.index(1)] += np.concatenate([-o, 1j * o])
        c = model.flexibilities(at.omega)[model.groups.index(group)]
        squares = modes.omega_n**2
        if c.couples_modes:
            inverse = c.c + np.diag(1.0 / squares)  # D_n^-1
            w = np.einsum("qkh,hkj->qjh", forces, inverse.conj())
        else:
            w = forces * (c.c + 1.0 / squares[:, None]).conj()
        return cls(group, at.omega, w, eta)

    def by_damping(self, model: ReducedModel) -> np.ndarray:
        """Return the derivatives by a factor of the damping that a scene states, or of the damping matrix, (n,).

        Local.  docs/theory.md, eq. (11.6).
        """
        modes, n = self.group.receptance.modes, self.group.harmonics.numbers
        C_eta = Damping(modes.stated(model.stated_damping)).apply(self.eta)
        d_eta = 1j * n * self.omega * C_eta + 1j * (n > 0) * modes.damping.apply_structural(self.eta)
        return np.einsum("qmh,mh->q", self.w.conj(), d_eta).real

    def by_springs(self, model: ReducedModel, unit: np.ndarray) -> np.ndarray:
        """Return the derivatives by springs of this rank's pairs, ``unit`` (n_owned, 3), by way of the stated damping.

        Local; (n_owned, n).  docs/theory.md, eq. (11.6).
        """
        modes, stated = self.group.receptance.modes, model.stated_damping
        assert stated is not None
        x, quotients = modes.R_phi[model.owned_rows], damping_quotients(modes, stated)
        i_omega_eta = 1j * self.group.harmonics.numbers * self.omega * self.eta
        by_rows = np.empty((len(x), len(self.w)))
        for q, w in enumerate(self.w):
            W = quotients * (w.conj() @ i_omega_eta.T)
            W = W if np.iscomplexobj(x) else W.real
            by_rows[:, q] = np.einsum("ri,ri->r", x.conj() @ W, x).real
        return np.einsum("idq,id->iq", by_rows.reshape(-1, 3, len(self.w)), unit)


def _by_level(model: ReducedModel, at: OperatingPoint) -> np.ndarray:
    """Return the derivative of the outputs by the level under given contact forces, (n,).  Local."""
    none = np.zeros((3 * model.n_pairs, model.N_H))
    return output_amplitude(model, OperatingPoint(at.omega, 1.0), none)


def _by_omega(model: ReducedModel, at: OperatingPoint, p: np.ndarray) -> np.ndarray:
    """Return that by the frequency, (n,).  Local."""
    h = STEP * at.omega
    near, far = (
        output_amplitude(model, OperatingPoint(at.omega + k * h, at.level), p)
        - output_amplitude(model, OperatingPoint(at.omega - k * h, at.level), p)
        for k in (1, 2)
    )
    return (8.0 * near - far) / (12.0 * h)
