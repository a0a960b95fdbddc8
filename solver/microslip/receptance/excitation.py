"""The time dependence of the loads, and the harmonics of the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fourier.harmonics import Harmonics
from ..messages.errors import CaseError


@dataclass(frozen=True)
class Excitation:
    """The time dependence of the loads at unit level, cos(n omega t + phase), and the harmonics of every motion."""

    shapes: tuple[tuple[int, float], ...] = ()  # harmonic n and phase [rad] of each load
    harmonics: Harmonics = Harmonics.up_to(3)

    @property
    def coefficients(self) -> np.ndarray:
        """The Fourier coefficients of the loads, (n_loads, N_H).

        Raises
        ------
        CaseError : a load acts in a harmonic that is not in the set
        """
        f = np.zeros((len(self.shapes), self.harmonics.n_coefficients))
        for row, (n, phase) in zip(f, self.shapes):
            if n not in self.harmonics:
                raise CaseError(f"[[loads]] acts in harmonic {n}, which is not one of the harmonics {self.harmonics}")
            cos_sin = np.array([np.cos(phase), -np.sin(phase)])
            row[self.harmonics.columns(n)] = cos_sin[:1] if n == 0 else cos_sin
        return f
