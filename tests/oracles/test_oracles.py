"""The oracles compared with each other and with closed formulas."""

from __future__ import annotations

import numpy as np
import pytest

from . import exact, harmonic_balance, scenes, structures, time_integration

JENKINS = {"m": 1.0, "c": 0.02, "k": 1.0, "k_t": 1.0, "muN": 1.0}
BARS = [exact.FrictionBar(EA=2.0, L=3.0, q=1.5, k=k) for k in (0.5, 5.0, 500.0)]


def one_pair(mu=0.4, N0=1.0, k_t=1.5, k_n=2.5, separate=False):
    """Return a free pair, to test the laws."""
    return scenes.make_system(
        "pair",
        np.eye(3),
        np.eye(3),
        [[0, 1, 2, -1, -1, -1]],
        mu=mu,
        N0=N0,
        k_t=k_t,
        k_n=k_n,
        separate=separate,
        zeta=0.0,
        loads=[],
        output=[1.0, 0.0, 0.0],
        omega=(0.0, 1.0),
        levels={},
    )


def random_cycle(n_samples=256, H=4, seed=3):
    """Return harmonics (1, 3, N_H) and samples (n_samples, 1, 3) of a cycle with sticking, slip and lift-off."""
    U = np.random.default_rng(seed).normal(size=(1, 3, 2 * H + 1)) * [[[0.5], [0.5], [0.25]]]
    return U, np.moveaxis(U @ scenes.harmonic_basis(H, n_samples), -1, 0)


