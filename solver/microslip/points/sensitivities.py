"""Recorded derivatives of the outputs: the numbers, and the derivatives of amplitudes and phases.  NumPy only."""

from __future__ import annotations

import numpy as np

NUMBERS = ("mu", "N0", "k_t", "k_n", "slip_force")  # of each pair
COMMON = ("level", "damping", "omega")  # of the structure and its loads; the second is a factor of the damping of the modes
OF_PEAK = ("amplitude", "phase", "frequency")


def of_size(cos: np.ndarray, sin: np.ndarray, d_cos: np.ndarray, d_sin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of amplitude and phase of u = amplitude cos(omega t + phase) from those of cosine and sine.

    Local.  Arrays of a common shape; 0 where nothing moves.
    """
    size2 = cos**2 + sin**2
    safe = np.where(size2 > 0.0, size2, 1.0)
    return (cos * d_cos + sin * d_sin) / np.sqrt(safe), (sin * d_cos - cos * d_sin) / safe
