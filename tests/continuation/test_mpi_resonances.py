"""Sharp resonances are not stepped over, however few points are requested; on any number of ranks."""

import numpy as np
import pytest
from dense_model import branch, reduced
from mpi4py import MPI
from oracles import scenes

from microslip.continuation.resonances import highest_between, unresolved_peaks
from microslip.continuation.stepping import PASSED
from microslip.continuation.steps import LinearCurve

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
STUCK, SLIPS = 1e-3, 1.0  # N


def chain(load=(1.0, 0.0, 0.0)):
    """Return three masses in a row, the last on a Jenkins element; resonances at 0.66, 1.22 and 1.73 rad/s, damped by 0.001."""
    D = np.eye(3) - np.eye(3, k=1)
    return scenes.make_system(
        "three masses",
        np.eye(3),
        D.T @ D + 0.3 * np.eye(3),
        [[2, -1, -1, -1, -1, -1]],
        mu=0.5,
        N0=2.0,
        k_t=0.2,
        k_n=1.0,
        zeta=1e-3,
        loads=[{"vector": np.array(load), "harmonic": 1, "phase": 0.0}],
        output=[1.0, 0.0, 0.0],
        omega=(0.4, 2.3),
        levels={},
    )


def curve(system, level, points, **given):
    """Return the frequencies and amplitudes of a branch that reaches the end of its range, and its notes."""
    followed = branch(system, COMM, level, H=1, n_samples=64, points=points, **given)
    assert followed.failure is None
    amplitude = np.array([np.hypot(*point.response[0, 1:3]) for point in followed.points])
    return (
        np.array([point.omega for point in followed.points]),
        amplitude,
        {note for point in followed.points for note in point.notes},
    )


def at_resonance(system, level):
    """Return the stuck frequencies [rad/s] and the exact amplitudes there of the linear response [m]."""
    K, C, omega_n = scenes.stuck_stiffness(system), scenes.damping_matrix(system), scenes.stuck_frequencies(system)
    f = level * system["loads"][0]["vector"]
    return omega_n, [abs(system["output"] @ np.linalg.solve(K - w**2 * np.eye(3) + 1j * w * C, f)) for w in omega_n]


def best_near(omega, amplitude, where):
    return amplitude[np.abs(omega - where) < 0.02 * where].max(initial=0.0)


@pytest.mark.ranks(1)
def test_two_amplitudes_of_a_mode_determine_its_peak():
    omega, center, half, c = np.array([0.8, 1.3]), 1.1, 0.003, 0.2 - 0.1j
    a, b = c / (center - omega + 1j * half)
    highest, share = highest_between(np.array([a, a]), np.array([b, a]))
    assert highest == pytest.approx([abs(c) / half, abs(a)])
    assert share[0] == pytest.approx((center - omega[0]) / (omega[1] - omega[0]))


@pytest.mark.ranks(1)
def test_amplitudes_on_one_side_of_a_peak_and_zero_amplitudes_predict_no_peak_between():
    a, b = 1.0 / (1.1 - np.array([0.8, 0.9]) + 0.003j)
    highest, share = highest_between(np.array([a, 0.0, 0.0]), np.array([b, b, 0.0]))
    assert highest == pytest.approx([abs(b), 0.0, 0.0])
    assert share[0] == 1.0


@pytest.mark.parametrize("points", [10, 17, 40])
def test_no_peak_of_a_stuck_structure_is_missed(points):
    system = chain()
    omega, amplitude, notes = curve(system, STUCK, points)
    for where, height in zip(*at_resonance(system, STUCK)):
        assert 0.7 * height < best_near(omega, amplitude, where) < 1.0001 * height
    assert notes == set()


def test_the_peak_of_a_weakly_excited_mode_is_resolved():
    """The whole motion does not change sign there: the load does not excite mode 2 except at its peak."""
    phi = reduced(chain(), COMM, 1)[0].receptance_of(1).modes.R_phi  # only for its shape
    assert phi.shape == (3, 3)
    omega_n, shapes = np.linalg.eigh(scenes.stuck_stiffness(chain()))
    system = chain(shapes @ [1.0, 0.02, 1.0])
    omega, amplitude, _ = curve(system, STUCK, 10)
    where, height = (values[1] for values in at_resonance(system, STUCK))
    assert where == pytest.approx(np.sqrt(omega_n[1]))
    assert best_near(omega, amplitude, where) > 0.7 * height


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_no_peak_is_missed_where_the_slider_slips():
    system = chain()
    few, amplitude, _ = curve(system, SLIPS, 10)
    omega, dense, _ = curve(system, SLIPS, 100)
    tops = 1 + np.flatnonzero((dense[1:-1] > dense[:-2]) & (dense[1:-1] > dense[2:]))
    assert len(tops) == 3
    for top in tops:
        assert best_near(few, amplitude, omega[top]) > 0.7 * dense[top]


def test_a_peak_passed_over_by_the_shortest_step_is_noted():
    _, _, notes = curve(chain(), STUCK, 10, ds_min=1.0)
    assert notes == {PASSED}


@pytest.mark.ranks(1)
def test_points_that_resolve_the_peaks_do_not_change(monkeypatch):
    system = scenes.jenkins_mass()
    guarded = curve(system, 0.8, 60)
    monkeypatch.setattr("microslip.continuation.stepping.passed_over", lambda *of: None)
    free = curve(system, 0.8, 60)
    assert np.array_equal(guarded[0], free[0])
    assert np.array_equal(guarded[1], free[1])


@pytest.mark.ranks(1)
def test_peaks_of_the_linear_curve_between_the_points_are_listed():
    omega = np.linspace(1.0, 2.0, 2001)
    u = 1.0 / (1.2**2 - omega**2 + 0.01j) + 0.3 / (1.7**2 - omega**2 + 0.01j)
    response = np.stack([0.0 * omega, u.real, -u.imag], axis=-1)[:, None]
    linear = LinearCurve(omega, response, omega, 0.0 * omega)
    assert unresolved_peaks(linear, np.array([1.0, 1.5, 2.0])) == pytest.approx([1.2, 1.7], abs=1e-3)
    assert unresolved_peaks(linear, np.array([1.0, 1.2, 2.0])) == pytest.approx([1.7], abs=1e-3)