def largest_difference(balance, march):
    """Return the largest difference of u over the period, relative to the peak of the march."""
    u = (balance.u_hat @ scenes.harmonic_basis(balance.u_hat.shape[1] // 2, len(march.u))).T
    return np.abs(u - march.u).max() / np.abs(march.u).max()


# --- laws on a given path ---------------------------------------------------------------------------------------------


def test_jenkins_harmonic_has_the_published_values():
    a1, b1, loss = exact.jenkins_harmonic(5.0, 2.0, 3.0)
    assert (a1, b1, loss) == pytest.approx((2.5231578773, 2.6738030439, 42.0), abs=1e-10)


def test_sampled_jenkins_loop_converges_quadratically():
    pair, a1_exact, b1_exact = one_pair(mu=1.0, N0=3.0, k_t=2.0), *exact.jenkins_harmonic(5.0, 2.0, 3.0)[:2]
    U = np.zeros((1, 3, 3))
    U[0, 0, 1] = 5.0
    errors = []
    for n_samples in (128, 512, 2048):
        f_hat = harmonic_balance.contact_harmonics(U, pair, n_samples)[0][0, 0]
        errors.append(np.hypot(f_hat[1] - a1_exact, f_hat[2] + b1_exact))
    rates = np.log(np.divide(errors[:-1], errors[1:])) / np.log(4.0)
    assert errors[-1] < 1e-5 and np.all(rates > 1.7)


def test_force_of_a_circular_path_is_at_its_limit_with_a_constant_lag():
    pair, X = one_pair(mu=0.4, N0=1.0, k_t=1.5), 0.9
    U = np.zeros((1, 3, 3))
    U[0, 0, 1], U[0, 1, 2] = X, X  # (cos, sin)
    f_hat, state, T = harmonic_balance.contact_harmonics(U, pair, 4096)
    along, against, loss = exact.circle_path(X, 1.5, 0.4)
    assert T[0] == pytest.approx([along, against], abs=1e-3)
    assert scenes.cycle_work(f_hat, U)[0, :2].sum() == pytest.approx(loss, rel=1e-3)
    assert state == [1] and np.hypot(*T[0]) == pytest.approx(0.4, rel=1e-12)


@pytest.mark.parametrize("gamma", [0.8, 2.0])  # the pair lifts off with the second value
def test_normal_force_in_phase_gives_the_exact_polygon(gamma):
    pair, X = one_pair(mu=0.3, N0=1.0, k_t=2.0, k_n=1.0), 1.0
    U = np.zeros((1, 3, 3))
    U[0, 0, 1], U[0, 2, 1] = X, -gamma * X  # N = N0 + gamma u
    du = np.moveaxis(U @ scenes.harmonic_basis(1, 8192), -1, 0)
    f, state = harmonic_balance.sampled_law(du, pair)
    u, T = du[:, 0, 0], f[:, 0, 0]
    corners, area = exact.in_phase_loop(X, 2.0, 0.3, 1.0, gamma)
    loss = np.sum(0.5 * (T + np.roll(T, -1)) * (np.roll(u, -1) - u))
    assert loss == pytest.approx(area, rel=1e-5) and state == [2 if gamma > 1.0 else 1]
    for corner in corners:
        assert np.hypot(u - corner[0], T - corner[1]).min() < 1e-3


@pytest.mark.parametrize("law", ["return", "path"])
@pytest.mark.parametrize("separate", [False, True])
def test_two_implementations_of_a_law_agree_step_by_step(separate, law):
    pair = one_pair(separate=separate)
    _, du = random_cycle()
    du = du.reshape(-1, 3)
    contacts = time_integration.Contacts(pair, np.zeros((3, 3)), law)
    x, f = du[0], contacts.f_rest + contacts.K_J * du[0]  # T = k_t du_t, as the sampled law starts
    forces = []
    for sample in [*du[1:], *du]:
        x, f, _ = contacts.step(sample, x, f)
        forces.append(f)
    sampled, _ = harmonic_balance.sampled_law(du[:, None, :], pair, law)
    np.testing.assert_allclose(forces[-len(du) :], sampled[:, 0], atol=1e-13)


def test_a_straight_step_is_the_limit_of_many_small_return_maps():
    rng = np.random.default_rng(5)
    for closing, closing_new in ((1.0, 1.0), (1.0, 0.3), (0.4, 1.2), (-0.5, 1.0), (1.0, -0.2)):
        T, e = rng.normal(size=2), 2.0 * rng.normal(size=2)
        T *= 0.5 * max(closing, 0.0) / max(np.hypot(*T), 0.5 * max(closing, 0.1))  # |T| <= mu N
        small, n = T, 20000
        for k in range(n):
            limit = 0.5 * max(0.0, closing + (closing_new - closing) * (k + 1) / n)
            small = small + e / n
            small = small * min(1.0, limit / np.hypot(*small))
        computed = time_integration.straight_step(T, e, closing, closing_new, 0.5)
        np.testing.assert_allclose(computed, small, atol=5e-4)


@pytest.mark.parametrize("separate", [False, True])
def test_tangent_of_a_step_is_its_derivative(separate):
    contacts = time_integration.Contacts(one_pair(separate=separate), np.zeros((3, 3)))
    for f_stick in ([0.2, 0.1, 0.3], [0.9, -0.5, 0.2], [0.9, -0.5, 1.3]):  # sticks, slips, open
        f_stick = np.array(f_stick)
        J = contacts.tangent(contacts.law(f_stick.tolist())[1])
        for j in range(3):
            h = np.zeros(3)
            h[j] = 1e-6 * contacts.K_J[j]
            up, down = (contacts.law((f_stick + s * h).tolist())[0] for s in (1.0, -1.0))
            np.testing.assert_allclose(J[:, j], (up - down) / 2e-6, atol=1e-8)


@pytest.mark.parametrize("law", ["return", "path"])
@pytest.mark.parametrize("separate", [False, True])
def test_complex_step_derivative_is_the_difference_quotient(separate, law):
    pair = one_pair(separate=separate)
    U, _ = random_cycle()
    P = harmonic_balance.contact_derivative(U, pair, 64, law)[0]
    rng = np.random.default_rng(0)
    d_U, h = rng.normal(size=U.shape), 1e-7
    up, down = (harmonic_balance.contact_harmonics(U + s * h * d_U, pair, 64, law)[0] for s in (1.0, -1.0))
    difference = (up - down).ravel() / (2.0 * h)
    np.testing.assert_allclose(P @ d_U.ravel(), difference, atol=1e-6 * np.abs(difference).max())


def test_an_open_gap_exerts_no_force_and_a_stuck_pair_is_its_spring():
    U, _ = random_cycle()
    f_hat, state, _ = harmonic_balance.contact_harmonics(U, one_pair(N0=-100.0), 64)
    assert state == [2] and np.all(f_hat == 0.0)
    f_hat, state, _ = harmonic_balance.contact_harmonics(U, one_pair(N0=100.0), 64)
    assert state == [0]
    np.testing.assert_allclose(f_hat[0], np.diag([1.5, 1.5, 2.5]) @ U[0], atol=1e-12)


# --- one mass ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("X", "published"),
    [(0.5, (0.632495064828, 1.897248005129)), (1.5, (1.127402158122, 1.463083257582)), (2.0, (1.136206225921, 1.305151377843))],
)
def test_frequencies_of_one_harmonic_have_the_published_values(X, published):
    assert exact.jenkins_frequencies(X, 0.8, **JENKINS) == pytest.approx(published, abs=1e-12)


@pytest.mark.parametrize("omega", [1.127402158122, 1.2, 1.463083257582])
def test_balance_of_one_harmonic_satisfies_the_amplitude_equation(omega):
    X = exact.jenkins_amplitude(omega, 0.8, **JENKINS)
    assert np.abs(exact.jenkins_frequencies(X, 0.8, **JENKINS) - omega).min() < 1e-11
    for n_samples in (128, 1024):
        balance = harmonic_balance.solve(scenes.jenkins_mass(), omega, 0.8, H=1, n_samples=n_samples)
        assert abs(np.hypot(*balance.u_hat[0, 1:3]) / X - 1.0) < 30.0 / n_samples**2  # of the sampled loop


@pytest.mark.parametrize(
    ("beta", "ratio", "published"), [(0.75, 0.2, 2.2385612), (0.9, 0.5, 4.2159037), (1.25, 0.2, 1.7082175), (1.5, 0.3, 0.7211103)]
)
def test_den_hartog_motion_has_published_values_and_is_the_limit_of_stiff_jenkins_elements(beta, ratio, published):
    motion = exact.den_hartog_motion(beta, ratio)
    assert motion.X == pytest.approx(published, abs=5e-8) and motion.is_valid
    errors = [
        abs(exact.jenkins_steady_state(beta, 1.0, m=1.0, c=0.0, k=1.0, k_t=k_t, muN=ratio).X - motion.X) for k_t in (1e4, 1e6)
    ]
    assert errors[1] < 3e-3 and 0.4 < np.log(errors[0] / errors[1]) / np.log(100.0) < 1.1  # at least 1 / sqrt(k_t)


def test_exact_half_cycle_satisfies_its_equation_of_motion():
    motion = exact.jenkins_steady_state(1.2, 0.8, **JENKINS)
    t, h = np.array([0.5 * motion.stick, 1.5 * motion.stick]), 1e-4
    u, v = motion(t)
    acceleration = (motion(t + h)[1] - motion(t - h)[1]) / (2.0 * h)
    T = np.maximum(1.0 + u - motion.X, -1.0)
    np.testing.assert_allclose(acceleration + 0.02 * v + u + T, 0.8 * np.cos(1.2 * t + motion.phi), atol=1e-6)
    work = np.pi * 0.8 * motion.harmonics(1)[2]
    viscous = 2.0 * np.trapz(0.02 * motion(np.linspace(0.0, np.pi / 1.2, 20001))[1] ** 2, dx=np.pi / 1.2 / 20000)
    assert work == pytest.approx(viscous + motion.loss, rel=1e-7)


# --- time integration -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["generalised-alpha", "exponential", "explicit"])
def test_every_scheme_converges_quadratically_to_the_exact_steady_state(scheme):
    system, motion = scenes.jenkins_mass(), exact.jenkins_steady_state(1.2, 0.8, **JENKINS)
    errors = []
    for n_steps in (64, 128, 256):
        march = time_integration.steady_state(
            system, 1.2, 0.8, n_steps=n_steps, scheme=scheme, tolerance=1e-9, coarse=1, harmonics=7
        )
        errors.append(np.abs(march.u_hat[0] - motion.harmonics(7)).max() / motion.X)
    rate = np.log2(errors[0] / errors[2]) / 2.0
    assert errors[2] < 1e-3 and rate > 1.6, (errors, rate)


@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9, 1.0])
def test_generalised_alpha_has_the_requested_spectral_radius(rho_inf):
    system = scenes.spatial_mass()
    radius = np.abs(np.linalg.eigvals(time_integration.generalised_alpha(system, 1e6, rho_inf).Phi)).max()
    assert radius == pytest.approx(rho_inf, abs=1e-3)
    radius = np.abs(np.linalg.eigvals(time_integration.generalised_alpha({**system, "zeta": 0.0}, 0.3, 1.0).Phi)).max()
    assert radius == pytest.approx(1.0, abs=1e-12)


