"""The formulas of the contact law for a single step."""

from dataclasses import replace

import numpy as np
import pytest
from oracles.law import beyond_stuck_springs, friction_step, normal_contact_force, normal_force

from microslip.contact.elastic_coulomb import ElasticCoulomb

RNG = np.random.default_rng(11)
N_PAIRS = 500
K_T, MU, N = RNG.uniform(0.1, 5.0, (3, N_PAIRS))
W, DU_T = RNG.standard_normal((2, N_PAIRS, 2))


@pytest.mark.parametrize("separate", [False, True])
def test_friction_force_is_the_spring_force_within_its_limit(separate):
    T, w, slips = friction_step(W, DU_T, N, K_T, MU, np.full(N_PAIRS, separate))
    assert np.allclose(T, K_T[:, None] * (DU_T - w), atol=1e-13)
    size = np.abs(T).max(axis=1) if separate else np.linalg.norm(T, axis=1)
    assert np.all(size <= MU * N * (1.0 + 1e-14)) and 0 < slips.sum() < N_PAIRS
    assert np.allclose(size[slips], (MU * N)[slips], rtol=1e-14)
    assert np.array_equal(w[~slips], W[~slips])


@pytest.mark.parametrize("separate", [False, True])
def test_slider_moves_against_the_friction_force(separate):
    T, w, _ = friction_step(W, DU_T, N, K_T, MU, np.full(N_PAIRS, separate))
    assert np.all(np.sum(T * (w - W), axis=1) >= 0.0)


def test_friction_circle_rotates_with_the_axes_and_separate_limits_do_not():
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for separate, turns in ((False, True), (True, False)):
        kind = np.full(N_PAIRS, separate)
        T, _, _ = friction_step(W, DU_T, N, K_T, MU, kind)
        turned, _, _ = friction_step(W @ turn.T, DU_T @ turn.T, N, K_T, MU, kind)
        assert np.allclose(turned, T @ turn.T, atol=1e-13) == turns


def test_circle_and_separate_limits_agree_along_one_axis():
    along = DU_T * [1.0, 0.0]
    circle, separate_limits = (friction_step(0.0 * W, along, N, K_T, MU, np.full(N_PAIRS, kind)) for kind in (False, True))
    assert np.allclose(circle[0], separate_limits[0], atol=1e-14) and np.array_equal(circle[2], separate_limits[2])


def test_open_pair_has_no_friction_and_its_slider_follows_the_motion():
    T, w, _ = friction_step(W, DU_T, 0.0 * N, K_T, MU, RNG.random(N_PAIRS) < 0.5)
    assert np.all(T == 0.0) and np.array_equal(w, DU_T)


def test_normal_force_of_closed_and_open_pairs_and_gaps():
    du_z, N0, k_n = np.array([-1.0, 0.5, 2.0, -0.2, -1.0]), np.array([2.0, 2.0, 2.0, -1.0, -1.0]), np.full(5, 3.0)
    N = normal_force(du_z, N0, k_n)
    assert np.allclose(N, [5.0, 0.5, 0.0, 0.0, 2.0])
    assert np.allclose(normal_contact_force(N, N0), [-3.0, 1.5, 2.0, 0.0, -2.0])


def test_a_stuck_and_closed_pair_is_linear():
    du, k_n = RNG.standard_normal((N_PAIRS, 3)), RNG.uniform(1.0, 2.0, N_PAIRS)
    N0, strong = np.full(N_PAIRS, 100.0), np.full(N_PAIRS, 100.0)
    N = normal_force(du[:, 2], N0, k_n)
    T, _, slips = friction_step(0.0 * W, du[:, :2], N, K_T, strong, np.zeros(N_PAIRS, dtype=bool))
    f_nl = np.column_stack([T, normal_contact_force(N, N0)])
    assert not slips.any() and np.abs(beyond_stuck_springs(f_nl, du, K_T, k_n)).max() < 1e-12


def test_parameters_are_checked_and_subsets_are_selected():
    ones = np.ones(4)
    law = ElasticCoulomb(np.arange(4), ones, ones, 2 * ones, [True, False, True, False])
    assert law.n_pairs == 4 and law.mu.dtype == float and law.separate.dtype == bool
    assert law.take([3, 1]).mu.tolist() == [3.0, 1.0]
    assert law.take(slice(1, 3)).separate.tolist() == [False, True]
    assert law.take(law.separate).mu.tolist() == [0.0, 2.0]
    assert np.array_equal(law.w0, np.zeros((4, 2))) and law.stiffness[0].tolist() == [1.0, 1.0, 2.0]
    preloaded = replace(law, N0=3.0 * ones, w0=np.arange(8.0).reshape(4, 2))
    assert preloaded.take([3]).w0.tolist() == [[6.0, 7.0]] and preloaded.take([3]).N0.tolist() == [3.0]
    with pytest.raises(ValueError, match="k_n of pair 2 is negative"):
        ElasticCoulomb(ones, ones, ones, ones - [0.0, 0.0, 3.0, 0.0], ones > 2)
    with pytest.raises(ValueError, match=r"N0 has shape \(3,\), needs \(4,\)"):
        ElasticCoulomb(ones, ones[:3], ones, ones, ones > 2)
