"""Frequencies of the linear curve."""

import numpy as np
import pytest
from mpi4py import MPI

from microslip.continuation import steps
from microslip.continuation.steps import arc_lengths, linear_frequencies
from microslip.messages.errors import CaseError


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


@pytest.mark.parametrize("where", [0, 1, 2])
def test_the_message_on_an_unbounded_response_names_its_frequency(where):
    motions = [np.full((1, 2), np.inf if i == where else 1.0) for i in range(3)]
    hertz = np.array([1.0, 2.0, 3.0])
    with pytest.raises(CaseError, match=rf"{hertz[where]:g} Hz lies on a resonance"), np.errstate(invalid="ignore"):
        arc_lengths(MPI.COMM_SELF, motions, 2.0 * np.pi * hertz, 1.0)
