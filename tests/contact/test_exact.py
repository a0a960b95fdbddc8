"""Sampled contact loops compared with exact results; the numbers are those of the project's validation collection."""

from dataclasses import replace

import numpy as np
import pytest
from numpy_oracle import pair_harmonics
from oracles.fourier import differentiate

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.energy import contact_work, pair_energy
from microslip.contact.law import OPEN, SLIP, STICK
from microslip.fourier.coefficients import synthesise


def joint(n=1, mu=0.5, N0=6.0, k_t=2.0, k_n=4.0, separate=False, w0=(0.0, 0.0)):
    ones = np.ones(n)
    return ElasticCoulomb(mu * ones, N0 * ones, k_t * ones, k_n * ones, np.full(n, separate), w0)


def motion(n=1, H=1, **coefficients):
    """Return harmonics (n, 3, 2 H + 1) from x=, y=, z= lists of leading coefficients."""
    U = np.zeros((n, 3, 2 * H + 1))
    for name, values in coefficients.items():
        U[:, "xyz".index(name), : len(values)] = values
    return U


def friction(U, law, N_t):
    """Return the harmonics of T, (n, 2, N_H)."""
    return law.cycle(U, N_t).p[:, :2] + law.k_t[:, None, None] * U[:, :2]


@pytest.mark.parametrize("separate", [False, True])
@pytest.mark.parametrize("X", [1.6, 3.0, 5.0, 50.0])
def test_loop_dissipates_4_mu_N0_times_the_slip(X, separate):
    U, law = motion(x=[0.0, X]), joint(separate=separate)
    cycle = law.cycle(U, 4096)
    assert cycle.state[0] == SLIP
    assert pair_energy(U, cycle.p)[0] == pytest.approx(4.0 * 3.0 * (X - 1.5), rel=1e-5)


@pytest.mark.parametrize("X", [0.0, 0.3, 1.499999999])
def test_below_the_limit_the_loss_and_p_are_exactly_zero(X):
    cycle = joint().cycle(motion(H=3, x=[0.0, X]), 128)
    assert cycle.state[0] == STICK and len(cycle.active) == 0 and cycle.P.shape == (0, 21, 21)
    assert np.all(cycle.p == 0.0)


def test_harmonic_of_a_jenkins_element_converges_with_samples():
    """The error depends on the samples relative to the corners of the loop; its envelope falls as N_t^-2."""
    U, exact = motion(x=[0.0, 5.0]), np.array([0.0, 2.5231578773, -2.6738030439])  # f ~ a1 cos - b1 sin
    for base in (128, 512, 2048):
        N_t = np.arange(base, base + 64, 2)
        errors = [np.abs(friction(U, joint(), n)[0, 0] - exact).max() for n in N_t]
        assert 14.0 < np.max(errors * N_t**2) < 18.0


def test_forces_and_loss_of_a_circular_path():
    """The slider moves on a circle of radius sqrt(X^2 - d^2), its spring tangent to it."""
    X, d, muN, k_t = 5.0, 1.5, 3.0, 2.0
    U = motion(x=[0.0, X, 0.0], y=[0.0, 0.0, X])
    T = friction(U, joint(), 16384)[0]
    along, across = k_t * d**2 / X, muN * np.sqrt(1.0 - (d / X) ** 2)
    assert np.allclose(T, [[0.0, along, -across], [0.0, across, along]], atol=2e-3)
    loss = pair_energy(U, joint().cycle(U, 16384).p)[0]
    assert loss == pytest.approx(2.0 * np.pi * muN * np.sqrt(X**2 - d**2), rel=1e-3)


def test_rotating_the_path_rotates_the_force_and_its_derivative():
    rng = np.random.default_rng(2)
    U, law = rng.standard_normal((30, 3, 7)), joint(30, N0=2.0, k_n=1.0)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    plain, turned = law.cycle(U, 64), law.cycle(turn @ U, 64)
    all_turn = np.kron(turn, np.eye(7))
    assert np.allclose(turned.p, turn @ plain.p, atol=1e-12) and np.array_equal(turned.state, plain.state)
    assert np.array_equal(turned.active, plain.active) and len(plain.active) == 30
    assert np.allclose(turned.P, all_turn @ plain.P @ all_turn.T, atol=1e-11)


def loop_area(corners):
    u, T = np.array(corners).T
    return 0.5 * abs(np.dot(u, np.roll(T, -1)) - np.dot(T, np.roll(u, -1)))


