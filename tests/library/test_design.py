"""Designs of samples and their Sobol indices, compared with distributions and a function of known indices."""

import numpy as np
import pytest

from microslip.library.design import Design, Scatter, grid, one_by_one, scattered, sobol_indices, sobol_intervals
from microslip.messages.errors import CaseError


@pytest.mark.parametrize("kind", ["sobol", "latin"])
@pytest.mark.parametrize(("distribution", "spread"), [("lognormal", 0.3), ("normal", 0.3), ("uniform", 0.3 / np.sqrt(3.0))])
def test_samples_have_the_requested_mean_and_scatter(kind, distribution, spread):
    x = scattered({"mu": Scatter(0.2, 30.0, distribution), "k": Scatter(-5.0, 1.0)}, 1024, kind).values
    assert x[:, 0].mean() == pytest.approx(0.2, rel=2e-3) and x[:, 1].mean() == pytest.approx(-5.0, rel=1e-3)
    assert x[:, 0].std() / 0.2 == pytest.approx(spread, rel=2e-2)
    assert abs(np.corrcoef(x.T)[0, 1]) < 0.05
    assert distribution == "normal" or (x[:, 0] > 0.0).all()


def test_sobol_samples_are_nested():
    scatter = {"mu": Scatter(0.2, 30.0), "level": Scatter(5.0, 10.0, "uniform")}
    assert (scattered(scatter, 16).values == scattered(scatter, 64).values[:16]).all()
    assert (scattered(scatter, 16, seed=1).values != scattered(scatter, 16).values).all()


def test_sobol_indices_of_ishigamis_function():
    """Ishigami's function on -pi to pi, a = 7, b = 0.1: main 0.3139, 0.4424, 0, total 0.5576, 0.4424, 0.2437."""
    design = scattered({name: Scatter(1.0, 100.0, "uniform") for name in "xyz"}, 4096, "indices")
    x, y, z = np.pi * (design.values.T - 1.0)
    f = np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)
    f[17] = np.nan  # a sample that failed
    main, total = sobol_indices(f, 3)
    assert main == pytest.approx([0.3139, 0.4424, 0.0], abs=0.02)
    assert total == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.02)
    assert np.isnan(sobol_indices(np.ones(15), 3)).all()


def test_samples_of_indices_have_the_order_of_saltelli():
    of_base = scattered({name: Scatter(1.0, 50.0) for name in "xyz"}, 8, "indices").values.reshape(8, 5, 3)
    A, *mixed, B = of_base.swapaxes(0, 1)
    assert (A != B).all()
    for j, AB in enumerate(mixed):
        assert (AB[:, j] == B[:, j]).all() and (np.delete(AB, j, axis=1) == np.delete(A, j, axis=1)).all()


def test_salib_computes_the_same_indices():
    analyze = pytest.importorskip("SALib.analyze.sobol").analyze
    design = scattered({name: Scatter(1.0, 50.0, "uniform") for name in "xy"}, 256, "indices")
    f = np.sin(design.values[:, 0]) + design.values[:, 0] * design.values[:, 1] ** 2
    problem = {"num_vars": 2, "names": ["x", "y"], "bounds": [[0.0, 1.0]] * 2}
    of_salib = analyze(problem, f, calc_second_order=False, num_resamples=10)
    for computed, name in zip(sobol_indices(f, 2), ("S1", "ST")):
        assert computed == pytest.approx(of_salib[name], abs=1e-3)


def test_intervals_of_indices_cover_the_exact_values():
    """The same function with 128 samples, 20 seeds, three numbers, main and total: at least 110 of 120 (95 % are 114)."""
    exactly, n_within = np.array([[0.3139, 0.4424, 0.0], [0.5576, 0.4424, 0.2437]]), 0
    for seed in range(20):
        design = scattered({name: Scatter(1.0, 100.0, "uniform") for name in "xyz"}, 128, "indices", seed)
        x, y, z = np.pi * (design.values.T - 1.0)
        f = np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)
        off = np.abs(np.array(sobol_indices(f, 3)) - exactly)
        n_within += np.count_nonzero(off < np.array(sobol_intervals(f, 3)))
    assert 110 <= n_within
    assert np.isnan(sobol_intervals(np.ones(15), 3)).all()


def test_grids_and_one_at_a_time_designs():
    of_two = grid({"a": [1.0, 2.0, 3.0], "b": [10.0, 20.0]})
    assert of_two.shape == (3, 2) and of_two.axes == ("a", "b")
    assert of_two.values[:3].tolist() == [[1.0, 10.0], [1.0, 20.0], [2.0, 10.0]]
    one_at_a_time = one_by_one({"a": [1.0, 2.0], "b": [10.0]}, {"a": 5.0, "b": 7.0})
    assert one_at_a_time.values.tolist() == [[1.0, 7.0], [2.0, 7.0], [5.0, 10.0]]
    with pytest.raises(CaseError, match="one length"):
        Design.paired({"a": [1.0, 2.0], "b": [1.0]})
    with pytest.raises(CaseError, match="more than"):
        grid({"a": np.arange(1000.0), "b": np.arange(1000.0)})
    with pytest.raises(CaseError, match="states no b"):
        one_by_one({"a": [1.0], "b": [10.0]}, {"a": 5.0, "b": np.nan})
