"""Rates of the laws by their parameters, compared with central differences where no sample switches; rejected parameters."""

from dataclasses import replace

import numpy as np
import pytest
from test_combined import by_direction, elastic, iwan, mixed, motions, rough

from microslip.contact.iwan import Iwan
from microslip.fourier.harmonics import Harmonics

N = 12


def started(n, seed=0):
    w0 = 0.05 * np.random.default_rng(seed + 4).standard_normal((n, 2))
    return elastic(n, seed, w0=w0)


def with_gaps(n, seed=0):
    law = elastic(n, seed)
    return replace(law, N0=-0.2 * law.N0)


def with_open_pairs(n, seed=0):
    return replace(with_gaps(n, seed), open_at_rest=np.ones(n, dtype=bool))


def open_at_rest_by_direction(n, seed=0):
    law = by_direction(n, seed)
    return replace(law, N0=-0.2 * law.N0, open_at_rest=np.ones(n, dtype=bool))


def without_normal_stiffness(n, seed=0):
    return replace(elastic(n, seed), k_n=np.zeros(n))


def rough_open_at_rest(n, seed=0):
    rng, law = np.random.default_rng(seed), rough(n, seed)
    open_ = np.ones(n, dtype=bool)
    return replace(law, exponent=rng.choice([2.0, 3.3], n), reference=law.N0, N0=-0.2 * law.N0, open_at_rest=open_)


def at_samples(n, seed=0):
    return started(n, seed).followed(False)


ELASTIC = ("mu", "N0", "k_t", "k_n")
CASES = [
    *[(make, name) for make in (elastic, started, by_direction, at_samples, rough) for name in ELASTIC],
    *[
        (make, name)
        for make in (with_gaps, with_open_pairs, open_at_rest_by_direction, rough_open_at_rest)
        for name in (*ELASTIC, "gap")
    ],
    *[(without_normal_stiffness, name) for name in ("mu", "N0", "k_t")],
    *[(iwan, name) for name in ("slip_force", "k_t")],
]


def value_of(law, name):
    if name == "gap":
        return -law.N0 / law.k_n
    return getattr(law, {"slip_force": "F_S", "k_t": "K_T"}[name] if isinstance(law, Iwan) else name)


def slope_of(law, name, U, harmonics=None, h=1e-5, n_samples=64):
    """Return the central differences by each pair's value, with a step and its half, and the pairs for which both agree."""
    values, pairs = value_of(law, name), np.arange(law.n_pairs)

    def slope(h):
        step = h * np.abs(values)
        both = (law.with_parameters(name, pairs, values + sign * step) for sign in (1.0, -1.0))
        up, down = (moved.cycle(U, n_samples, False, harmonics).p for moved in both)
        return (up - down) / (2.0 * step)[:, None, None]

    return slope(h), slope(h / 4.0)


def assert_rate(law, name, U, harmonics=None, least=0.5, tolerance=1e-5):
    rate = law.parameter_rate(name, U, 64, harmonics)
    slope, finer = slope_of(law, name, U, harmonics)
    size = np.abs(slope).max()
    smooth = np.abs(slope - finer).max(axis=(1, 2)) < tolerance * size
    assert size > 1e-3 and rate.shape == U.shape
    assert smooth.mean() > least
    assert np.abs(rate - finer)[smooth].max() < tolerance * size


@pytest.mark.parametrize("make, name", CASES)
def test_parameter_rate_is_the_derivative_of_the_cycle(make, name):
    assert_rate(make(N), name, motions(N, 0.4))


@pytest.mark.parametrize("make", [started, by_direction])
@pytest.mark.parametrize("name", ELASTIC)
def test_harmonics_without_a_mean_have_the_same_rates(make, name):
    assert_rate(make(N), name, motions(N, 0.6)[:, :, 1:], Harmonics((1, 2, 3)))


