"""Counts, peaks and segments of a curve.  NumPy only."""

from __future__ import annotations

import numpy as np

from ..contact.law import OPEN, SLIP, STICK
from ..fourier.coefficients import amplitude


def counts(state: np.ndarray) -> np.ndarray:
    """Return how many pairs stick, slip and are open, (..., 3) of ``state`` (..., n_pairs).  Local."""
    return np.stack([np.count_nonzero(state == kind, axis=-1) for kind in (STICK, SLIP, OPEN)], axis=-1)


def peak(response: np.ndarray, output: int = 0) -> int | None:
    """Return the index of the point with the largest amplitude of an output, of ``response`` (n, n_outputs, N_H).  Local.

    None where the curve has no point.
    """
    return int(np.argmax(amplitude(response[:, output]))) if len(response) else None


def segments(segment: np.ndarray) -> list[slice]:
    """Return the points of each segment of a curve, from the number of the segment at each point, (n,).  Local."""
    ends = [0, *(np.flatnonzero(np.diff(segment)) + 1).tolist(), len(segment)]
    return [slice(a, b) for a, b in zip(ends[:-1], ends[1:]) if b > a]
