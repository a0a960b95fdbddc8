"""The parts of an error bar.  NumPy only."""

from __future__ import annotations

import numpy as np

PARTS = ("modes", "harmonics", "samples", "pairs", "solver", "sliders")
SAFETY = 3.0  # of the bar over the sum of its parts, which are estimates to first order


def total(parts: np.ndarray) -> np.ndarray:
    """Return the error bars, (...), of parts (..., len(PARTS)): the radius in the complex plane of where the amplitude may be."""
    return SAFETY * parts.sum(axis=-1)
