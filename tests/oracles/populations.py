"""Steady states of a mass on a pair of rough surfaces, or on an Iwan element, marched in time with separate populations.

Nothing of the solver is used: the densities are summed at midpoints, much finer than its elements, in leapfrog integration.
"""

from __future__ import annotations

import numpy as np


def rough(mu, N0, k_t, k_n, exponent, n=600, most=4.0):
    """Return a law (u, w) -> force (3,) and sliders (n, 2), of asperities whose density is the curvature of N(approach).

    Exponential: N = N0 exp(x k_n / N0), from 14 N0 / k_n below rest to ``most`` above; power: N0 (1 + x k_n / (m N0))^m.
    """
    unit = N0 / k_n
    ends = np.linspace(-14.0 if np.isinf(exponent) else -exponent, most, n + 1) * unit
    gap, width = 0.5 * (ends[1:] + ends[:-1]), np.diff(ends)
    if np.isinf(exponent):
        pressure, stiffness = (lambda x: N0 * np.exp(x / unit)), k_n * np.exp(ends / unit)
    else:
        base = lambda x: np.maximum(1.0 + x / (exponent * unit), 0.0)  # noqa: E731
        pressure, stiffness = (lambda x: N0 * base(x) ** exponent), k_n * base(ends) ** (exponent - 1.0)
    k = np.diff(stiffness)
    assert np.all(width > 0.0) and np.all(k >= 0.0)

    def law(u, w):
        limit = mu * np.maximum(k * (-u[2] - gap), 0.0)
        T = (k_t / k_n * k)[:, None] * (u[:2] - w)
        size = np.hypot(T[:, 0], T[:, 1])
        T *= np.where(size > limit, limit / np.where(size > 0.0, size, 1.0), 1.0)[:, None]
        w = u[:2] - T / (k_t / k_n * k)[:, None]
        return np.append(T.sum(axis=0), N0 - pressure(-u[2])), w

    return law, n


def iwan(F_S, K_T, k_n, chi, beta, n=600):
    """Return a law with sliders of the density phi^chi up to phi_max, and one slider at its end."""
    phi_max = F_S * (1.0 + beta) / (K_T * (beta + (chi + 1.0) / (chi + 2.0)))
    ends = phi_max * np.linspace(0.0, 1.0, n) ** 3  # fine where the density is high
    k = np.diff(ends ** (chi + 1.0)) * K_T / (1.0 + beta) / phi_max ** (chi + 1.0)
    k, phi = np.append(k, K_T * beta / (1.0 + beta)), np.append(0.5 * (ends[1:] + ends[:-1]), phi_max)

    def law(u, w):
        r = np.clip(u[:2] - w, -phi[:, None], phi[:, None])
        return np.append((k[:, None] * r).sum(axis=0), k_n * u[2]), u[:2] - r

    return law, n


def on_pairs(R, populations):
    """Return the law of several pairs with motions R u, (3 n_pairs,)."""
    ends = np.cumsum([0, *(n for _, n in populations)])

    def law(u, w):
        motions = (R @ u).reshape(-1, 3)
        forces, sliders = zip(*(of(du, w[a:b]) for (of, _), du, a, b in zip(populations, motions, ends[:-1], ends[1:])))
        return R.T @ np.concatenate(forces), np.concatenate(sliders)

    return law, ends[-1]


def steady_state(M, C, K, force, omega, population, n_steps=1000, periods=30):
    """Return u (n_steps, n_dof) over a period of M u'' + C u' + K u + f(u) = force(omega t), from rest by leapfrog; M and C diagonal."""
    law, n = population
    h, u, v, w = 2.0 * np.pi / omega / n_steps, np.zeros(len(M)), np.zeros(len(M)), np.zeros((n, 2))
    M, C = np.diag(M), np.diag(C)
    for _ in range(periods):
        recorded = []
        for i in range(n_steps):
            recorded.append(u)
            f, w = law(u, w)
            v = ((M / h - 0.5 * C) * v + force(2.0 * np.pi * i / n_steps) - K @ u - f) / (M / h + 0.5 * C)
            u = u + h * v
    return np.array(recorded)
