"""Frequencies of the linear curve."""

import numpy as np

from microslip.continuation import steps
from microslip.continuation.steps import linear_frequencies


def length(omega, omega_n, zeta):
    """Return the length of the curve of a sum of resonances, relative to its amplitude, as in the norm of steps."""
    u = np.linspace(0.5, 1.5, len(omega_n)) / (omega_n**2 - omega[:, None] ** 2 + 2j * zeta * omega_n * omega[:, None])
    return np.sum(np.linalg.norm(np.diff(u, axis=0), axis=1) / np.linalg.norm(0.5 * (u[1:] + u[:-1]), axis=1))


def test_many_close_resonances_share_their_points(monkeypatch):
    """Close resonances of blades: a fraction of the points gives the same length of the curve."""
    omega_n, zeta = 100.0 + np.random.default_rng(0).uniform(-0.6, 0.6, 20), np.full(20, 1e-3)
    shared = linear_frequencies(99.0, 101.0, omega_n, zeta)
    monkeypatch.setattr(steps, "MANY_RESONANCES", len(omega_n))
    every = linear_frequencies(99.0, 101.0, omega_n, zeta)
    assert len(shared) < 0.25 * len(every) and np.isin(shared, every).all()
    assert (shared[0], shared[-1]) == (99.0, 101.0)
    assert abs(length(shared, omega_n, zeta) / length(every, omega_n, zeta) - 1.0) < 2e-3
