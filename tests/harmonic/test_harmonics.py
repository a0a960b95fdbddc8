"""Sets of harmonics: order of the coefficients, conversion between sets, work and contact forces on a subset of the harmonics."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles.fourier import differentiate

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.energy import pair_energy
from microslip.fourier.amplitudes import to_complex, to_real
from microslip.fourier.coefficients import analyse, analysis_matrix, cycle_work, synthesis_matrix, synthesise
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.preconditioner import complex_linear
from microslip.receptance.damping import Flexibility

sets = st.sets(st.integers(0, 9), min_size=1, max_size=6).map(lambda chosen: Harmonics(tuple(sorted(chosen))))
seeds = st.integers(0, 2**32 - 1)


def coefficients(harmonics, seed, *shape):
    return np.random.default_rng(seed).standard_normal((*shape, harmonics.n_coefficients))


def test_order_of_the_coefficients():
    odd, with_mean = Harmonics((1, 3)), Harmonics((0, 3))
    theta = 2.0 * np.pi * np.arange(16) / 16
    expected = 2.0 * np.cos(theta) + 3.0 * np.sin(theta) + 4.0 * np.cos(3.0 * theta) + 5.0 * np.sin(3.0 * theta)
    assert np.allclose(synthesise(np.array([2.0, 3.0, 4.0, 5.0]), 16, odd), expected, atol=1e-14)
    expected = 2.0 + 3.0 * np.cos(3.0 * theta) + 4.0 * np.sin(3.0 * theta)
    assert np.allclose(synthesise(np.array([2.0, 3.0, 4.0]), 16, with_mean), expected, atol=1e-14)


def test_the_full_set_and_the_odd_set():
    full, odd = Harmonics.up_to(3), Harmonics.odd_up_to(6)
    assert full == Harmonics((0, 1, 2, 3)) == Harmonics.full(7) and hash(full) == hash(Harmonics((0, 1, 2, 3)))
    assert (full.n_coefficients, full.highest, full.has_mean, list(full.above_mean)) == (7, 3, True, [1, 2, 3])
    assert odd.chosen == (1, 3, 5) and (odd.n_coefficients, odd.has_mean) == (6, False) and list(odd.numbers) == [1, 3, 5]
    assert [full.columns(n) for n in range(3)] == [slice(0, 1), slice(1, 3), slice(3, 5)]
    assert odd.columns(3) == slice(2, 4) and 3 in odd and 2 not in odd and str(odd) == "1, 3, 5"
    with pytest.raises(ValueError, match="read-only"):
        odd.numbers[0] = 2


@pytest.mark.parametrize("chosen", [(), (-1, 0), (1, 1), (3, 1)])
def test_sets_that_are_empty_negative_or_not_increasing_are_rejected(chosen):
    with pytest.raises(ValueError, match="each above the one before"):
        Harmonics(chosen)


def test_coefficients_that_do_not_fit_their_set_are_rejected():
    with pytest.raises(ValueError, match="6 coefficients are not those of the harmonics 0 to H"):
        synthesise(np.zeros(6), 16)
    with pytest.raises(ValueError, match="5 coefficients for the harmonics 1, 3, which have 4"):
        Harmonics((1, 3)).carry(np.zeros(5), Harmonics.up_to(3))
    ones = np.ones(1)
    with pytest.raises(ValueError, match="5 coefficients for the harmonics 1, 3, which have 4"):
        ElasticCoulomb(ones, ones, ones, ones, ones > 2).cycle(np.zeros((1, 3, 5)), 16, harmonics=Harmonics((1, 3)))


@given(sets, sets, seeds)
def test_converted_coefficients_are_the_same_motion_without_the_dropped_harmonics(a, b, seed):
    U = coefficients(a, seed, 2, 3)
    everything = Harmonics.up_to(9)
    assert np.array_equal(everything.carry(a.carry(U, everything), a), U)  # conversion to a larger set and back loses nothing
    carried = a.carry(U, b)
    samples, N_t = synthesise(U, 32, a), 32
    assert np.allclose(carried, analyse(samples, b) * [n in a for n in b.chosen for _ in range(2 if n else 1)], atol=1e-12)
    shared = [n for n in a.chosen if n in b]
    if shared:
        common = Harmonics(tuple(shared))
        assert np.array_equal(b.carry(carried, common), a.carry(U, common))
        assert np.allclose(synthesise(carried, N_t, b), synthesise(a.carry(U, common), N_t, common), atol=1e-12)
    else:
        assert not carried.any()


@given(sets, seeds, st.integers(0, 40))
def test_analysis_inverts_synthesis(harmonics, seed, extra):
    N_t = 2 * harmonics.highest + 1 + extra
    assert np.allclose(
        analysis_matrix(harmonics, N_t) @ synthesis_matrix(harmonics, N_t), np.eye(harmonics.n_coefficients), atol=1e-13
    )
    U = coefficients(harmonics, seed, 4)
    assert np.allclose(analyse(synthesise(U, N_t, harmonics), harmonics), U, atol=1e-12)


@given(sets, seeds)
def test_cycle_work_is_the_integral_of_force_times_velocity(harmonics, seed):
    force, U = coefficients(harmonics, seed, 2, 5)
    power = synthesise(force, 64, harmonics) * synthesise(differentiate(U, harmonics), 64, harmonics)
    assert np.allclose(cycle_work(force, U, harmonics), 2.0 * np.pi * power.mean(axis=-1), atol=1e-11)
    assert np.allclose(cycle_work(U, U, harmonics), 0.0, atol=1e-12)
    assert np.all(cycle_work(differentiate(U, harmonics), U, harmonics) >= 0.0)


@given(sets, seeds)
def test_complex_amplitudes_and_products_harmonic_by_harmonic(harmonics, seed):
    q = coefficients(harmonics, seed, 4)
    N_H, n = harmonics.n_coefficients, len(harmonics)
    assert np.array_equal(to_real(to_complex(q), N_H), q)
    theta = 0.3
    at_theta = (to_complex(q) * np.exp(1j * theta * harmonics.numbers)).real.sum(axis=1)
    basis = [f(k * theta) for k in harmonics.chosen for f in ((np.cos, np.sin) if k else (np.cos,))]
    assert np.allclose(at_theta, q @ basis)
    rng = np.random.default_rng(seed)
    c = rng.standard_normal((4, n)) + 1j * rng.standard_normal((4, n))
    c[:, harmonics.numbers == 0] = c[:, harmonics.numbers == 0].real
    assert np.allclose(to_complex(Flexibility(c).apply(q)), c * to_complex(q))
    full = np.stack([np.diag(column) for column in c.T])
    assert np.allclose(Flexibility(full).apply(q), Flexibility(c).apply(q))


@given(sets, seeds, st.integers(0, 30))
def test_contact_forces_on_a_subset_are_those_of_the_full_set(harmonics, seed, extra):
    """For the same motion, p and dp/dU are the rows and columns of the set."""
    rng = np.random.default_rng(seed)
    full = Harmonics.up_to(harmonics.highest)
    n, N_t = 12, 2 * harmonics.highest + 1 + extra
    law = ElasticCoulomb(
        *rng.uniform(0.2, 1.0, (1, n)),
        rng.standard_normal(n) + rng.integers(0, 4, n),
        *rng.uniform(0.2, 1.0, (2, n)),
        rng.random(n) < 0.5,
    )
    U = coefficients(harmonics, seed, n, 3) * 10.0 ** rng.uniform(-1.0, 0.5, (n, 1, 1))
    cycle = law.cycle(U, N_t, harmonics=harmonics)
    expected = law.cycle(harmonics.carry(U, full), N_t)
    assert np.array_equal(cycle.state, expected.state) and np.array_equal(cycle.active, expected.active)
    assert np.allclose(cycle.p, full.carry(expected.p, harmonics), rtol=0.0, atol=1e-12 * (1.0 + np.abs(expected.p).max()))
    where = np.concatenate([np.r_[full.columns(k)] for k in harmonics.chosen])
    rows = (np.arange(3)[:, None] * full.n_coefficients + where).ravel()
    assert np.allclose(cycle.P, expected.P[:, rows[:, None], rows], rtol=0.0, atol=1e-12)
    energy = pair_energy(harmonics.carry(U, full), expected.p)
    assert np.allclose(pair_energy(U, cycle.p, harmonics), energy, atol=1e-11 * (1.0 + np.abs(energy).max()))


@given(sets, seeds)
def test_diagonal_part_of_a_derivative_is_exact_for_complex_linear_maps(harmonics, seed):
    """A matrix P built from complex 3 x 3 blocks, one per harmonic, returns these blocks."""
    rng, N_H = np.random.default_rng(seed), harmonics.n_coefficients
    blocks = rng.standard_normal((len(harmonics), 3, 3)) + 1j * rng.standard_normal((len(harmonics), 3, 3))
    blocks[harmonics.numbers == 0] = blocks[harmonics.numbers == 0].real
    units = np.eye(3 * N_H).reshape(3 * N_H, 3, N_H)
    images = [to_real(np.einsum("hab,bh->ah", blocks, to_complex(unit)), N_H).ravel() for unit in units]
    assert np.allclose(complex_linear(np.array(images).T[None], N_H)[0], blocks)


@pytest.mark.parametrize("harmonics", [Harmonics.up_to(3), Harmonics.odd_up_to(5)])
@pytest.mark.parametrize("n_modes", [0, 4])
@pytest.mark.parametrize("full", [False, True])
def test_modal_products_of_several_forces_equal_single_products(harmonics, n_modes, full):
    rng, h = np.random.default_rng(7), len(harmonics)
    c = rng.standard_normal((h, n_modes, n_modes)) + 1j * rng.standard_normal((h, n_modes, n_modes))
    c[harmonics.numbers == 0] = c[harmonics.numbers == 0].real
    c = c if full else c.diagonal(axis1=1, axis2=2).T
    q = rng.standard_normal((n_modes, 3, harmonics.n_coefficients))
    products = Flexibility(c).apply(q)
    for i in range(3):
        amplitudes = np.einsum("hij,jh->ih", c, to_complex(q[:, i])) if full else c * to_complex(q[:, i])
        assert np.allclose(to_complex(products[:, i]), amplitudes)
        assert np.allclose(Flexibility(c).apply(q[:, i]), products[:, i])