@pytest.mark.parametrize("name", ["k_t", "k_n"])
def test_combined_laws_give_each_pair_the_rate_of_its_law(name):
    law, U = mixed(N), motions(N, 0.4)
    rate, parts = law.parameter_rate(name, U, 64), law.parts
    assert len(parts) == 3 and np.abs(rate).max() > 0.1
    for owned, part in parts:
        assert np.array_equal(rate[owned], part.parameter_rate(name, U[owned], 64))
    pairs = np.array([7, 2, 10])
    changed = law.with_parameters(name, pairs, np.array([3.0, 3.5, 4.0]))
    column = 0 if name == "k_t" else 2
    assert changed.stiffness[pairs, column].tolist() == [3.0, 3.5, 4.0]
    others = np.setdiff1d(np.arange(N), pairs)
    assert np.array_equal(changed.stiffness[others], law.stiffness[others])


@pytest.mark.parametrize("name", ["mu", "k_t"])
@pytest.mark.parametrize("separate", [False, True])
def test_the_rate_at_zero_is_one_sided(name, separate):
    law = replace(elastic(N, separate=np.full(N, separate)), **{name: np.zeros(N)})
    U = motions(N, 0.6)
    rate, values = law.parameter_rate(name, U, 64), np.full(N, 1e-4)
    slope = (law.with_parameters(name, np.arange(N), values).cycle(U, 64).p - law.cycle(U, 64).p) / 1e-4
    assert np.abs(slope).max() > 0.01
    assert np.abs(rate - slope).max() < 1e-2 * np.abs(slope).max()


@pytest.mark.parametrize("name", ["N0", "k_n"])
def test_a_pair_without_normal_stiffness_has_the_rate_by_it(name):
    law, U = without_normal_stiffness(N), motions(N, 0.4)
    rate, h = law.parameter_rate(name, U, 64), 1e-6
    values = value_of(law, name) + h
    slope = (law.with_parameters(name, np.arange(N), values).cycle(U, 64).p - law.cycle(U, 64).p) / h
    assert np.abs(slope).max() > 0.1
    assert np.median(np.abs(rate - slope).max(axis=(1, 2))) < 1e-4 * np.abs(slope).max()


@pytest.mark.parametrize("make", [elastic, rough])
def test_pairs_that_stick_have_no_rate(make):
    U = motions(N, 1e-4)
    U[:, 2] = 0.0
    law = replace(make(N), mu=np.full(N, 50.0))
    for name in ELASTIC:
        assert np.abs(law.parameter_rate(name, U, 64)).max() < 1e-12


def test_changed_parameters_are_columns_of_the_law():
    law = by_direction(3)
    more = law.with_parameters("mu", np.array([1]), np.array([2.0 * law.mu[1]]))
    assert more.mu.tolist() == [law.mu[0], 2.0 * law.mu[1], law.mu[2]]
    assert more.mu_y == pytest.approx([law.mu_y[0], 2.0 * law.mu_y[1], law.mu_y[2]])
    gaps = with_gaps(3).with_parameters("gap", np.array([0, 2]), np.array([0.5, 0.25]))
    assert (-gaps.N0 / gaps.k_n)[[0, 2]] == pytest.approx([0.5, 0.25]) and gaps.N0[1] == with_gaps(3).N0[1]
    for law in (gaps, rough_open_at_rest(3)):
        stiffer = law.with_parameters("k_n", np.array([1]), np.array([7.0]) * law.k_n[1])
        np.testing.assert_allclose(stiffer.N0 / stiffer.k_n, law.N0 / law.k_n, rtol=1e-14)


@pytest.mark.parametrize("make", [elastic, rough])
def test_a_preload_cannot_become_a_gap(make):
    with pytest.raises(ValueError, match="N0 of pair 1 goes from"):
        make(3).with_parameters("N0", np.array([1]), np.array([-0.1]))
    with pytest.raises(ValueError, match="N0 of pair 1 goes from"):
        make(3).with_parameters("gap", np.array([1]), np.array([0.1]))


@pytest.mark.parametrize(
    "make, name", [(elastic, "slip_force"), (rough, "slip_force"), (iwan, "mu"), (iwan, "N0"), (iwan, "gap")]
)
def test_a_parameter_unknown_to_the_law_is_rejected(make, name):
    law = make(3)
    with pytest.raises(ValueError, match=f"no parameter '{name}'"):
        law.with_parameters(name, np.arange(3), np.ones(3))
    with pytest.raises(ValueError, match=f"no parameter '{name}'"):
        law.parameter_rate(name, motions(3, 0.4), 64)