def test_time_integration_with_a_stiff_element_agrees_with_den_hartog():
    system = scenes.den_hartog_mass()
    march = time_integration.steady_state(system, 0.75, 1.0, n_steps=1024, rho_inf=0.7)
    stiff = exact.jenkins_steady_state(0.75, 1.0, m=1.0, c=0.0, k=1.0, k_t=2000.0, muN=0.2)
    assert np.abs(march.u).max() == pytest.approx(stiff.X, rel=1e-3)
    assert np.abs(march.u).max() == pytest.approx(exact.den_hartog_amplitude(0.75, 0.2), rel=5e-3)
    assert march.friction[0] == pytest.approx(stiff.loss, rel=1e-3)


# --- time integration against harmonic balance ------------------------------------------------------------------------

POINTS = [  # and of the chain in micro-slip and gross slip: verification/test_matrix_scenes.py, with the program between
    ("jenkins", "slip", 15, "exponential"),
    ("spatial", "stuck", 3, "explicit"),
    ("spatial", "slip", 15, "generalised-alpha"),
    ("spatial", "lift-off", 15, "explicit"),
    ("chain", "lift-off", 15, "explicit"),
    ("gap", "struck", 15, "explicit"),
    ("gap", "two states", 3, "explicit"),
]


@pytest.mark.parametrize(("scene", "regime", "H", "scheme"), POINTS)
def test_balance_agrees_with_time_integration_from_rest(scene, regime, H, scheme):
    system = scenes.SCENES[scene]()
    level, omega, states = system["levels"][regime]
    march = time_integration.steady_state(system, omega, level, n_steps=512, harmonics=H, tolerance=1e-5, scheme=scheme)
    balance = harmonic_balance.solve(system, omega, level, H=H, n_samples=256, start=march.u_hat, law="path")
    assert tuple(march.state) == tuple(balance.state) == states
    assert largest_difference(balance, march) < 1e-3
    assert march.friction == pytest.approx(balance.friction, rel=1e-3, abs=2e-4 * march.input)
    assert march.viscous + march.friction.sum() == pytest.approx(march.input, rel=1e-3)


