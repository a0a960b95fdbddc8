"""Rates of quantities given by their Fourier coefficients."""

from __future__ import annotations

import numpy as np

from microslip.fourier.harmonics import Harmonics


def differentiate(U: np.ndarray, harmonics: Harmonics | None = None) -> np.ndarray:
    """Return the coefficients of du/dtheta for coefficients ``U`` (..., N_H); times omega gives the velocity."""
    harmonics = harmonics or Harmonics.full(U.shape[-1])
    n, cos, sin = harmonics.above_mean, harmonics.cos, harmonics.sin
    rate = np.zeros_like(U)
    rate[..., cos] = n * U[..., sin]
    rate[..., sin] = -n * U[..., cos]
    return rate
