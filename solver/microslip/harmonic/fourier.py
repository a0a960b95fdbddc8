"""Real Fourier coefficients [mean, cos 1, sin 1, ..., cos H, sin H] and samples of a period.

docs/theory.md, sections 5 and 6.  Coefficients run along the last axis.  NumPy only; every function is local.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np


def n_coefficients(H: int) -> int:
    """Return N_H = 2 H + 1."""
    return 2 * H + 1


@lru_cache(maxsize=64)
def synthesis_matrix(H: int, N_t: int) -> np.ndarray:
    """Return E (N_t, N_H): samples at theta_j = 2 pi j / N_t are E @ coefficients.  Read-only.

    Angles are reduced modulo one turn before the cosine, so that high harmonics lose no digits.
    """
    turns = np.outer(np.arange(N_t), np.arange(1, H + 1)) % N_t
    E = np.empty((N_t, n_coefficients(H)))
    E[:, 0] = 1.0
    E[:, 1::2] = np.cos(2.0 * np.pi / N_t * turns)
    E[:, 2::2] = np.sin(2.0 * np.pi / N_t * turns)
    E.flags.writeable = False
    return E


@lru_cache(maxsize=64)
def analysis_matrix(H: int, N_t: int) -> np.ndarray:
    """Return F (N_H, N_t): the discrete Fourier coefficients of samples are F @ samples; F E = I.  Read-only.

    Raises
    ------
    ValueError : with fewer than 2 H + 1 samples the harmonics alias into each other.
    """
    if N_t < n_coefficients(H):
        raise ValueError(f"{N_t} samples cannot carry {H} harmonics; at least {n_coefficients(H)} are needed")
    F = synthesis_matrix(H, N_t).T * (2.0 / N_t)
    F[0] = 1.0 / N_t
    F.flags.writeable = False
    return F


def synthesise(U: np.ndarray, N_t: int) -> np.ndarray:
    """Return the samples (..., N_t) of coefficients (..., N_H)."""
    return U @ synthesis_matrix(U.shape[-1] // 2, N_t).T


def analyse(samples: np.ndarray, H: int) -> np.ndarray:
    """Return the coefficients (..., N_H) of samples (..., N_t)."""
    return samples @ analysis_matrix(H, samples.shape[-1]).T


def differentiate(U: np.ndarray) -> np.ndarray:
    """Return the coefficients of du/dtheta for coefficients ``U`` (..., N_H); times omega gives the velocity."""
    n = np.arange(1, U.shape[-1] // 2 + 1)
    rate = np.zeros_like(U)
    rate[..., 1::2] = n * U[..., 2::2]
    rate[..., 2::2] = -n * U[..., 1::2]
    return rate


def derivative_matrix(H: int) -> np.ndarray:
    """Return D (N_H, N_H) with differentiate(U) = U @ D.T."""
    return differentiate(np.eye(n_coefficients(H))).T


def cycle_work(force: np.ndarray, U: np.ndarray) -> np.ndarray:
    """Return the closed integral of force du over a period, (...), for coefficients (..., N_H) of both.

    docs/theory.md, eq. (6.3): pi sum_n n (F_cos U_sin - F_sin U_cos); means do no work.
    """
    n = np.arange(1, U.shape[-1] // 2 + 1)
    return np.pi * ((force[..., 1::2] * U[..., 2::2] - force[..., 2::2] * U[..., 1::2]) @ n)
