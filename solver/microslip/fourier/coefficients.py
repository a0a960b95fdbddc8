"""Samples of a period from the real Fourier coefficients of a set of harmonics, and back; work.

docs/theory.md, sections 5 and 6.  Coefficients run along the last axis in the order of harmonics.py: [mean, cos 1, sin 1, ...,
cos H, sin H] of the full set, which is meant where no other is named.  NumPy only; every function is local.
"""

from functools import lru_cache

import numpy as np

from .harmonics import Harmonics


@lru_cache(maxsize=64)
def synthesis_matrix(harmonics: Harmonics, N_t: int) -> np.ndarray:
    """Return E (N_t, N_H) of eq. (6.1): samples at theta_j = 2 pi j / N_t are E @ coefficients.  Read-only.

    Angles are reduced modulo one turn before the cosine, so that high harmonics lose no digits.
    """
    turns = np.outer(np.arange(N_t), harmonics.above_mean) % N_t
    E = np.empty((N_t, harmonics.n_coefficients))
    E[:, harmonics.mean] = 1.0
    E[:, harmonics.cos] = np.cos(2.0 * np.pi / N_t * turns)
    E[:, harmonics.sin] = np.sin(2.0 * np.pi / N_t * turns)
    E.flags.writeable = False
    return E


@lru_cache(maxsize=64)
def analysis_matrix(harmonics: Harmonics, N_t: int) -> np.ndarray:
    """Return F (N_H, N_t) of eq. (6.1): the discrete Fourier coefficients of samples are F @ samples; F E = I.  Read-only.

    Raises
    ------
    ValueError : with fewer than 2 H + 1 samples, H the highest, the harmonics alias into each other.
    """
    H = harmonics.highest
    if N_t < 2 * H + 1:
        raise ValueError(f"{N_t} samples cannot carry {H} harmonics; at least {2 * H + 1} are needed")
    F = synthesis_matrix(harmonics, N_t).T * (2.0 / N_t)
    F[harmonics.mean] = 1.0 / N_t
    F.flags.writeable = False
    return F


def synthesise(U: np.ndarray, N_t: int, harmonics: Harmonics | None = None) -> np.ndarray:
    """Return the samples (..., N_t) of coefficients (..., N_H)."""
    return U @ synthesis_matrix(harmonics or Harmonics.full(U.shape[-1]), N_t).T


def analyse(samples: np.ndarray, harmonics: Harmonics) -> np.ndarray:
    """Return the coefficients (..., N_H) of samples (..., N_t)."""
    return samples @ analysis_matrix(harmonics, samples.shape[-1]).T


def shifted(U: np.ndarray, phase: np.ndarray, harmonics: Harmonics) -> np.ndarray:
    """Return the coefficients (..., N_H) of u(t + phase / omega) from those of u(t); ``phase`` (...) [rad] is broadcast.

    docs/theory.md, eq. (3.16).
    """
    angle = np.asarray(phase)[..., None] * harmonics.above_mean
    cos, sin = np.cos(angle), np.sin(angle)
    of_cos, of_sin = U[..., harmonics.cos], U[..., harmonics.sin]
    there = U.copy()
    there[..., harmonics.cos] = of_cos * cos + of_sin * sin
    there[..., harmonics.sin] = of_sin * cos - of_cos * sin
    return there


def cycle_work(force: np.ndarray, U: np.ndarray, harmonics: Harmonics | None = None) -> np.ndarray:
    """Return the closed integral of force du over a period, (...), for coefficients (..., N_H) of both.

    docs/theory.md, eq. (6.3): pi sum_n n (F_cos U_sin - F_sin U_cos); means do no work.
    """
    harmonics = harmonics or Harmonics.full(U.shape[-1])
    n, cos, sin = harmonics.above_mean, harmonics.cos, harmonics.sin
    return np.pi * ((force[..., cos] * U[..., sin] - force[..., sin] * U[..., cos]) @ n)


def amplitude(coefficients: np.ndarray, n: int = 1) -> np.ndarray:
    """Return a of harmonic n of the full set, u = a cos(n omega t + phase), a >= 0; the last axis goes."""
    return np.hypot(coefficients[..., 2 * n - 1], coefficients[..., 2 * n])


def phase(coefficients: np.ndarray, n: int = 1) -> np.ndarray:
    """Return the phase of harmonic n of the full set [rad], u = a cos(n omega t + phase), in (-pi, pi].

    c cos + s sin = a cos(n omega t + phase) gives c = a cos(phase), s = -a sin(phase).
    """
    return np.arctan2(0.0 - coefficients[..., 2 * n], coefficients[..., 2 * n - 1])
