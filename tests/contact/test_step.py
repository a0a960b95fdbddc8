"""A step of the law: the contact law of oracles/law.py, and the exact derivative."""

from dataclasses import replace

import numpy as np
import pytest
from oracles.law import friction_step, normal_contact_force, normal_force

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.law import OPEN, SLIP, STICK
from microslip.fourier.coefficients import analyse, synthesise
from microslip.fourier.harmonics import Harmonics

N = 400


def example(seed=0):
    rng = np.random.default_rng(seed)
    of = ElasticCoulomb(
        rng.uniform(0.0, 0.8, N),
        rng.uniform(-1.0, 3.0, N),
        rng.uniform(0.5, 2.0, N),
        rng.uniform(0.5, 2.0, N),
        rng.random(N) < 0.4,
        rng.normal(size=(N, 2)),
    )
    return of, rng.normal(size=(N, 3)), np.concatenate([rng.normal(size=(N, 2)), np.zeros((N, 1))], axis=1)


def test_a_step_is_the_contact_law():
    of, du, before = example()
    p, _, state = of.step(du, before)
    normal = normal_force(du[:, 2], of.N0, of.k_n)
    T, w, slips = friction_step(of.w0 - before[:, :2] / of.k_t[:, None], du[:, :2], normal, of.k_t, of.mu, of.separate)
    assert p[:, :2] == pytest.approx(-of.k_t[:, None] * (w - of.w0), abs=1e-13)
    assert p[:, 2] == pytest.approx(normal_contact_force(normal, of.N0) - of.k_n * du[:, 2], abs=1e-13)
    assert np.array_equal(state == OPEN, normal == 0.0)
    assert np.array_equal(state == SLIP, slips & (normal > 0.0))
    assert {STICK, SLIP, OPEN} == set(state.tolist())


def test_the_slider_of_a_sticking_pair_does_not_change_by_a_bit():
    of, du, before = example(1)
    p, L, state = of.step(du, before)
    sticks = state == STICK
    assert np.array_equal(p[sticks, :2], before[sticks, :2]) and not L[sticks].any()
    assert np.array_equal(p[sticks & (of.N0 >= 0.0), 2], np.zeros(np.count_nonzero(sticks & (of.N0 >= 0.0))))


def test_the_derivative_is_exact_where_the_state_does_not_change():
    of, du, before = example(2)
    _, L, _ = of.step(du, before)
    h = 1e-6
    for j in range(3):
        step = np.zeros(3)
        step[j] = h
        (above, L1, s1), (below, L2, s2) = (of.step(du + sign * step, before) for sign in (1.0, -1.0))
        same = (s1 == s2) & (L1.any(axis=2) == L2.any(axis=2)).all(axis=1)
        assert same.mean() > 0.99
        assert L[same, :, j] == pytest.approx((above - below)[same] / (2.0 * h), abs=1e-8)


def test_a_batch_equals_its_parts():
    of, du, before = example(3)
    p, L, state = of.step(np.stack([du, 2.0 * du]), np.stack([before, before]))
    for b, factor in enumerate((1.0, 2.0)):
        single = of.step(factor * du, before)
        assert all(np.array_equal(whole[b], part) for whole, part in zip((p, L, state), single))


def test_p_of_a_pair_open_at_rest_is_its_whole_force_in_a_step():
    of, _, _ = example(6)
    gaps = of.N0 <= 0.0
    without_springs, rng, springs = (
        replace(of, w0=np.zeros((N, 2)), open_at_rest=gaps),
        np.random.default_rng(7),
        of.springs * gaps[:, None],
    )
    with_springs = replace(without_springs, open_at_rest=np.zeros(N, dtype=bool))
    p, after = np.zeros((N, 3)), np.zeros((N, 3 + without_springs.n_memory))
    touched = np.zeros(N, dtype=bool)
    for _ in range(20):
        du = rng.normal(size=(N, 3))
        (p, L, state), (after, L_bare, state_bare) = with_springs.step(du, p), without_springs.step(du, after)
        assert after[:, :3] == pytest.approx(p + springs * du, abs=1e-12) and np.array_equal(state, state_bare)
        assert L_bare == pytest.approx(L + springs[:, :, None] * np.eye(3), abs=1e-12)
        is_open = gaps & (state == OPEN)
        assert not after[is_open, :3].any() and not L_bare[is_open].any()
        touched |= gaps & ~is_open
    assert touched.sum() > 10 and of.n_memory == 0


@pytest.mark.slow
@pytest.mark.parametrize("gaps_have_springs", [True, False])
def test_steps_repeated_to_a_steady_state_are_the_cycle_of_the_return_map(gaps_have_springs):
    of, _, _ = example(4)
    of = replace(of, sampled=True)
    if not gaps_have_springs:
        of = replace(of, open_at_rest=of.N0 <= 0.0, w0=np.where(of.N0[:, None] <= 0.0, 0.0, of.w0))
    U, N_t = np.random.default_rng(5).normal(size=(N, 3, 7)), 40
    du, p, history = np.moveaxis(synthesise(U, N_t), -1, 0), np.zeros((N, 3 + of.n_memory)), []
    for sample in range(1, 60 * N_t):
        p, _, state = of.step(du[sample % N_t], p)
        history.append((p[:, :3], state))
    forces, states = zip(*history[-N_t:])
    cycle = of.cycle(U, N_t)
    repeats = np.abs(history[-1][0] - history[-1 - N_t][0]).max(axis=1) < 1e-14
    expected = analyse(np.stack(forces, axis=-1), Harmonics.up_to(3))
    assert repeats.mean() > 0.97 and cycle.p[repeats] == pytest.approx(expected[repeats], abs=1e-11)
    assert np.array_equal(cycle.state[repeats], np.max(states, axis=0)[repeats]) and {STICK, SLIP, OPEN} == set(
        cycle.state.tolist()
    )
