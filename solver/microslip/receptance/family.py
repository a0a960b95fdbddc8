"""A modal family: the modes that answer in some harmonics, as pairs, loads and outputs see them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..fourier.harmonics import Harmonics
from .damping import Damping, DynamicFlexibility


def every_harmonic(n: int) -> bool:
    """Tell that harmonic n belongs to the family."""
    return True


@dataclass(frozen=True, eq=False)
class ModalFamily:
    """Modes of one (K_L, M), M-normalised, their damping and participations (docs/theory.md, section 4).  Replicated."""

    omega_n: np.ndarray  # (m,) rad/s
    damping: Damping  # phi^T C phi
    R_phi: np.ndarray  # (3 n_pairs, m) participation of the pairs
    b: np.ndarray  # (m, n_loads) phi^T f
    o: np.ndarray  # (n_outputs, m) output rows times phi
    serves: Callable[[int], bool] = every_harmonic  # whether harmonic n moves these modes

    @property
    def zeta(self) -> np.ndarray:
        """Damping ratios at resonance, (m,) [-]; of a full damping its diagonal, of structural damping half the loss factor."""
        return self.viscous_ratio if self.damping.S is None else self.viscous_ratio + 0.5 * self.loss_factor

    @property
    def viscous_ratio(self) -> np.ndarray:
        """Ratios of viscous damping, (m,) [-]."""
        return self.damping.diagonal / (2.0 * self.omega_n)

    @property
    def loss_factor(self) -> np.ndarray:
        """Loss factors of structural damping, (m,) [-]."""
        return self.damping.structural_diagonal / self.omega_n**2

    def with_damping(self, sigma: float) -> ModalFamily:
        """Return the same modes with sigma M [1/s] added to the damping matrix.  Local."""
        return replace(self, damping=self.damping.plus(sigma))

    def flexibility(self, harmonics: Harmonics, omega: float) -> DynamicFlexibility:
        """Return c_n of (4.1) of a set of harmonics at ``omega`` [rad/s].  Local."""
        return DynamicFlexibility(self.omega_n, self.damping, harmonics.numbers, omega)


@dataclass(frozen=True, eq=False)
class Share:
    """What one family serves of a set of harmonics."""

    family: ModalFamily
    harmonics: Harmonics
    columns: slice | np.ndarray  # of their coefficients among those of the whole set; a slice where it is all of them


def shared_out(families: tuple[ModalFamily, ...], harmonics: Harmonics) -> tuple[Share, ...]:
    """Return the shares of the families that serve any of the harmonics; each harmonic has exactly one family.  Local."""
    shares = []
    for family in families:
        served = [n for n in harmonics.chosen if family.serves(n)]
        columns = [np.r_[harmonics.columns(n)] for n in served]
        if len(served) == len(harmonics):
            shares.append(Share(family, harmonics, slice(None)))
        elif served:
            shares.append(Share(family, Harmonics(tuple(served)), np.concatenate(columns)))
    assert sorted(n for share in shares for n in share.harmonics.chosen) == list(harmonics.chosen), "one family a harmonic"
    return tuple(shares)
