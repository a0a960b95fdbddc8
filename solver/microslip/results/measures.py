"""Amplitude, phase and counts from harmonic coefficients and states.  NumPy only.

Coefficients run mean, cos 1, sin 1, ..., cos H, sin H along the last axis.
"""

from __future__ import annotations

import numpy as np

from ..contact.law import OPEN, SLIP, STICK


def amplitude(coefficients: np.ndarray, n: int = 1) -> np.ndarray:
    """Return a of harmonic n, u = a cos(n omega t + phase), a >= 0; the last axis goes.  Local."""
    return np.hypot(coefficients[..., 2 * n - 1], coefficients[..., 2 * n])


def phase(coefficients: np.ndarray, n: int = 1) -> np.ndarray:
    """Return the phase of harmonic n [rad], u = a cos(n omega t + phase), in (-pi, pi].  Local.

    c cos + s sin = a cos(n omega t + phase) gives c = a cos(phase), s = -a sin(phase).
    """
    return np.arctan2(0.0 - coefficients[..., 2 * n], coefficients[..., 2 * n - 1])


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
