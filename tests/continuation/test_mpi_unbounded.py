"""Undamped motions: they grow without bound at a resonance, and do not pass through zero at other frequencies.

A single pair leaves ranks without one.
"""

import numpy as np
import pytest
from dense_model import amplitude, branch
from mpi4py import MPI
from oracles import scenes
from verification import extreme_structures as structures

from microslip.contact.law import SLIP
from microslip.continuation import acceptance, corrector
from microslip.continuation.ways_out import BEYOND

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
STIFFER = 3.0  # N/m, the contact stiffness; the mass is 1 kg, its spring 1 N/m
LEVEL = 0.3  # N, a third of the level that lifts the mass off at rest


def bouncing_mass():
    """Return an undamped mass pressed on the ground, from which it lifts off."""
    return scenes.make_system(
        "bouncing mass",
        np.eye(1),
        np.eye(1),
        [[-1, -1, 0, -1, -1, -1]],
        mu=0.0,
        N0=1.0,
        k_t=1e-3,
        k_n=STIFFER,
        C=np.zeros((1, 1)),
        loads=[{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}],
        output=[1.0],
        omega=(1.1, 2.6),
        levels={},
    )


def falling(system):
    return branch(system, COMM, LEVEL, points=20, down=True, tolerance=1e-8)


def test_a_branch_starts_again_beyond_an_unbounded_resonance():
    """At large amplitudes the preload is negligible: half a period is with the contact stiffness, half without it."""
    curve, resonance = falling(bouncing_mass()), 2.0 / (1.0 + 1.0 / np.sqrt(1.0 + STIFFER))
    assert curve.failure is None
    (first,) = (i for i, point in enumerate(curve.points) if BEYOND in point.notes)
    before, beyond = curve.points[:first], curve.points[first:]
    assert max(map(amplitude, before)) > 1e6
    assert before[-1].omega == pytest.approx(resonance, rel=1e-3)  # three harmonics
    for point in beyond:
        assert point.omega < resonance and (point.state == SLIP).all()  # closed, without friction
        assert amplitude(point) == pytest.approx(LEVEL / (1.0 + STIFFER - point.omega**2), rel=1e-7)


def test_points_near_an_unbounded_resonance_have_a_tighter_tolerance(monkeypatch):
    """At the tolerance of the scene, input and losses differ at much smaller amplitudes."""
    monkeypatch.setattr(acceptance, "SHARPEST", 1.0)
    assert max(map(amplitude, falling(bouncing_mass()).points)) < 1e5


def test_a_stuck_motion_may_pass_through_zero():
    """Where both masses move alike the joint is not deformed: (k - omega^2 m) u = f for each of them."""
    system, equal_motion = structures.two_masses(zeta=0.0), np.sqrt(2.0 / 1.1)
    curve = branch(system, COMM, 1e-3, low=1.2, high=1.5, H=1, points=10)
    assert curve.failure is None and len(curve.points) < 40
    motion = COMM.bcast([float(point.U[0, 0, 1]) for point in curve.points] if COMM.rank == 0 else None)
    omega = np.array([point.omega for point in curve.points])
    assert np.array_equal(np.sign(motion), np.sign(motion[0]) * np.where(omega < equal_motion, 1.0, -1.0))


@pytest.mark.ranks(1)
def test_the_motion_is_accurate_where_the_residual_alone_permits_larger_errors(monkeypatch):
    """A pair without friction slides at once, and its motion is that of the structure without tangential springs."""
    system, bound = structures.chain(mu=0.0, N0=1e3), 1e-8 * corrector.SHARP
    sliding, C = system["K"] + system["R"].T @ np.diag([0.0, 0.0, 1.0] * 2) @ system["R"], scenes.damping_matrix(system)

    def error(point):
        Z = sliding - point.omega**2 * system["M"] + 1j * point.omega * C
        du = (system["R"] @ np.linalg.solve(Z, system["loads"][0]["vector"])).reshape(2, 3)
        return np.linalg.norm(point.U[..., 1] - 1j * point.U[..., 2] - du) / np.linalg.norm(du)

    def worst():
        curve = branch(system, COMM, 1.0, low=0.35, high=0.7, H=1, n_samples=32, points=10, tolerance=1e-8)
        assert curve.failure is None
        return max(map(error, curve.points))

    sharp = worst()
    monkeypatch.setattr(corrector, "SHARP", np.inf)
    assert sharp < bound < 0.5 * worst()
