"""The law over a step: the contact law of oracles/law.py, and the exact derivative."""

import numpy as np
import pytest
from oracles.law import friction_step, normal_contact_force, normal_force

from microslip.contact.law import OPEN, SLIP, STICK, ContactParameters
from microslip.contact.return_map import return_map

N = 400


def example(seed=0):
    rng = np.random.default_rng(seed)
    of = ContactParameters(
        rng.uniform(0.0, 0.8, N),
        rng.uniform(-1.0, 3.0, N),
        rng.uniform(0.5, 2.0, N),
        rng.uniform(0.5, 2.0, N),
        rng.random(N) < 0.4,
    )
    return of, rng.normal(size=(N, 3)), np.concatenate([rng.normal(size=(N, 2)), np.zeros((N, 1))], axis=1)


def test_it_is_the_contact_law():
    of, du, before = example()
    p, _, state = return_map(du, before, of)
    normal = normal_force(du[:, 2], of.N0, of.k_n)
    T, w, slips = friction_step(-before[:, :2] / of.k_t[:, None], du[:, :2], normal, of.k_t, of.mu, of.separate)
    assert p[:, :2] == pytest.approx(-of.k_t[:, None] * w, abs=1e-13)
    assert p[:, 2] == pytest.approx(normal_contact_force(normal, of.N0) - of.k_n * du[:, 2], abs=1e-13)
    assert np.array_equal(state == OPEN, normal == 0.0)
    assert np.array_equal(state == SLIP, slips & (normal > 0.0))
    assert {STICK, SLIP, OPEN} == set(state.tolist())


def test_a_pair_that_sticks_keeps_its_slider_to_the_bit():
    of, du, before = example(1)
    p, L, state = return_map(du, before, of)
    sticks = state == STICK
    assert np.array_equal(p[sticks, :2], before[sticks, :2]) and not L[sticks].any()
    assert np.array_equal(p[sticks & (of.N0 >= 0.0), 2], np.zeros(np.count_nonzero(sticks & (of.N0 >= 0.0))))


def test_the_derivative_is_exact_where_the_state_stays():
    of, du, before = example(2)
    _, L, _ = return_map(du, before, of)
    h = 1e-6
    for j in range(3):
        step = np.zeros(3)
        step[j] = h
        (above, L1, s1), (below, L2, s2) = (return_map(du + sign * step, before, of) for sign in (1.0, -1.0))
        same = (s1 == s2) & (L1.any(axis=2) == L2.any(axis=2)).all(axis=1)
        assert same.mean() > 0.99
        assert L[same, :, j] == pytest.approx((above - below)[same] / (2.0 * h), abs=1e-8)


def test_a_batch_is_its_parts():
    of, du, before = example(3)
    p, L, state = return_map(np.stack([du, 2.0 * du]), np.stack([before, before]), of)
    for b, factor in enumerate((1.0, 2.0)):
        alone = return_map(factor * du, before, of)
        assert all(np.array_equal(whole[b], part) for whole, part in zip((p, L, state), alone))