def test_the_upper_solution_of_the_stop_is_periodic():
    system = scenes.gap_mass()
    level, omega, _ = system["levels"]["two states"]
    balance = harmonic_balance.follow(system, [0.7, 0.9, 1.0, omega], level, H=7, n_samples=256)[-1]
    balance = harmonic_balance.solve(system, omega, level, H=15, n_samples=512, start=balance.u_hat)
    march = time_integration.steady_state(
        system, omega, level, n_steps=512, start=balance.start(), tolerance=1e-5, scheme="explicit"
    )
    assert np.hypot(*balance.u_hat[2, 1:3]) == pytest.approx(2.3222, rel=1e-3)
    assert largest_difference(balance, march) < 1e-3


@pytest.mark.study
def test_radial_return_is_first_order_and_the_exact_path_second_order_where_slip_rotates():
    system = scenes.spatial_mass()
    level, omega, _ = system["levels"]["slip"]
    start = harmonic_balance.solve(system, omega, level, H=3, n_samples=64, law="path").u_hat
    exact_u = harmonic_balance.solve(system, omega, level, H=3, n_samples=128, start=start, law="path").u_hat
    errors = {}
    for law in ("return", "path"):
        for n_samples in (16, 64):
            u_hat = harmonic_balance.solve(system, omega, level, H=3, n_samples=n_samples, start=start, law=law).u_hat
            errors[law, n_samples] = np.abs(u_hat - exact_u).max() / np.abs(exact_u).max()
    assert 3.0 < errors["return", 16] / errors["return", 64] < 5.0
    assert errors["path", 16] / errors["path", 64] > 8.0
    assert errors["return", 64] > 1e-2 and errors["path", 64] < 2e-3, errors


