"""Settings of a reduction, as plain values in SI units."""

from dataclasses import dataclass

import numpy as np

from ..points.band import Band
from ..receptance.excitation import Excitation


@dataclass(frozen=True, kw_only=True)
class ModalDamping:
    """Damping ratios of the modes of the stuck structure, or Rayleigh's alpha M + beta K_L, plus a loss factor of the bodies.

    Without ``ratio``, modes beyond the list ``ratios`` have its last value.
    """

    ratio: float | None = None  # of all modes without an entry in ``ratios`` or ``of_modes``
    rayleigh: tuple[float, float] | None = None  # 1/s, s
    ratios: tuple[float, ...] = ()  # of modes 1, 2, ...
    of_modes: tuple[tuple[int, float], ...] = ()  # number of a mode from 1, its ratio
    structural: float = 0.0  # loss factor eta of K, without the springs of the joints

    def ratios_of(self, n_modes: int) -> np.ndarray:
        """Return the damping ratios of modes 1 to ``n_modes``, (n_modes,) [-]."""
        last = self.ratios[-1] if self.ratios else 0.0
        ratios = np.full(n_modes, last if self.ratio is None else self.ratio)
        ratios[: len(self.ratios)] = self.ratios[:n_modes]
        for mode, ratio in self.of_modes:
            ratios[mode - 1 : mode] = ratio
        return ratios

    def modal(self, omega_n: np.ndarray) -> np.ndarray:
        """Return phi^H C phi, (n_modes,) [1/s]: 2 zeta omega_n, or alpha + beta omega_n^2 of C = alpha M + beta K_L."""
        if self.rayleigh is None:
            return 2.0 * self.ratios_of(len(omega_n)) * omega_n
        alpha, beta = self.rayleigh
        return alpha + beta * omega_n**2


@dataclass(frozen=True, kw_only=True)
class ReductionSettings:
    """A method, its modes and the loads."""

    method: str = "receptance"
    modes: int | None = None  # number as stated; None: the smallest number that meets the accuracy
    accuracy: float = 1e-3  # of the response, relative to its linear peak
    insists: bool = False  # whether the accuracy was stated
    verify_modes: bool = True  # verify by a count that no mode is missed
    excitation: Excitation = Excitation()  # the loads for which modes are chosen
    damping: ModalDamping | None = None  # None: the structure has a damping matrix
    band: Band = Band()
    level: float = 1.0  # highest level [N]
    interface_modes: int = 40  # shapes of the joint
    condensed: bool = False  # rubin with relative interface DOFs only
    in_point_check: bool = False  # adaptive methods check all pairs inside the point
    energy_tolerance: float = 1e-10  # J per cycle and pair
    where: str = ""  # the scene file, for messages
