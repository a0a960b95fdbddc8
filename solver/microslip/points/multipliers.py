"""Recorded Floquet multipliers: how many, and which are unstable.  NumPy only."""

from __future__ import annotations

import numpy as np

N_MULTIPLIERS = 6  # of a point
BEYOND = 1e-4  # of the unit circle: a multiplier beyond is unstable; errors of steps and samples are smaller


def n_unstable(multipliers: np.ndarray) -> int:
    """Return how many multipliers are unstable, of their real and imaginary parts (n, 2).  Local."""
    return int(np.count_nonzero(np.hypot(*multipliers.T) > 1.0 + BEYOND))


def is_stable(multipliers: np.ndarray) -> bool:
    """Return whether no multiplier is unstable.  Local."""
    return n_unstable(multipliers) == 0
