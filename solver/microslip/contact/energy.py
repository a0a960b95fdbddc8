"""Energy dissipated by contact forces per cycle, for any contact law (docs/theory.md, sections 6 and 9)."""

from __future__ import annotations

import numpy as np

from ..fourier.coefficients import cycle_work
from ..fourier.harmonics import Harmonics


def pair_energy(U: np.ndarray, p: np.ndarray, harmonics: Harmonics | None = None) -> np.ndarray:
    """Return the friction loss per cycle e_i, the closed integral of T . d(du_t), (n,) [J].

    ``U`` and ``p`` are (n, 3, N_H).  docs/theory.md, eq. (6.3).  The loss is positive where energy is dissipated.  ``p`` may
    replace T: the springs k_t do no work in a cycle.
    """
    return cycle_work(p[:, :2], U[:, :2], harmonics).sum(axis=1)


def contact_work(U: np.ndarray, p: np.ndarray, harmonics: Harmonics | None = None) -> np.ndarray:
    """Return the work per cycle done on the pairs, including the normal direction, (n,) [J].

    docs/theory.md, E of eq. (9.1).  The normal spring dissipates no energy; its contribution is the sampling error of one-sided
    contact and closes the energy balance.
    """
    return cycle_work(p, U, harmonics).sum(axis=1)
