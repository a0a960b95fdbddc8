"""Rates of convergence of every kind; tests/verification/convergence.py prints the complete tables."""

import numpy as np
import pytest
from verification import convergence

QUADRATIC = [name for name, series in convergence.SERIES.items() if series[3] == 2]
# One refinement does not reach the limit: the least measured rates, rounded down; in theory they are 2 or 4.
PLATE_RATES = {
    "tet4": 1.4,
    "wedge6": 1.5,
    "hex8": 1.1,
    "hex8, no incompatible modes": 1.1,
    "tet10": 2.8,
    "wedge15": 3.4,
    "hex20": 3.4,
    "hex20, reduced": 4.0,
}


@pytest.mark.slow
@pytest.mark.parametrize("series", convergence.SERIES)
def test_box_on_rollers_converges_to_the_exact_mode(series):
    degree = convergence.SERIES[series][3]
    sizes = np.array([4.0, 8.0]) if degree == 1 else np.array([2.0, 4.0])
    errors = [convergence.roller_box(series, int(n)) / convergence.roller_box_exact() - 1.0 for n in sizes]
    rate = convergence.rates(np.array(errors), sizes)[0]
    assert errors[0] > errors[1] > 0.0  # frequencies of conforming elements with exact mass are too high
    assert rate > 0.8 * 2 * degree
    assert errors[1] < (0.05 if degree == 1 else 0.005)


def test_a_thin_ritz_plate_has_the_frequency_of_kirchhoff():
    thin = convergence.ritz_frequencies((1.0, 1.0, 0.01), (9, 9, 3), 1)[0]
    assert thin == pytest.approx(convergence.kirchhoff_frequency(0.01), rel=3e-3)
    assert thin < convergence.kirchhoff_frequency(0.01)  # shear and rotary inertia reduce it


@pytest.fixture(scope="module")
def plate_exact():
    return convergence.ritz_frequencies(convergence.PLATE, (9, 9, 5), 1)[0]


@pytest.mark.slow
@pytest.mark.parametrize("series", convergence.SERIES)
def test_free_plate_converges_to_three_dimensional_theory(series, plate_exact):
    errors = np.array([convergence.plate(series, n) for n in (1, 2)]) / plate_exact - 1.0
    assert errors[0] > errors[1] > 0.0
    assert convergence.rates(errors, np.array([1.0, 2.0]))[0] > PLATE_RATES[series]


@pytest.mark.parametrize(
    "series, bound", [("hex8", 2e-3), ("tet10", 2e-4), ("wedge15", 2e-4), ("hex20", 2e-4), ("hex20, reduced", 2e-4)]
)
def test_a_cantilever_two_elements_high_has_the_frequency_of_timoshenko(series, bound):
    assert convergence.cantilever(series, 2) == pytest.approx(convergence.timoshenko_frequency(), rel=bound)


def test_a_slender_timoshenko_beam_has_the_frequency_of_euler_bernoulli(monkeypatch):
    monkeypatch.setattr(convergence, "LENGTH", 1000.0)
    euler = 1.87510407**2 / 1000.0**2 * np.sqrt(convergence.YOUNG / 12.0 / convergence.DENSITY) / (2.0 * np.pi)
    assert convergence.timoshenko_frequency() == pytest.approx(euler, rel=5e-6)
