"""Generalised-alpha: its order, its spectral radius, the fitted step, the forced period."""

import numpy as np
import pytest

from microslip.receptance.damping import Damping
from microslip.transient.scheme import GeneralisedAlpha, Motion, fitted_angle, step_angle, step_factors


def oscillator(n_steps, rho, t_end=7.0, zeta=0.05):
    """Return the largest error of u'' + 2 zeta u' + u = cos(2 t), u(0) = 1, u'(0) = 0.5, against its exact solution."""
    n, w, e = 1.0 - 4.0, np.sqrt(1.0 - zeta**2), 4.0 * zeta
    a, b = n / (n**2 + e**2), e / (n**2 + e**2)  # the forced part a cos 2t + b sin 2t

    def exact(t):
        c, s = 1.0 - a, (0.5 - 2.0 * b + zeta * (1.0 - a)) / w
        return np.exp(-zeta * t) * (c * np.cos(w * t) + s * np.sin(w * t)) + a * np.cos(2.0 * t) + b * np.sin(2.0 * t)

    h = t_end / n_steps
    scheme = GeneralisedAlpha(np.ones(1), Damping(np.array([2.0 * zeta])), np.array([h]), rho)
    z, error = Motion(*(np.array([[x]]) for x in (1.0, 0.5, 1.0 - 2.0 * zeta * 0.5 - 1.0))), 0.0
    for k in range(n_steps):
        q0, q1 = (np.array([[np.cos(2.0 * h * i)]]) for i in (k, k + 1))
        z = scheme.free(z, q0, q1)
        error = max(error, abs(z.eta[0, 0] - exact(h * (k + 1))))
    return error


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, 1.0])
def test_the_error_falls_with_the_square_of_the_step(rho):
    errors = [oscillator(n_steps, rho) for n_steps in (100, 200, 400)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("rho", [0.2, 0.5, 0.9, 1.0])
def test_the_spectral_radius_falls_from_one_to_rho(rho):
    radii = [np.abs(step_factors(angle, rho)).max() for angle in np.logspace(-2, 6, 60)]
    assert max(radii) <= 1.0 + 1e-12
    assert np.abs(step_factors(1e9, rho)) == pytest.approx(rho, abs=1e-4)
    assert np.all(np.diff(radii) < 1e-12)
    assert 1.0 - radii[0] < 0.1 * 0.01**3 * 4.0  # the loss of a resolved motion is of the order of the angle's cube


def test_a_fitted_step_has_exactly_its_number_of_steps_per_period():
    for n_steps, rho in ((16, 0.5), (128, 0.9), (512, 0.9)):
        angle = fitted_angle(n_steps, rho)
        assert n_steps * step_angle(angle, rho) == pytest.approx(2.0 * np.pi, rel=1e-12)
        assert angle * n_steps / 2.0 / np.pi > 1.0  # the plain step would be too short
    assert fitted_angle(64, 1.0) == pytest.approx(2.0 * np.tan(np.pi / 64), rel=1e-12)  # the trapezoidal rule, prewarped


@pytest.mark.parametrize("full", [False, True])
def test_the_period_solver_gives_the_periodic_motion_at_a_sharp_resonance(full):
    """Two modes, one driven at resonance with zeta = 1e-4: amplitude and phase exact to the square of the step."""
    omega_n, C, n_steps = np.array([1.0, 3.3]), np.array([2e-4, 6.6e-4]), 128
    C = np.array([[2e-4, 1e-5], [1e-5, 6.6e-4]]) if full else C
    omega = np.array([1.0, 1.0003])
    scheme = GeneralisedAlpha(omega_n, Damping(C), fitted_angle(n_steps) / omega)
    load = np.cos(2.0 * np.pi * np.arange(n_steps + 1) / n_steps)[:, None] * np.array([1.0, 0.5])

    def period(z):
        history = []
        for k in range(n_steps):
            z = scheme.free(z, np.tile(load[k], (2, 1)), np.tile(load[k + 1], (2, 1)))
            history.append(z.eta)
        return z, np.array(history)

    zero = np.zeros((2, 2))
    after, _ = period(Motion(zero, zero, zero))
    start = scheme.unpack(scheme.solve_period(scheme.pack(after), n_steps))
    end, history = period(start)
    assert scheme.pack(end) == pytest.approx(scheme.pack(start), rel=1e-9, abs=1e-9 * np.abs(scheme.pack(start)).max())
    computed = 2.0 / n_steps * np.einsum("kbm,k->bm", history, np.exp(-2j * np.pi * np.arange(1, n_steps + 1) / n_steps))
    damping = C if full else np.diag(C)
    for b, w in enumerate(omega):
        exact = np.linalg.solve(np.diag(omega_n**2 - w**2) + 1j * w * damping, [1.0, 0.5])
        assert computed[b] == pytest.approx(exact, abs=1e-3 * np.abs(exact).max())
    plain = GeneralisedAlpha(omega_n, Damping(C), 2.0 * np.pi / n_steps / omega)
    assert np.abs(plain.solve_period(scheme.pack(after), n_steps)).max() < 0.7 * np.abs(scheme.pack(start)).max()
