"""Who owns what where nothing but the count decides."""

from __future__ import annotations

import numpy as np


def split_evenly(n: int, size: int) -> np.ndarray:
    """Return (size + 1,) limits that split n items over ``size`` ranks; a rank may get none.  Local."""
    return np.array([n * rank // size for rank in range(size + 1)])
