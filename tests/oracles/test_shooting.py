"""Steady states by shooting (shooting.py) compared with exact solutions, the other oracles and plain time integration."""

from __future__ import annotations

import numpy as np
import pytest

from . import exact, path, scenes, shooting, time_integration


@pytest.mark.parametrize("omega", [1.12, 1.2, 1.3])
def test_the_jenkins_mass_converges_to_second_order(omega):
    point = shooting.Point(scenes.jenkins_mass(), 0.8, omega)
    a = exact.jenkins_steady_state(omega, 0.8, m=1.0, c=0.02, k=1.0, k_t=1.0, muN=1.0).harmonics(1)
    errors, x = [], np.zeros(4)
    for N in (256, 1024):
        steady = point.steady(x, N)
        x = steady.x
        assert steady.distance < 1e-9
        errors.append(abs(steady.amplitude - (a[1] - 1j * a[2])) / np.hypot(*a[1:3]))
    assert errors[1] < 5e-5 and errors[0] / errors[1] > 8.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spatial", "chain"])
def test_circles_varying_normal_force_and_lift_off_agree_with_a_march_from_rest(name):
    system = scenes.SCENES[name]()
    level, omega, states = max(system["levels"].values())
    march = time_integration.steady_state(system, omega, level, n_steps=128, tolerance=1e-5, scheme="exponential")
    point, (u, v, T) = shooting.Point(system, level, omega), march.restart
    u_lin = point.respond(scenes.force_coefficients(system, level, 2))
    y, dy = u - u_lin[:, 0] - u_lin[:, 1::2].sum(axis=1), v - omega * u_lin[:, 2::2] @ [1, 2]
    p_t = T - system["k_t"][:, None] * (system["R"] @ u).reshape(-1, 3)[:, :2]
    steady, other = point.steady(np.concatenate([y, dy, p_t.ravel()]), 512), system["output"] @ march.u_hat
    assert abs(steady.amplitude - (other[1] - 1j * other[2])) < 3e-3 * np.hypot(*other[1:3])
    assert steady.mean == pytest.approx(other[0], abs=3e-3 * np.hypot(*other[1:3]))
    assert 2 in states and np.array_equal(steady.moved, np.array(states) > 0)


def test_a_stuck_motion_is_linear_to_rounding():
    system = scenes.chain()
    point = shooting.Point(system, 1e-3, 560.0)
    steady = point.steady(np.zeros(18 + 4), 64)
    assert steady.amplitude == pytest.approx(point.out_lin[1] - 1j * point.out_lin[2], rel=1e-12) and not steady.moved.any()


@pytest.mark.parametrize("separate", [False, True])
def test_sliders_under_a_given_motion_agree_with_the_path_law(separate):
    """They differ in the rotation of slip, by second order of the step; not at all with separate limits."""
    rng, m = np.random.default_rng(7), 12
    U = rng.normal(size=(m, 3, 7)) * [[[1.0], [1.0], [0.4]]]
    system = scenes.make_system(
        "pairs",
        np.eye(3 * m),
        np.eye(3 * m),
        [[3 * i, 3 * i + 1, 3 * i + 2, -1, -1, -1] for i in range(m)],
        mu=rng.uniform(0.2, 0.8, m),
        N0=rng.uniform(0.3, 3.0, m),
        k_t=rng.uniform(0.5, 2.0, m),
        k_n=rng.uniform(0.5, 2.0, m),
        separate=separate,
        zeta=0.01,
        loads=[{"vector": np.ones(3 * m), "harmonic": 1, "phase": 0.0}],
        output=np.eye(3 * m)[0],
        omega=(0.0, 1.0),
        levels={},
    )
    point, k_t, differences = shooting.Point(system, 1.0, 0.5), system["k_t"], []
    for N in (64, 256):
        du = np.moveaxis(U @ scenes.harmonic_basis(3, N), -1, 0)
        cycle = path.steady(du, system["N0"] - system["k_n"] * du[:, :, 2], k_t, system["mu"], system["separate"])
        assert (cycle.change < 1e-10).all()
        differences.append(
            np.abs(point.sliders(du.reshape(N, -1)).reshape(m, 2) - cycle.T[0] + k_t[:, None] * du[0, :, :2]).max()
        )
    assert differences[1] < (1e-12 if separate else 5e-3) and (separate or differences[0] > 8.0 * differences[1])


def test_drifting_sliders_reach_their_steady_state_at_once():
    """The state that plain time integration reaches after many periods is reached by Newton's method at once."""
    system = scenes.spatial_mass()
    level, omega, _ = max(system["levels"].values())
    point = shooting.Point(system, level, omega)
    steady = point.steady(np.zeros(8), 256)
    x = np.zeros(8)
    for _ in range(400):
        x = point.period(x, 256)[0][0]
    assert np.abs((x - steady.x) / point.scale).max() < 1e-7