def test_loss_with_a_normal_load_in_phase_with_the_motion():
    """u = X cos, N = N0 + gamma u: a loop with inclined friction sides, exact by its corners."""
    X, mu, N0, k_t, gamma = 5.0, 0.5, 6.0, 2.0, 0.8
    down = (k_t * X - mu * (2.0 * N0 + gamma * X)) / (k_t + mu * gamma)
    up = (2.0 * mu * N0 - (k_t + mu * gamma) * X) / (k_t - mu * gamma)
    corners = [(u, sign * mu * (N0 + gamma * u)) for u, sign in ((X, 1), (down, -1), (-X, -1), (up, 1))]
    U = motion(x=[0.0, X], z=[0.0, -gamma * X / 4.0])
    cycle = joint(mu=mu, N0=N0, k_t=k_t).cycle(U, 4096)
    assert cycle.state[0] == SLIP
    assert pair_energy(U, cycle.p)[0] == pytest.approx(loop_area(corners), rel=1e-5)


def test_friction_is_zero_while_the_pair_is_open():
    """The same loop with gamma X > N0: the pair opens below u = -N0 / gamma, and closes again without tangential force."""
    X, mu, N0, k_t, gamma = 5.0, 0.5, 6.0, 2.0, 2.0
    down = (k_t * X - mu * (2.0 * N0 + gamma * X)) / (k_t + mu * gamma)
    corners = [(X, mu * (N0 + gamma * X)), (down, -mu * (N0 + gamma * down)), (-N0 / gamma, 0.0)]
    U = motion(x=[0.0, X], z=[0.0, -gamma * X / 4.0])
    cycle = joint(mu=mu, N0=N0, k_t=k_t).cycle(U, 4096)
    assert cycle.state[0] == OPEN
    assert pair_energy(U, cycle.p)[0] == pytest.approx(loop_area(corners), rel=1e-4)
    assert contact_work(U, cycle.p)[0] == pytest.approx(pair_energy(U, cycle.p)[0], rel=1e-4)


def test_normal_force_of_an_opening_pair():
    """f_z = min(k_n du_z, N0) for du_z = Z cos: mean and first harmonic of the clipped cosine."""
    k_n, N0, Z = 4.0, 6.0, 4.0
    th = np.arccos(N0 / (k_n * Z))  # closed from th to 2 pi - th
    mean = (N0 * th - k_n * Z * np.sin(th)) / np.pi
    first = (k_n * Z * (np.pi - th - np.sin(th) * np.cos(th)) + 2.0 * N0 * np.sin(th)) / np.pi
    p = joint().cycle(motion(z=[0.0, Z]), 8192).p[0]
    assert np.allclose(p[2] + [0.0, k_n * Z, 0.0], [mean, first, 0.0], atol=1e-5)


def test_force_of_a_pair_open_in_the_whole_cycle():
    """Open in the whole cycle, a pair with a preload loses it: f_z = N0; a pair with a gap has none to lose: f_z = 0."""
    U = motion(x=[0.0, 1.0], z=[100.0, 0.5])
    for N0, f_z in ((6.0, 6.0), (-6.0, 0.0)):
        cycle = joint(N0=N0).cycle(U, 64)
        assert cycle.state[0] == OPEN
        assert np.allclose(cycle.p[0], [[0.0, -2.0, 0.0], [0.0] * 3, [f_z - 400.0, -2.0, 0.0]], atol=1e-12)
        assert np.allclose(cycle.P[0], np.diag([-2.0] * 6 + [-4.0] * 3), atol=1e-13)


def test_a_gap_closed_in_the_whole_cycle_has_a_constant_p():
    """Closed by 5 N/k_n beyond the gap, the pair is linear about f_z = k_n (du_z + g0): p is constant."""
    cycle = joint(N0=-6.0).cycle(motion(z=[-11.0 / 4.0, 0.5]), 64)
    assert cycle.state[0] == STICK and cycle.active.tolist() == [0]
    assert np.allclose(cycle.p[0], [[0.0] * 3, [0.0] * 3, [6.0, 0.0, 0.0]], atol=1e-14)
    assert np.abs(cycle.P).max() < 1e-14


def test_separate_limits_are_two_elements_along_the_axes():
    U = motion(H=2, x=[0.2, 3.0, 1.0, 0.5], y=[-0.1, 1.0, -4.0, 0.0, 0.3])
    both = joint(separate=True).cycle(U, 128).p
    for a, name in enumerate("xy"):
        alone = joint().cycle(motion(H=2, **{name: U[0, a]}), 128).p
        assert np.allclose(both[0, a], alone[0, a], atol=1e-13)
    assert not np.allclose(both, joint().cycle(U, 128).p, atol=0.1)


