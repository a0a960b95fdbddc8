"""Amplitude, phase and counts compared with their definitions."""

import numpy as np
import pytest

from microslip.fourier.coefficients import amplitude, phase
from microslip.results.measures import counts, peak


def test_amplitude_and_phase_reproduce_the_motion():
    rng = np.random.default_rng(1)
    coefficients = rng.normal(size=(20, 7))
    tau = np.linspace(0.0, 2.0 * np.pi, 50)
    for n in (1, 2, 3):
        c, s = coefficients[:, [2 * n - 1]], coefficients[:, [2 * n]]
        motion = c * np.cos(n * tau) + s * np.sin(n * tau)
        a, angle = amplitude(coefficients, n)[:, None], phase(coefficients, n)[:, None]
        assert a * np.cos(n * tau + angle) == pytest.approx(motion, abs=1e-14)


def test_a_motion_that_lags_has_a_negative_phase():
    lag = 0.3  # cos(tau - lag) = cos(lag) cos(tau) + sin(lag) sin(tau)
    assert phase(np.array([0.0, np.cos(lag), np.sin(lag)])) == pytest.approx(-lag)


def test_no_motion_has_phase_zero():
    assert phase(np.zeros(3)) == 0.0 and not np.signbit(phase(np.zeros(3)))


def test_counts_of_states():
    assert counts(np.array([[0, 1, 1, 2], [0, 0, 0, 0]], dtype=np.uint8)).tolist() == [[1, 2, 1], [4, 0, 0]]
    assert counts(np.zeros((3, 0), dtype=np.uint8)).tolist() == [[0, 0, 0]] * 3


def test_peak_is_the_largest_amplitude_of_the_output():
    response = np.zeros((3, 2, 3))
    response[1, 0, 2], response[2, 1, 1] = -2.0, 1.0
    assert peak(response) == 1
    assert peak(response, 1) == 2
    assert peak(response[:0]) is None
