"""Real Fourier coefficients: order, exactness, derivative, work."""

import numpy as np
import pytest
from oracles.fourier import differentiate

from microslip.fourier.amplitudes import loaded_times, matrix_times
from microslip.fourier.coefficients import analyse, analysis_matrix, cycle_work, synthesis_matrix, synthesise
from microslip.fourier.harmonics import Harmonics


def test_coefficients_are_ordered_mean_cos_sin():
    theta = 2.0 * np.pi * np.arange(16) / 16
    U = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    expected = 1.0 + 2.0 * np.cos(theta) + 3.0 * np.sin(theta) + 4.0 * np.cos(2.0 * theta) + 5.0 * np.sin(2.0 * theta)
    assert np.allclose(synthesise(U, 16), expected, atol=1e-14)


@pytest.mark.parametrize("H", [0, 1, 2, 5, 15, 31])
@pytest.mark.parametrize("extra", [0, 1, 2, 65])
def test_analysis_inverts_synthesis_from_the_smallest_number_of_samples(H, extra):
    harmonics, N_t = Harmonics.up_to(H), 2 * H + 1 + extra
    F, E = analysis_matrix(harmonics, N_t), synthesis_matrix(harmonics, N_t)
    assert F.shape == (2 * H + 1, N_t) and np.allclose(F @ E, np.eye(2 * H + 1), atol=1e-14)
    U = np.random.default_rng(H).standard_normal((4, 3, 2 * H + 1))
    assert np.allclose(analyse(synthesise(U, N_t), harmonics), U, atol=1e-13)


def test_too_few_samples_are_rejected():
    with pytest.raises(ValueError, match="6 samples cannot carry 3 harmonics; at least 7"):
        analysis_matrix(Harmonics((0, 3)), 6)


def test_fourier_matrices_are_cached_and_read_only():
    harmonics, same = Harmonics.up_to(3), Harmonics((0, 1, 2, 3))
    assert synthesis_matrix(harmonics, 128) is synthesis_matrix(same, 128)
    for matrix in (synthesis_matrix(harmonics, 128), analysis_matrix(harmonics, 128)):
        with pytest.raises(ValueError, match="read-only"):
            matrix[0, 0] = 2.0


def test_high_harmonics_are_exact_to_roundoff():
    N_t = 4096
    exact = np.cos(2.0 * np.pi * ((31 * np.arange(N_t)) % N_t) / N_t)
    assert np.array_equal(synthesis_matrix(Harmonics.up_to(31), N_t)[:, 61], exact)


def test_derivative():
    U = np.random.default_rng(1).standard_normal((3, 9))
    h = 1e-5
    theta = 2.0 * np.pi * np.arange(32) / 32
    shifted = [
        sum(U[:, [2 * n - 1]] * np.cos(n * (theta + s)) + U[:, [2 * n]] * np.sin(n * (theta + s)) for n in range(1, 5))
        for s in (h, -h)
    ]
    assert np.allclose(synthesise(differentiate(U), 32), (shifted[0] - shifted[1]) / (2.0 * h), atol=1e-7)
    assert np.allclose(differentiate(differentiate(U)), -U * [0, 1, 1, 4, 4, 9, 9, 16, 16])


def test_cycle_work_is_the_integral_of_force_times_velocity():
    force, U = np.random.default_rng(2).standard_normal((2, 5, 3, 7))
    power = synthesise(force, 64) * synthesise(differentiate(U), 64)
    assert np.allclose(cycle_work(force, U), 2.0 * np.pi * power.mean(axis=-1), atol=1e-12)
    assert np.allclose(cycle_work(U, U), 0.0, atol=1e-13)  # springs do no work in a cycle
    assert np.allclose(cycle_work(differentiate(U), U) >= 0.0, True)  # dampers dissipate energy


@pytest.mark.parametrize("kind", [float, complex])
def test_products_with_few_loaded_harmonics_equal_full_products(kind):
    random = np.random.default_rng(7)
    A, x = random.standard_normal((5, 4)).astype(kind), random.standard_normal((4, 6))
    if kind is complex:
        A += 1j * random.standard_normal(A.shape)
    x[:, 2:4] = 0.0
    assert np.allclose(loaded_times(A, x), matrix_times(A, x), atol=1e-14)
    assert not loaded_times(A, np.zeros_like(x)).any()