@pytest.mark.parametrize(("scene", "regime"), [("jenkins", "onset"), ("spatial", "slip"), ("chain", "gross")])
def test_balance_from_the_linear_solution_conserves_energy(scene, regime):
    system = scenes.SCENES[scene]()
    level, omega, states = system["levels"][regime]
    balance = harmonic_balance.solve(system, omega, level, H=5, n_samples=256)
    assert tuple(balance.state) == states
    assert balance.viscous + balance.friction.sum() + _normal_work(balance) == pytest.approx(balance.input, rel=1e-9)


def _normal_work(balance):
    """The truncated normal force does some work, which vanishes with more harmonics and samples."""
    return scenes.cycle_work(balance.f_hat, balance.du_hat)[:, 2].sum()


@pytest.mark.parametrize("scene", sorted(scenes.SCENES))
def test_systems_are_symmetric_and_definite(scene):
    system = scenes.SCENES[scene]()
    for matrix in (system["M"], scenes.stuck_stiffness(system), scenes.damping_matrix(system)):
        np.testing.assert_allclose(matrix, matrix.T, atol=1e-12 * np.abs(matrix).max())
        assert np.linalg.eigvalsh(matrix).min() >= -1e-12 * np.abs(matrix).max()
    assert all(len(states) == len(system["mu"]) for _, _, states in system["levels"].values())


def test_load_phase_and_modal_damping_follow_their_definitions():
    system, H = scenes.spatial_mass(), 3
    f = scenes.force_coefficients(system, 2.0, H) @ scenes.harmonic_basis(H, 50)
    theta = 2.0 * np.pi * np.arange(50) / 50
    expected = 2.0 * (0.7 * np.cos(theta + np.pi / 3) + 0.1 * np.cos(2.0 * theta + 0.4))
    np.testing.assert_allclose(f[1], expected, atol=1e-12)
    np.testing.assert_allclose(f[0], 2.0 * (np.cos(theta) + 0.05), atol=1e-12)
    poles = np.linalg.eigvals(
        np.block(
            [  # of the stuck system, first-order form
                [np.zeros((3, 3)), np.eye(3)],
                [-np.linalg.solve(system["M"], matrix(system)) for matrix in (scenes.stuck_stiffness, scenes.damping_matrix)],
            ]
        )
    )
    np.testing.assert_allclose(-poles.real / np.abs(poles), 0.03, rtol=1e-10)


# --- bodies and structures --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bar", BARS)
def test_friction_bar_is_consistent(bar):
    x = np.linspace(0.0, bar.L, 20001)
    first, full = bar.first_slip, bar.full_slip
    for P in (0.9 * first, 1.1 * first, 0.6 * full + 0.4 * first, 0.99 * full):
        u = bar.displacement(x, P)
        assert u[0] == pytest.approx(bar.end_displacement(P), rel=1e-12)
        assert bar.end_force(u[0]) == pytest.approx(P, rel=1e-9)
        tau = np.minimum(bar.k * u, bar.q)  # equilibrium: P is carried by the foundation
        assert np.trapz(tau, x) == pytest.approx(P, rel=1e-6)
        assert bar.loss(P) == pytest.approx(np.trapz(bar.loss_density(x, P), x), rel=1e-4)
        assert bar.loss(P) == pytest.approx(exact.masing_loss(bar.end_force, u[0]), rel=1e-3, abs=1e-6 * P * u[0])
        np.testing.assert_allclose(bar.cyclic_displacement(x, P, -P), -u, atol=1e-12 * u[0])


