"""Energy that contact forces take in a cycle, whatever their law (docs/theory.md, sections 6 and 9)."""

from __future__ import annotations

import numpy as np

from ..fourier.coefficients import cycle_work
from ..fourier.harmonics import Harmonics


def pair_energy(U: np.ndarray, p: np.ndarray, harmonics: Harmonics | None = None) -> np.ndarray:
    """Return the friction loss per cycle e_i, the closed integral of T . d(du_t), (n,) [J], for (n, 3, N_H) of both.

    docs/theory.md, eq. (6.3).  Positive where energy is lost.  ``p`` may stand for T: the springs k_t do no work in
    a cycle.
    """
    return cycle_work(p[:, :2], U[:, :2], harmonics).sum(axis=1)


def contact_work(U: np.ndarray, p: np.ndarray, harmonics: Harmonics | None = None) -> np.ndarray:
    """Return the work per cycle into the pairs, normal direction included, (n,) [J].

    docs/theory.md, E of eq. (9.1).  The normal spring loses nothing; its part, the sampling error of one-sided contact, closes
    the energy balance.
    """
    return cycle_work(p, U, harmonics).sum(axis=1)
