"""The law of rough surfaces compared with closed forms: pressure, friction at constant pressure, no cycle that gains energy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import iv

from microslip.contact.energy import contact_work, pair_energy
from microslip.contact.law import OPEN, SLIP, STICK
from microslip.contact.rough import Rough, on_area, tangents_at
from microslip.fourier.coefficients import analysis_matrix, synthesise
from microslip.fourier.harmonics import Harmonics

MU, N0, K_T, K_N = 0.4, 2.0, 3.0, 5.0
EXPONENTS = [np.inf, 2.0, 3.33, 1.4]


def law(exponent=np.inf, n=1, **own):
    ones = np.ones(n)
    return Rough(MU * ones, N0 * ones, K_T * ones, K_N * ones, exponent * ones, **own)


def along(motion, direction, n_steps=2000):
    """Return the friction force (n_steps, n_paths) of a law stepped from rest along ``direction`` through ``motion``."""
    of_pairs, du = law(), np.outer(motion, direction)
    forces, before = [], np.zeros((1, 3 + of_pairs.n_memory))
    for at in du:
        before, _, _ = of_pairs.step(at[None], before)
        forces.append(before[0, :2] + K_T * at[:2])
    return np.array(forces)


def steady_loop(of_pairs, du):
    """Return forces (n_steps, n, 3) of closed paths ``du`` (n_steps, n, 3), at which the cycle of the law is steady."""
    before = np.zeros((du.shape[1], 3 + of_pairs.n_memory))
    for _ in range(8):
        forces = []
        for at in du:
            before, _, _ = of_pairs.step(at, before)
            forces.append(before[:, :3] + of_pairs.stiffness * at)
    return np.array(forces)


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_pressure_is_a_power_of_the_approach_and_linear_about_rest(exponent):
    u = np.linspace(-1.0, 0.3, 7)
    N, k = law(exponent).normal_force(u)
    expected = N0 * (np.exp(-K_N * u / N0) if np.isinf(exponent) else np.maximum(1.0 - K_N * u / N0 / exponent, 0.0) ** exponent)
    assert np.allclose(N, expected, rtol=1e-13)
    grows = 1.0 if np.isinf(exponent) else 1.0 - 1.0 / exponent
    assert np.allclose(k, K_N * (N / N0) ** grows, rtol=1e-12)
    h = 1e-6
    slope = (law(exponent).normal_force(u - h)[0] - law(exponent).normal_force(u + h)[0]) / (2.0 * h)
    assert np.allclose(k, slope, rtol=1e-6)


def test_harmonics_of_the_exponential_are_bessel_functions():
    amplitude, U = 0.5, np.zeros((1, 3, 11))
    U[0, 2, 1] = amplitude
    cycle = law().cycle(U, 64)
    x, n = K_N * amplitude / N0, np.arange(1, 6)
    assert cycle.p[0, 2, 0] == pytest.approx(N0 - N0 * iv(0, x), rel=1e-12)
    cosines = -2.0 * N0 * (-1.0) ** n * iv(n, x) - np.where(n == 1, K_N * amplitude, 0.0)
    assert np.allclose(cycle.p[0, 2, 1::2], cosines, rtol=1e-11)
    assert np.abs(cycle.p[0, :2]).max() == 0.0 and np.abs(cycle.p[0, 2, 2::2]).max() < 1e-14
    assert cycle.state.tolist() == [STICK] and cycle.active.tolist() == [0]
    assert abs(contact_work(U, cycle.p)[0]) < 1e-12


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_asperities_have_stiffness_and_force_at_rest_and_interpolate_the_pressure(exponent):
    of_pairs, n = law(exponent), law(exponent).n_sliders
    elements = of_pairs.bundle.elements
    assert elements.k_n[:n].sum() == pytest.approx(K_N, rel=1e-12) and elements.k_t[:n].sum() == pytest.approx(K_T, rel=1e-12)
    assert elements.N0[:n].sum() == pytest.approx(N0, rel=1e-12)
    share = tangents_at(n)[1:]
    assert share[n - 1] == 1.0 and share[3 * n - 1] == pytest.approx(16.0) and share[-1] == pytest.approx(1e9)
    end = N0 / K_N * (np.log(share) if np.isinf(exponent) else exponent * (share ** (1.0 / exponent) - 1.0))
    carried = np.maximum(elements.N0 + elements.k_n * end[:, None], 0.0).sum(axis=1)
    assert np.allclose(carried, N0 * share, rtol=1e-9)
    for last, bound in ((3 * n - 1, 5.0 / n**2), (4 * n - 1, 20.0 / n**2), (5 * n - 1, 40.0 / n**2)):
        fine = np.linspace(end[0], end[last], 5000)
        N = of_pairs.normal_force(-fine)[0]
        missing = N - np.maximum(elements.N0 + elements.k_n * fine[:, None], 0.0).sum(axis=1)
        assert np.all(missing > -1e-9 * np.maximum(N, N0)) and np.all(missing < bound * np.maximum(N, N0))


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
def test_friction_under_constant_pressure_follows_the_pressure_of_a_smaller_approach(direction):
    """Ciavarella 1998: T(u) = mu (N(0) - N(u k_t / (mu k_n))); of the exponential mu N0 (1 - exp(-k_t u / (mu N0)))."""
    u = np.linspace(0.0, 4.0 * MU * N0 / K_T, 300)
    T = along(u, direction) @ direction[:2]
    exact = MU * N0 * (1.0 - np.exp(-K_T * u / (MU * N0)))
    assert 0.0 <= (T - exact).min() + 1e-12 and (T - exact).max() < 2.0 * MU * N0 / law().n_sliders ** 2


def test_loss_per_cycle_under_constant_pressure_follows_masing():
    v = np.array([0.3, 1.0, 2.5])  # amplitudes over mu N0 / k_t
    U = np.zeros((3, 3, 3))
    U[:, 0, 1] = v * MU * N0 / K_T
    cycle = law(n=3, n_sliders=96).cycle(U, 512)
    unit = (MU * N0) ** 2 / K_T
    exact = unit * (8.0 * (v - 1.0 + np.exp(-v)) - 4.0 * v * (1.0 - np.exp(-v)))
    assert np.allclose(pair_energy(U, cycle.p), exact, rtol=2e-3)


def test_gross_slip_is_at_the_friction_limit_of_the_pressure():
    of_pairs, u_z = law(n_sliders=64), 0.2
    before = np.zeros((1, 3 + of_pairs.n_memory))
    after, L, state = of_pairs.step(np.array([[50.0, 0.0, u_z]]), before)
    T = after[0, 0] + K_T * 50.0
    assert T == pytest.approx(MU * N0 * np.exp(-K_N * u_z / N0), rel=1e-3) and state[0] == SLIP
    assert L[0, 0, 0] == pytest.approx(-K_T, rel=1e-12)  # no tangential stiffness remains
    assert L[0, 0, 2] == pytest.approx(-MU * K_N * np.exp(-K_N * u_z / N0), rel=3e-2)


def test_a_power_opens_and_the_exponential_does_not():
    du = np.array([[0.0, 0.0, 3.0 * N0 / K_N]])
    for exponent, expected in ((2.0, OPEN), (np.inf, STICK)):
        of_pairs = law(exponent)
        after, _, state = of_pairs.step(du, np.zeros((1, 3 + of_pairs.n_memory)))
        N = N0 - after[0, 2] - K_N * du[0, 2]
        assert (state[0] == expected or np.isinf(exponent)) and (N == pytest.approx(0.0, abs=1e-12)) == (exponent == 2.0)


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [np.inf, 2.0])
def test_no_closed_path_gains_energy_in_either_direction(exponent):
    """A spring k_t(N) gains energy in one of the two directions of rotation; this law loses or conserves energy in both."""
    size, turn = (values.ravel() for values in np.meshgrid([0.01, 0.1, 0.4], [1.0, -1.0]))
    phase = 2.0 * np.pi * np.arange(200)[:, None] / 200
    du = size[:, None] * np.stack(np.broadcast_arrays(np.cos(phase), 0.3 * np.sin(3 * phase), turn * np.sin(2 * phase)), axis=-1)
    forces = steady_loop(law(exponent, n=6), du)
    d_du = du - np.roll(du, 1, axis=0)
    work = (forces[..., :2] * d_du[..., :2]).sum(axis=(0, 2))  # with the force at the end of each step, which includes all losses
    assert np.all(work >= -1e-14) and np.all(work[size > 0.1] > 0.1)
    spring = K_T * ((1.0 - forces[..., 2] / N0)[..., None] * du)[..., :2]  # T = k_t(N) u, of the exponential
    of_springs = (0.5 * (spring + np.roll(spring, 1, axis=0)) * d_du[..., :2]).sum(axis=(0, 2))
    assert np.all(of_springs[turn > 0.0] * of_springs[turn < 0.0] < 0.0)


def test_a_pair_sticks_until_its_least_loaded_asperity_slips():
    of_pairs = law()
    weakest = of_pairs.bundle.elements.take([of_pairs.n_sliders - 1])
    slips_at = MU * weakest.N0[0] / weakest.k_t[0]
    assert of_pairs.slip_safety(np.array([[1.0, 0.0, 0.0]]))[0] == pytest.approx(slips_at)
    assert of_pairs.slip_safety(np.array([[1.0, 0.0, 1e-9]]))[0] == 0.0
    U = np.zeros((2, 3, 3))
    U[:, 0, 1] = slips_at * np.array([0.99, 1.01])
    cycle = law(n=2).cycle(U, 256)
    assert cycle.active.tolist() == [1] and not cycle.p[0].any() and cycle.p[1].any()


def test_parameters_per_area():
    area = np.array([1e-4, 3e-4])
    keys = {"preload": 5e6, "friction": 0.3, "roughness_height": 2e-6, "tangential_ratio": None}
    exponential = on_area({**keys, "exponent": None, "roughness_pressure": None}, area)
    assert np.allclose(exponential["N0"], 5e6 * area) and np.allclose(exponential["k_n"], 5e6 / 2e-6 * area)
    assert np.allclose(exponential["k_t"], 1.4 / 1.7 * exponential["k_n"])
    power = on_area({**keys, "exponent": 2.0, "roughness_pressure": 2e7, "tangential_ratio": 0.7}, area)
    assert np.allclose(power["k_n"], 2.0 * 5e6 / (2e-6 * 0.5) * area)  # p = 20 MPa (d / 2 um)^2: 5 MPa at 1 um
    assert np.allclose(power["k_t"], 0.7 * power["k_n"])


def test_parameters_without_pressure_are_rejected():
    with pytest.raises(ValueError, match="N0 of pair 0 is 0"):
        Rough(*np.array([[0.3], [0.0], [1.0], [1.0], [2.0]]))
    with pytest.raises(ValueError, match="exponent of pair 0 is 1"):
        Rough(*np.array([[0.3], [1.0], [1.0], [1.0], [1.0]]))


@pytest.mark.parametrize("exponent", [np.inf, 2.5])
def test_a_march_continues_unchanged_about_another_reference_state(exponent):
    """A march through slip and pressure is continued about its state: the difference falls as 1 / n^2."""
    worst = []
    for n_sliders in (12, 48):
        of_pairs, rng = law(exponent, 20, n_sliders=n_sliders), np.random.default_rng(2)
        path = np.cumsum(0.04 * rng.standard_normal((40, 20, 3)), axis=0)
        before = np.zeros((20, 3 + of_pairs.n_memory))
        for du in path[:20]:
            before, _, _ = of_pairs.step(du, before)
        rest, T0 = path[19], before[:, :2] + of_pairs.stiffness[:, :2] * path[19, :, :2]
        about_rest, after, differs = of_pairs.about(rest, before[:, 3:]), np.zeros_like(before), []
        assert about_rest.bundle.held_at_rest == pytest.approx(np.hypot(*T0.T), abs=2.0 * MU * N0 * 4.0 / n_sliders**2)
        for du in path[20:]:
            before, _, _ = of_pairs.step(du, before)
            after, _, _ = about_rest.step(du - rest, after)
            T = before[:, :2] + of_pairs.stiffness[:, :2] * du[:, :2]
            differs.append(T - T0 - after[:, :2] - about_rest.stiffness[:, :2] * (du - rest)[:, :2])
            assert about_rest.normal_force(du[:, 2] - rest[:, 2])[0] == pytest.approx(
                of_pairs.normal_force(du[:, 2])[0], rel=1e-12
            )
        worst.append(np.abs(differs).max())
    assert worst[0] < 0.05 * MU * N0 and worst[1] < worst[0] / 8.0


def test_an_exponential_law_without_pressure_is_rejected_as_reference_state():
    with pytest.raises(ValueError, match="1 of 2 pairs carry no force"):
        law(np.inf, 2).about(np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 50.0]]), np.zeros((2, law().n_memory)))
    with pytest.raises(ValueError, match="N0 of pair 0 is 0"):
        Rough(*np.array([[0.3], [0.0], [1.0], [1.0], [np.inf]]), reference=np.ones(1))
    with pytest.raises(ValueError, match="pair 0 is open at rest, and has a preload"):
        law(2.0, open_at_rest=np.ones(1, dtype=bool))


# -- open at rest ----------------------------------------------------------------------------------------------------------

GAP = 0.1


def from_gap(n=1, gap=GAP, is_open=True, m=2.0, **own):
    """Return the law of pairs open by a gap, and the distance of this state from that with the preload of :func:`law`."""
    of_pairs = replace(law(m, n, **own), N0=np.full(n, -K_N * gap), reference=np.full(n, N0), open_at_rest=np.full(n, is_open))
    return of_pairs, m * N0 / K_N + gap


def test_a_power_law_has_no_stiffness_at_first_contact():
    of_pairs, far = from_gap(m=2.5)
    u = np.array([0.5, 0.0, -GAP, -GAP - 0.2, -far])
    N, k = of_pairs.normal_force(u)
    x = np.maximum(-u - GAP, 0.0)
    assert np.allclose(N, N0 * (K_N * x / (2.5 * N0)) ** 2.5, rtol=1e-12, atol=1e-15) and N[-1] == pytest.approx(N0, rel=1e-12)
    assert np.allclose(k[3:], 2.5 * N[3:] / x[3:], rtol=1e-12) and not k[:3].any()
    assert not of_pairs.stiffness.any() and np.array_equal(of_pairs.springs, law(2.5).stiffness)


def test_pairs_open_at_rest_follow_the_law_of_separated_pairs():
    """All of its force is p, with the derivative; for a pair in contact at rest, p is the force beyond its springs."""
    n, N_H, rng = 12, 7, np.random.default_rng(5)
    U = 0.2 * rng.standard_normal((n, 3, N_H))
    U[:, 2, 0] -= np.linspace(-3.0, 1.5, n)
    open_pairs, far = from_gap(n)
    pressed, moved = law(2.0, n), U.copy()
    moved[:, 2, 0] += far
    cycle, wanted = open_pairs.cycle(U, 64), pressed.cycle(moved, 64)
    force = wanted.p + pressed.stiffness[:, :, None] * moved
    force[:, 2, 0] -= N0
    assert np.allclose(cycle.p, force, atol=1e-12)
    touches = np.zeros(n, dtype=bool)
    touches[cycle.active] = True
    assert 0 < touches.sum() < n and not cycle.p[~touches].any() and np.all(cycle.state[~touches] == OPEN)
    P = wanted.P[np.searchsorted(wanted.active, cycle.active)]
    i = np.arange(3 * N_H)
    P[:, i, i] += np.repeat(pressed.stiffness[cycle.active], N_H, axis=1)
    assert np.allclose(cycle.P, P, atol=1e-11)


def test_a_march_of_pairs_open_at_rest_converges_to_the_cycle():
    n, N_t, rng = 8, 48, np.random.default_rng(6)
    U = np.zeros((n, 3, 5))
    U[:, :, 1:] = 0.25 * rng.standard_normal((n, 3, 4))
    U[:, 2, 0] = -np.linspace(-0.5, 1.2, n)
    of_pairs = from_gap(n)[0].followed(False)
    du = synthesise(U.reshape(-1, 5), N_t).reshape(n, 3, N_t).transpose(2, 0, 1)
    forces = steady_loop(of_pairs, du).transpose(1, 2, 0)
    cycle = of_pairs.cycle(U, N_t)
    assert np.allclose(cycle.p, np.einsum("nit,ct->nic", forces, analysis_matrix(Harmonics.up_to(2), N_t)), atol=1e-10)


def test_a_march_from_open_pairs_continues_unchanged_about_another_reference_state():
    """Pairs begin open with springs, as in statics: some close and slip, others remain open, by geometric gaps.

    The friction limit (eq. 3.12) is too low where the pressure later exceeds 16 times a small pressure at rest.
    """
    worst = []
    for n_sliders in (12, 48):
        n, rng = 20, np.random.default_rng(3)
        of_pairs, far = from_gap(n, 0.0, is_open=False, n_sliders=n_sliders)
        path = np.cumsum(0.04 * rng.standard_normal((40, n, 3)), axis=0)
        path[..., 2] -= np.linspace(-0.5, 1.0, n)
        before = np.zeros((n, 3 + of_pairs.n_memory))
        for du in path[:20]:
            before, _, _ = of_pairs.step(du, before)
            assert before[:, 2] + K_N * du[:, 2] == pytest.approx(-of_pairs.normal_force(du[:, 2])[0], abs=1e-12)
        rest, T0 = path[19], before[:, :2] + of_pairs.stiffness[:, :2] * path[19, :, :2]
        about_rest, differs = of_pairs.about(rest, before[:, 3:]), []
        assert 0 < about_rest.open_at_rest.sum() < n and np.array_equal(
            about_rest.open_at_rest, of_pairs.normal_force(rest[:, 2])[0] <= 1e-9 * N0
        )
        assert about_rest.N0[about_rest.open_at_rest] == pytest.approx(
            -K_N * np.maximum(rest[about_rest.open_at_rest, 2], 0.0), abs=1e-12
        )
        after = np.zeros_like(before)
        for du in path[20:]:
            before, _, _ = of_pairs.step(du, before)
            after, _, _ = about_rest.step(du - rest, after)
            T = before[:, :2] + of_pairs.stiffness[:, :2] * du[:, :2]
            differs.append(T - T0 - after[:, :2] - about_rest.stiffness[:, :2] * (du - rest)[:, :2])
            assert about_rest.normal_force(du[:, 2] - rest[:, 2])[0] == pytest.approx(
                of_pairs.normal_force(du[:, 2])[0], rel=1e-9, abs=1e-9
            )
        firm = about_rest.open_at_rest | (about_rest.N0 > 0.01 * N0)
        assert firm.sum() > 15
        worst.append(np.abs(differs)[:, firm].max())
    assert worst[0] < 0.02 * MU * N0 and worst[1] < worst[0] / 4.0


def test_slip_safety_of_pairs_open_at_rest_follows_from_the_gap():
    of_pairs, _ = from_gap(2)
    amplitudes = np.array([[1.0, 0.0, 0.5 * GAP], [3.0, 1.0, 0.0]])
    assert of_pairs.slip_safety(amplitudes).tolist() == [2.0, np.inf] and of_pairs.utilisation(amplitudes).tolist() == [0.5, 0.0]
    assert np.all(of_pairs.slipping_share(amplitudes) == 1.0)
    with pytest.raises(ValueError, match="to be open at rest, without springs"):
        from_gap(is_open=False)[0].cycle(np.zeros((1, 3, 3)), 16)


# -- pressures far above that at rest --------------------------------------------------------------------------------------


@pytest.mark.parametrize("exponent", [2.0, 3.33, 1.4])
@pytest.mark.parametrize("times", [30.0, 137.0, 1e4, 1e7])
def test_friction_far_above_the_pressure_at_rest_follows_the_same_law(exponent, times):
    """Pressed to many times N0, then sideways: T = mu (N(x) - N(x - k_t u / (mu k_n))), without tangential force at first."""
    of_pairs, x = law(exponent), exponent * N0 / K_N * (times ** (1.0 / exponent) - 1.0)
    N, k = of_pairs.normal_force(np.array([-x]))
    assert N[0] == pytest.approx(times * N0)
    before, T = np.zeros((1, 3 + of_pairs.n_memory)), []
    before, _, _ = of_pairs.step(np.array([[0.0, 0.0, -x]]), before)
    assert not before[0, :2].any()
    u = np.linspace(0.0, 1.5 * exponent * MU * N[0] / k[0] * K_N / K_T, 60)
    for at in u:
        before, L, state = of_pairs.step(np.array([[at, 0.0, -x]]), before)
        T.append(before[0, 0] + K_T * at)
    exact = MU * (N - of_pairs.normal_force(-x + K_T * u / (MU * K_N))[0])
    assert np.abs(T - exact).max() < (0.01 if times < 1e5 else 0.02) * MU * N[0] and state[0] == SLIP
    assert L[0, 0, 2] == pytest.approx(-MU * k[0], rel=0.15)
    far = law(exponent, n_sliders=4 * of_pairs.n_sliders)
    after, _, _ = far.step(np.array([[u[-1], 0.0, -x]]), np.zeros((1, 3 + far.n_memory)))
    assert after[0, 0] + K_T * u[-1] == pytest.approx(exact[-1], rel=0.01 / 8.0)


def test_the_refined_law_estimates_the_error_far_above_the_pressure_at_rest():
    """One pair, N up to 190 N0 in a cycle that also slips: the error falls as 1 / n^2, and equals (refined - law) 4 / 3."""
    n, rng = 12, np.random.default_rng(8)
    U = np.zeros((n, 3, 7))
    U[:, :2, 1:5], U[:, 2, 1:3] = 6.0 * rng.standard_normal((n, 2, 4)), 5.0 / np.sqrt(2.0)
    U[:, 2, 0] = -4.0
    forces = {size: law(2.0, n, n_sliders=size).cycle(U, 256).p for size in (12, 24, 48, 192)}
    exact = forces[192]
    assert (law(2.0, n).normal_force(synthesise(U[:, 2], 256).min(axis=1))[0] > 100.0 * N0).all()
    errors = [np.abs(forces[size] - exact).max() for size in (12, 24, 48)]
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2] and errors[1] < 0.02 * np.abs(exact[:, :2]).max()
    estimate = np.abs(law(2.0, n, n_sliders=24).refined.cycle(U, 256).p - forces[24]).max(axis=(1, 2)) * 4.0 / 3.0
    true = np.abs(forces[24] - exact).max(axis=(1, 2))
    assert np.all(estimate > 0.6 * true) and np.all(estimate < 1.6 * true)


def test_derivative_far_above_the_pressure_at_rest():
    n, rng = 4, np.random.default_rng(9)
    U = 2.0 * rng.standard_normal((n, 3, 7))
    U[:, 2, 0] -= 6.0
    of_pairs, d_U, h = law(2.0, n, n_sliders=6), rng.standard_normal((n, 3, 7)), 1e-6
    cycle = of_pairs.cycle(U, 128)
    assert cycle.active.tolist() == list(range(n))
    slope = (of_pairs.cycle(U + h * d_U, 128).p - of_pairs.cycle(U - h * d_U, 128).p) / (2.0 * h)
    assert np.allclose(
        np.einsum("iab,ib->ia", cycle.P, d_U.reshape(n, -1)), slope.reshape(n, -1), rtol=1e-5, atol=1e-5 * np.abs(slope).max()
    )


def test_the_refined_law_has_the_reference_state_of_the_law():
    """About a reference state with friction: the same limits and stiffness, and the same friction at rest."""
    of_pairs = law(2.0, 3)
    before, _, _ = of_pairs.step(
        np.array([[0.1, 0.05, -0.1], [0.3, 0.0, 0.2], [0.0, -1.0, -2.0]]), np.zeros((3, 3 + of_pairs.n_memory))
    )
    about_rest = of_pairs.about(np.array([[0.1, 0.05, -0.1], [0.3, 0.0, 0.2], [0.0, -1.0, -2.0]]), before[:, 3:])
    finer = about_rest.refined
    assert finer.n_sliders == 2 * about_rest.n_sliders and np.array_equal(finer.stiffness, about_rest.stiffness)
    assert finer.bundle.held_at_rest == pytest.approx(about_rest.bundle.held_at_rest, rel=5e-3)
