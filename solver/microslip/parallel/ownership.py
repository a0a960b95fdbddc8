"""Who owns what where nothing but the count decides, and which rows belong to what."""

from __future__ import annotations

import numpy as np


def split_evenly(n: int, size: int) -> np.ndarray:
    """Return (size + 1,) limits that split n items over ``size`` ranks; a rank may get none.  Local."""
    return np.array([n * rank // size for rank in range(size + 1)])


def rows_of(those: np.ndarray) -> np.ndarray:
    """Return the three rows of each of some pairs or places (m,), (3 m,).  Local."""
    return (3 * np.asarray(those)[:, None] + np.arange(3)).ravel()
