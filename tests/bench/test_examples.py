"""The examples of jobs/examples at small size, compared with closed forms."""

import sys
from pathlib import Path

import numpy as np
import pytest
from discs import write_sector
from matrix_scenes import write_matrix_scene
from oracles import exact, scenes
from scipy.optimize import minimize_scalar

import microslip
from microslip.tables.cyclic import QUANTITIES

sys.path.append(str(Path(__file__).parents[2] / "jobs" / "examples"))

from damper_design import best_damper, mean_of_peaks
from scatter_limit import Discs, scatter_at

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


def test_the_optimal_damper_of_one_mass_has_its_closed_form(mass):
    """The result depends on the product of friction and normal force: the limit with the smallest peak of the level."""
    least = minimize_scalar(lambda limit: exact.jenkins_peak(LEVEL, limit, C), bounds=(0.1, 2.0), method="bounded")
    best = best_damper(mass, [LEVEL], (0.3, 1.0))
    assert np.exp(best.x.sum()) == pytest.approx(least.x, rel=0.03)
    assert LEVEL * np.exp(best.fun) == pytest.approx(least.fun, rel=1e-3)


@pytest.mark.study
def test_slopes_of_the_optimal_damper_agree_with_differences(mass):
    levels, h = [0.6, LEVEL], 0.01
    value, slope = mean_of_peaks(mass, levels, 0.4, 1.2)
    ends = [[mean_of_peaks(mass, levels, *at)[0] for at in ends] for ends in (
        ((0.4 * np.exp(-h), 1.2), (0.4 * np.exp(h), 1.2)), ((0.4, 1.2 * np.exp(-h)), (0.4, 1.2 * np.exp(h)))
    )]  # fmt: skip
    assert slope == pytest.approx([(after - before) / (2.0 * h) for before, after in ends], rel=0.02)
    assert min(min(pair) for pair in ends) < value < max(max(pair) for pair in ends)


def test_uncoupled_blades_exceed_the_limit_with_the_largest_load(tmp_path):
    """Sectors whose shrouds have no stiffness move independently: the worst blade has the largest factor 1 + scatter z."""
    N, n_discs, limit = 4, 3, 1.05
    end = (
        "[damping]\nratio = 0.01\n[response]\nlevels = [1.0]\nmode = 1\nspan = [0.97, 1.03]\npoints = 10\n"
        "[solver]\nmodes = 10\nharmonics = 1\nsamples = 32\nerror_bars = false\n"
    )
    scene = write_sector(tmp_path, N, end, wave={"engine_order": 1, "whole": True}, how={"shroud": True}, of_shrouds={"k_t": 1.0})
    text = scene.read_text().replace("whole = true\n", "whole = true\nscatter = { load = 0.1, seed = 1 }\n")
    scene.write_text("".join(line for line in text.splitlines(keepends=True) if not line.startswith("faces = ")))
    draws = [np.random.default_rng(seed).standard_normal((len(QUANTITIES), N)) for seed in range(1, n_discs + 1)]
    largest = np.quantile([draw[QUANTITIES.index("load")].max() for draw in draws], 0.9)
    passed = scatter_at(Discs(scene, "load", n_discs), limit, [0.01, 0.03, 0.1], say=lambda line: None)
    assert passed == pytest.approx((limit - 1.0) / largest, rel=0.02)
    assert scatter_at(Discs(scene, "load", n_discs), 2.0, [0.01], say=lambda line: None) is None
