"""The modes of one harmonic group, projected on pairs, loads and outputs (docs/theory.md, section 4)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..fourier.harmonics import Harmonics
from .damping import Damping, DynamicFlexibility, StatedDamping


@dataclass(frozen=True, eq=False)
class ProjectedModes:
    """M-normalised modes of a pencil (K_L, M), with the projected damping matrix of the structure.  Replicated."""

    omega_n: np.ndarray  # (m,) rad/s
    R_phi: np.ndarray  # (3 n_pairs, m) participation of the pairs
    b: np.ndarray  # (m, n_loads) phi^T f
    o: np.ndarray  # (n_outputs, m) output rows times phi
    C: np.ndarray | None = None  # (m, m) phi^T C phi of the structure's damping matrix [1/s]; None: no damping matrix

    def first(self, n: int) -> ProjectedModes:
        """Return the first n modes.  Local."""
        C = None if self.C is None else self.C[:n, :n]
        return ProjectedModes(self.omega_n[:n], self.R_phi[:, :n], self.b[:n], self.o[:, :n], C)

    def ordered(self, order: np.ndarray) -> ProjectedModes:
        """Return the modes in another order, (m,) numbers of all.  Local."""
        C = None if self.C is None else self.C[np.ix_(order, order)]
        return ProjectedModes(self.omega_n[order], np.take(self.R_phi, order, 1), self.b[order], np.take(self.o, order, 1), C)

    def conjugated(self) -> ProjectedModes:
        """Return the modes of the complex conjugate matrices, as their conjugates.  Local."""
        C = None if self.C is None else self.C.conj()
        return ProjectedModes(self.omega_n, self.R_phi.conj(), self.b.conj(), self.o.conj(), C)


@dataclass(frozen=True, eq=False)
class DampedModes:
    """Modes as :class:`ProjectedModes`, with their complete damping.  Replicated."""

    omega_n: np.ndarray  # (m,) rad/s
    damping: Damping  # phi^T C phi
    R_phi: np.ndarray  # (3 n_pairs, m) participation of the pairs
    b: np.ndarray  # (m, n_loads) phi^T f
    o: np.ndarray  # (n_outputs, m) output rows times phi
    springs: np.ndarray | None = None  # (m,) [1/s2] additional stiffness in harmonic 1 only: leading_mode.py

    @property
    def zeta(self) -> np.ndarray:
        """Damping ratios at resonance, (m,) [-]: the diagonal of a full damping matrix, plus half the structural loss factor."""
        return self.viscous_ratio if self.damping.S is None else self.viscous_ratio + 0.5 * self.loss_factor

    @property
    def viscous_ratio(self) -> np.ndarray:
        """Ratios of viscous damping, (m,) [-]."""
        return self.damping.diagonal / (2.0 * self.omega_n)

    @property
    def loss_factor(self) -> np.ndarray:
        """Loss factors of structural damping, (m,) [-]."""
        return self.damping.structural_diagonal / self.omega_n**2

    def stated(self, stated: StatedDamping | None) -> np.ndarray:
        """Return the viscous damping that is stated for modes, (m,), or without it the whole C, (m,) or (m, m) [1/s].  Local."""
        return self.damping.C if stated is None else stated.modal(self.omega_n)

    def stated_part(self, stated: StatedDamping | None, factor: float) -> Damping:
        """Return the stated damping, or C, and S, times a factor.  Local."""
        return Damping(np.zeros(len(self.omega_n)), self.damping.S).with_more(factor * self.stated(stated), factor)

    def with_damping(self, sigma: float, factor: float = 1.0, stated: StatedDamping | None = None) -> DampedModes:
        """Return the same modes with the stated damping, or C, and S times a factor, plus sigma M [1/s].  Local."""
        damping = self.damping.plus(sigma)
        return replace(
            self, damping=damping if factor == 1.0 else damping.with_more((factor - 1.0) * self.stated(stated), factor)
        )

    def conjugated(self) -> DampedModes:
        """Return the modes of the complex conjugate matrices, as their conjugates.  Local."""
        damping, participations = self.damping.conjugated(), (self.R_phi.conj(), self.b.conj(), self.o.conj())
        return DampedModes(self.omega_n, damping, *participations, self.springs)

    def flexibility(self, harmonics: Harmonics, omega: float) -> DynamicFlexibility:
        """Return c_n of (4.1) for a set of harmonics at ``omega`` [rad/s].  Local."""
        return DynamicFlexibility(self.omega_n, self.damping, harmonics.numbers, omega, self.springs)