def test_friction_bar_tends_to_the_rigid_foundation():
    P, rigid = 1.5, exact.rigid_foundation_bar(1.5, 2.0, 1.5)
    errors = []
    for k in (1e4, 1e6):
        bar = exact.FrictionBar(EA=2.0, L=3.0, q=1.5, k=k)
        errors.append(np.abs(np.divide([bar.slip_length(P), bar.end_displacement(P), bar.loss(P)], rigid) - 1.0))
    assert np.all(errors[1] < 1e-2) and np.all(errors[1] < errors[0])


def test_loss_of_spheres_follows_masing():
    data = {"mu": 0.3, "P": 10.0, "a": 0.1, "G": 80.0, "nu": 0.3}
    c = 2.0 * 1.7 / 80.0

    def backbone(u):
        return 3.0 * (1.0 - (1.0 - 16.0 * 0.1 * u / (3.0 * 3.0 * c)) ** 1.5)

    for Q in (0.3, 1.5, 2.9):
        displacement, loss = exact.cattaneo_mindlin(Q, **data)
        assert backbone(displacement) == pytest.approx(Q, rel=1e-12)
        assert exact.masing_loss(backbone, displacement) == pytest.approx(loss, rel=1e-6)


@pytest.mark.parametrize(
    ("ends", "first"),
    [
        (("clamped", "free"), (1.87510407, 4.69409113, 7.85475744)),
        (("free", "free"), (4.73004074, 7.85320462, 10.99560784)),
        (("clamped", "pinned"), (3.92660231, 7.06858275, 10.21017612)),
    ],
)
def test_slender_beam_has_the_textbook_roots(ends, first):
    omega = structures.beam_frequencies(3, length=1.0, EI=1.0, rhoA=1.0, ends=ends)
    assert np.sqrt(omega) == pytest.approx(first, abs=1e-8)


def test_a_pinned_timoshenko_beam_has_its_closed_form():
    length, EI, rhoA, rhoI, S = 2.0, 3.0, 5.0, 0.2, 40.0
    n = np.arange(1, 4)
    wave = (n * np.pi / length) ** 2
    a, b, c = rhoI * rhoA / (S * EI), rhoA / EI + wave * (rhoI / EI + rhoA / S), wave**2
    squares = (b - np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    computed = structures.beam_frequencies(
        3, length=length, EI=EI, rhoA=rhoA, ends=("pinned", "pinned"), shear_stiffness=S, rhoI=rhoI
    )
    assert computed == pytest.approx(np.sqrt(squares), rel=1e-9)


def test_timoshenko_beam_is_near_the_free_solid_beam_of_ansys():
    omega = structures.timoshenko_rectangle(
        1, length=5.0, width=1.0, height=1.0, young=16.9e6, poisson=0.31, density=4.1408e-4, ends=("free", "free")
    )
    assert omega / (2.0 * np.pi) == pytest.approx([7366.495], rel=2e-3)
    axial = structures.bar_frequencies(1, length=5.0, young=16.9e6, density=4.1408e-4)
    assert axial / (2.0 * np.pi) == pytest.approx([10172.6], rel=1e-2)  # the solid's clamp resists contraction


def test_free_square_plate_has_the_parameters_of_the_literature():
    # Leissa (1973) gives upper bounds with beam functions: 13.489, 19.789, 24.432, 35.024, 61.526
    parameters = structures.free_plate(6)
    assert parameters == pytest.approx([13.4682, 19.5961, 24.2702, 34.8009, 34.8009, 61.0932], abs=2e-4)
    assert np.all(parameters < [13.489, 19.789, 24.432, 35.024, 35.024, 61.526])
    assert structures.free_plate(5, thickness=1e-3, degree=10) == pytest.approx(parameters[:5], rel=1e-3)
