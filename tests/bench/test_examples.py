"""The examples of jobs/examples in small, against closed forms."""

import sys
from pathlib import Path

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import exact, scenes
from scipy.optimize import minimize_scalar

import microslip

sys.path.append(str(Path(__file__).parents[2] / "jobs" / "examples"))

from damper_design import best_damper, mean_of_peaks

C, LEVEL = 0.02, 0.8


@pytest.fixture
def mass(tmp_path):
    """Build m = k = k_t = N = 1, c = 0.02."""
    loads = [{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}]
    system = scenes.make_system(
        "one mass", [[1.0]], [[1.0]], [[0, -1, -1, -1, -1, -1]], mu=0.5, N0=1.0, k_t=1.0, k_n=0.0, C=np.array([[C]]),
        loads=loads, output=[1.0], omega=(0.5, 2.0), levels={},
    )  # fmt: skip
    path = write_matrix_scene(tmp_path, system, [LEVEL], (0.5, 4.0), points=20, harmonics=1, samples=512)
    with microslip.build(microslip.read(path)) as structure:
        yield structure


def test_the_best_damper_of_one_mass_is_the_closed_form(mass):
    """Friction and normal force act by their product alone: the limit at which the peak of the level is least."""
    least = minimize_scalar(lambda limit: exact.jenkins_peak(LEVEL, limit, C), bounds=(0.1, 2.0), method="bounded")
    best = best_damper(mass, [LEVEL], (0.3, 1.0))
    assert np.exp(best.x.sum()) == pytest.approx(least.x, rel=0.03)
    assert LEVEL * np.exp(best.fun) == pytest.approx(least.fun, rel=1e-3)


def test_its_slopes_are_differences(mass):
    levels, h = [0.6, LEVEL], 0.01
    value, slope = mean_of_peaks(mass, levels, 0.4, 1.2)
    ends = [[mean_of_peaks(mass, levels, *at)[0] for at in ends] for ends in (
        ((0.4 * np.exp(-h), 1.2), (0.4 * np.exp(h), 1.2)), ((0.4, 1.2 * np.exp(-h)), (0.4, 1.2 * np.exp(h)))
    )]  # fmt: skip
    assert slope == pytest.approx([(after - before) / (2.0 * h) for before, after in ends], rel=0.02)
    assert min(min(pair) for pair in ends) < value < max(max(pair) for pair in ends)