def test_masing_loops_of_parallel_elements():
    """Elements in parallel: the loss is 8 (integral of the backbone - X F / 2); F(u) = sum min(k_t u, mu N0)."""
    n, X = 40, 3.0
    law = replace(joint(n), N0=np.linspace(0.5, 15.0, n))
    U = motion(n, x=[0.0, X])
    d = 0.5 * law.N0 / 2.0
    backbone = np.where(d < X, 2.0 * (d * X - 0.5 * d**2), X**2).sum()
    F = 2.0 * np.minimum(d, X).sum()
    loss = pair_energy(U, law.cycle(U, 4096).p).sum()
    assert loss == pytest.approx(8.0 * (backbone - 0.5 * X * F), rel=1e-5)


def test_energy_is_the_time_integral_of_friction_power():
    rng = np.random.default_rng(6)
    U, N_t = rng.standard_normal((1, 3, 7)), 4096
    p = replace(joint(N0=2.0, k_n=1.0), sampled=True).cycle(U, N_t).p  # defined by T at the samples
    T = pair_harmonics(U[0], 0.5, 2.0, 2.0, 1.0, False, N_t).T
    power = np.sum(T * synthesise(differentiate(U), N_t)[0, :2].T)
    assert pair_energy(U, p)[0] == pytest.approx(2.0 * np.pi / N_t * power, rel=1e-12)
    path = synthesise(U, N_t)[0, :2].T
    steps, middle = np.roll(path, -1, axis=0) - path, 0.5 * (np.roll(T, -1, axis=0) + T)
    assert pair_energy(U, p)[0] == pytest.approx(np.sum(middle * steps), rel=1e-4)


def test_forces_scale_with_the_units_of_force_and_length():
    rng = np.random.default_rng(9)
    U, law = rng.standard_normal((25, 3, 5)), joint(25, N0=2.0, k_n=1.0)
    plain = law.cycle(U, 64)
    for force, length in ((1e9, 1e-9), (1e-9, 1.0), (3.0, 1e6)):
        scaled = ElasticCoulomb(law.mu, force * law.N0, force / length * law.k_t, force / length * law.k_n, law.separate)
        cycle = scaled.cycle(length * U, 64)
        assert np.allclose(cycle.p / force, plain.p, rtol=0.0, atol=1e-12) and np.array_equal(cycle.state, plain.state)
        assert np.allclose(cycle.P * length / force, plain.P, rtol=0.0, atol=1e-11)


def test_more_samples_converge_to_the_same_force():
    rng = np.random.default_rng(12)
    U, law = 2.0 * rng.standard_normal((20, 3, 7)), joint(20, N0=6.0, k_n=1.0)
    reference = law.cycle(U, 8192).p
    coarse, fine = (np.abs(law.cycle(U, N_t).p - reference).max() for N_t in (128, 1024))
    assert fine < 0.2 * coarse and fine < 5e-3 * np.abs(reference).max()


# -- tangential preload: T0 = -k_t w0 = 1.2 of mu N0 = 3, slip distance 1.5 -----------------------------------------------


@pytest.mark.parametrize("X", [0.3, 0.9])
def test_below_the_limit_the_tangential_preload_remains_and_p_is_exactly_zero(X):
    cycle = joint(w0=(-0.6, 0.0)).cycle(motion(x=[0.0, X * (1.0 - 1e-9)]), 128)
    assert cycle.state[0] == STICK and np.all(cycle.p == 0.0)
    assert len(joint(w0=(-0.6, 0.0)).cycle(motion(x=[0.0, 0.9 + 1e-9]), 128).active) == 1


def test_slip_reduces_the_tangential_preload_to_the_friction_limit():
    """Within the slip distance the slider slips once: the peak stays mu N0, the mean becomes mu N0 - k_t X."""
    cycle = joint(w0=(-0.6, 0.0)).cycle(motion(x=[0.0, 0.0, 1.2]), 128)
    assert cycle.state[0] == STICK and cycle.active.tolist() == [0]
    assert np.allclose(cycle.p[0, 0] + [1.2, 0.0, 0.0], [3.0 - 2.0 * 1.2, 0.0, 0.0], atol=1e-14)


@pytest.mark.parametrize("separate", [False, True])
def test_slip_in_both_directions_removes_the_tangential_preload(separate):
    """The loop of T is centred at zero, so that p has the mean -T0; the loss is the loss without preload."""
    U, plain, law = motion(x=[0.0, 5.0]), joint(separate=separate), joint(separate=separate, w0=(-0.6, 0.0))
    cycle = law.cycle(U, 4096)
    assert np.allclose(cycle.p - plain.cycle(U, 4096).p, motion(x=[-1.2]), atol=1e-13)
    assert pair_energy(U, cycle.p)[0] == pytest.approx(4.0 * 3.0 * (5.0 - 1.5), rel=1e-5)


def test_an_equal_shift_of_start_and_mean_does_not_change_p():
    """The force p depends on du_t - w0 only."""
    rng = np.random.default_rng(14)
    U, w0, law = rng.standard_normal((30, 3, 7)), rng.standard_normal((30, 2)), joint(30, N0=2.0, k_n=1.0)
    shifted = U.copy()
    shifted[:, :2, 0] += w0
    plain, cycle = law.cycle(U, 64), replace(law, w0=w0).cycle(shifted, 64)
    assert np.allclose(cycle.p, plain.p, atol=1e-13) and np.allclose(cycle.P, plain.P, atol=1e-12)
    assert np.array_equal(cycle.state, plain.state)


# -- limits ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("w0", [(0.0, 0.0), (-0.3, 0.0), (0.0, 0.4)])
def test_slip_safety_is_the_exact_factor_of_first_slip(w0):
    """Peaks of all harmonics at once, in the direction of T0: the bound cannot be sharper."""
    law, U = joint(w0=w0), np.zeros((1, 3, 7))
    U[0, 1 if w0[1] else 0, 1::2] = [-0.3, -0.2, -0.1] if w0[1] else [0.3, 0.2, 0.1]
    U[0, 2, 1::2] = [0.05, 0.02, 0.03]
    amplitudes = np.abs(U).sum(axis=2)
    factor = law.slip_safety(amplitudes)
    assert factor[0] == pytest.approx((3.0 - 2.0 * np.hypot(*w0)) / (2.0 * 0.6 + 0.5 * 4.0 * 0.1))
    assert len(law.cycle((1.0 - 1e-9) * factor * U, 64).active) == 0
    assert len(law.cycle((1.0 + 1e-9) * factor * U, 64).active) == 1
    assert np.array_equal(law.slip_safety(np.stack([amplitudes, 2.0 * amplitudes])), [factor, factor / 2.0])


def test_slip_safety_is_zero_without_friction_preload_or_contact():
    for law in (joint(mu=0.0), joint(N0=0.0), joint(N0=-1.0), joint(w0=(1.5, 0.0))):
        assert law.slip_safety(np.array([[0.1, 0.0, 0.0]]))[0] == 0.0 == law.slip_safety(np.zeros((1, 3)))[0]
    assert joint().slip_safety(np.zeros((1, 3)))[0] == np.inf


def test_utilisation_of_the_limits():
    """The tangential share is of mu N0 = 3, less T0; the normal share of N0 = 6; the larger one is returned."""
    amplitudes = np.array([[0.3, 0.4, 0.0], [0.3, 0.4, 1.2], [0.0, 0.0, 0.0]])
    assert np.allclose(joint(3).utilisation(amplitudes), [1.0 / 3.0, 0.8, 0.0])
    assert np.allclose(joint(3, w0=(0.5, 0.0)).utilisation(amplitudes), [0.5, 0.8, 0.0])
    assert joint(mu=0.0).utilisation(amplitudes[:1])[0] == np.inf
    assert np.array_equal(joint(3, N0=-6.0).utilisation(np.fliplr(amplitudes)), [np.inf, np.inf, 0.0])
    assert joint(N0=-6.0).utilisation(np.array([[0.0, 0.0, 1.0]]))[0] == np.inf


def test_share_of_the_force_that_slip_can_remove():
    law = replace(joint(5, mu=0.5, k_t=2.0, k_n=4.0), N0=np.array([10.0, 10.0, 10.0, -1.0, 0.0]))
    U = np.zeros((5, 3))
    U[:, 0] = [1.0, 5.0, 5.0, 5.0, 0.0]  # half a limit of 2.5 N: below it, four times it, with less normal force, open, at rest
    U[2, 2], U[3, 2] = 2.0, 1.0
    expected = [[0, 0, 0], [0.75, 0.75, 0], [0.95, 0.95, 0.375], [1, 1, 1], [0, 0, 0]]
    np.testing.assert_allclose(law.slipping_share(U, 0.5), expected)
    held = replace(law, w0=np.array([0.0, -1.5]))  # T0 = 3 N of the limit of 5 N
    np.testing.assert_allclose(held.slipping_share(U, 0.5)[:2], [[0.5, 0.5, 0], [0.9, 0.9, 0]])


def test_pairs_that_preserve_half_wave_symmetry():
    along, both, normal = np.eye(3, dtype=bool)[[0]], np.array([[True, True, False]]), np.array([[False, False, True]])
    assert joint().keeps_half_wave_symmetry(along)[0] and joint(separate=True).keeps_half_wave_symmetry(both)[0]
    assert joint(mu=0.0).keeps_half_wave_symmetry(both)[0] and joint(k_t=0.0).keeps_half_wave_symmetry(both)[0]
    assert joint().keeps_half_wave_symmetry(both)[0] and not joint().keeps_half_wave_symmetry(normal)[0]
    assert not joint(w0=(0.1, 0.0)).keeps_half_wave_symmetry(along)[0]
