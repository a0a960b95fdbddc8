"""The compiled kernel compared with plain oracles and central differences, and its behaviour at the limits of its input."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy_oracle import pair_harmonics
from oracles import path
from oracles.law import friction_step, normal_contact_force, normal_force

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.energy import pair_energy
from microslip.contact.iwan import Iwan
from microslip.contact.law import OPEN, SLIP, STICK
from microslip.contact.rough import Rough
from microslip.fourier.coefficients import analyse, synthesise
from microslip.fourier.harmonics import Harmonics

FAST = settings(max_examples=30, deadline=None, derandomize=True)


@st.composite
def joints(draw, largest_H=6, regular=False):
    """Return pairs of every kind, their motion and the number of samples; ``regular`` leaves out zero parameters."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n, H = draw(st.integers(1, 20)), draw(st.integers(0, largest_H))
    N_t = draw(st.integers(2 * H + 1, 2 * H + 70))
    U = rng.standard_normal((n, 3, 2 * H + 1)) * 10.0 ** rng.uniform(-1.0, 1.0, (n, 1, 1))
    zero = np.zeros((3, n), dtype=bool) if regular else rng.random((3, n)) < 0.15
    mu, k_t, k_n = np.where(zero, 0.0, rng.uniform(0.1, 2.0, (3, n)))
    N0 = rng.standard_normal(n) + rng.integers(0, 5, n)
    w0 = rng.standard_normal((n, 2)) * (rng.random((n, 1)) < 0.5)
    return U, ElasticCoulomb(mu, N0, k_t, k_n, rng.random(n) < 0.5, w0), N_t


def marched(U, law, i, N_t):
    """Return the result of the oracle for pair i."""
    values = (getattr(law, name)[i] for name in ("mu", "N0", "k_t", "k_n", "separate"))
    return pair_harmonics(U, *values, N_t, law.w0[i])


def stiffness(law):
    return (1.0 + law.mu) * np.maximum(law.k_t, law.k_n)


def size_of(U, law):
    """Return the size of each pair's motion, from the initial slider position, (n,)."""
    return np.abs(U).max(axis=(1, 2)) + np.abs(law.w0).max(axis=1)


def path_harmonics(U, law, N_t):
    """Return the harmonics of p by the oracle of the path between samples, and which pairs reached a steady cycle in it."""
    du = np.moveaxis(synthesise(U, N_t), -1, 0)
    N = law.N0 - law.k_n * du[..., 2]
    cycle = path.steady(du, N, law.k_t, law.mu, law.separate, law.w0)
    f = np.empty_like(du)
    f[..., :2] = cycle.T + law.k_t[:, None] * law.w0 + path.shared(cycle.area)
    f[..., 2] = normal_contact_force(np.maximum(N, 0.0), law.N0) + path.shared(path.normal_area(N))
    p = analyse(np.moveaxis(f, 0, -1), Harmonics.full(U.shape[2])) - law.stiffness[:, :, None] * U
    return p, cycle.change <= 1e-11 * stiffness(law) * size_of(U, law)


@pytest.mark.slow
@FAST
@given(joints(largest_H=6))
def test_kernel_agrees_with_the_oracle_of_the_path_between_samples(joint):
    U, law, N_t = joint
    cycle = law.cycle(U, N_t, tangents=False)
    expected, is_settled = path_harmonics(U, law, N_t)
    force = np.abs(law.N0) + stiffness(law) * size_of(U, law)
    assert np.all((np.abs(cycle.p - expected).max(axis=(1, 2)) <= 1e-9 * force)[is_settled & ~cycle.drifts])


@pytest.mark.slow
@FAST
@given(joints(largest_H=9))
def test_return_map_at_samples_agrees_with_the_oracle(joint):
    U, law, N_t = joint
    law = replace(law, sampled=True)
    cycle = law.cycle(U, N_t)
    P = np.zeros((len(U), 3 * U.shape[2], 3 * U.shape[2]))
    P[cycle.active] = cycle.P
    for i in range(len(U)):
        expected = marched(U[i], law, i, N_t)
        force = (np.abs(law.N0) + stiffness(law) * size_of(U, law))[i]
        if not expected.is_settled or expected.margin < 1e-10:
            continue
        assert np.abs(cycle.p[i] - expected.p).max() <= 1e-11 * force
        if i in cycle.active:
            assert np.abs(P[i] - expected.P).max() <= 1e-10 * stiffness(law)[i]
        else:
            assert np.all(cycle.p[i] == 0.0) and np.abs(expected.P).max() <= 1e-12 * stiffness(law)[i]
        assert cycle.state[i] == expected.state


@pytest.mark.parametrize("separate", [False, True])
@pytest.mark.parametrize("sampled", [False, True])
def test_jacobian_agrees_with_central_differences(sampled, separate):
    """For all but the few pairs that change state within the difference; includes sliders that drift or drifted."""
    rng, n, N_H = np.random.default_rng(3), 400, 7
    U = rng.standard_normal((n, 3, N_H)) / [1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0]
    mu, k_t, k_n = rng.uniform(0.3, 1.0, (3, n))
    law = ElasticCoulomb(
        mu, rng.uniform(-0.3, 2.0, n), k_t, k_n, np.full(n, separate), 0.2 * rng.standard_normal((n, 2)), sampled
    )
    cycle, V, h = law.cycle(U, 64), rng.standard_normal(U.shape), 1e-6
    ahead, behind = (law.cycle(U + s * h * V, 64, tangents=False).p for s in (1.0, -1.0))
    slope = np.einsum("nij,nj->ni", cycle.P, V[cycle.active].reshape(len(cycle.active), -1)).reshape(-1, 3, N_H)
    errors = np.abs((ahead - behind)[cycle.active] / (2.0 * h) - slope).max(axis=(1, 2))
    assert len(cycle.active) > 0.85 * n and np.mean(errors < 1e-7) > 0.985 and not cycle.drifts.any()


@pytest.mark.slow
@FAST
@given(joints(largest_H=4, regular=True))
def test_jacobian_agrees_with_central_differences_where_no_sample_switches(joint):
    U, law, N_t = joint
    law = replace(law, sampled=True)
    n, _, N_H = U.shape
    cycle = law.cycle(U, N_t)
    assume(len(cycle.active) > 0)
    rng = np.random.default_rng(0)
    direction = rng.standard_normal(U.shape)
    step = 1e-6 * np.abs(U).max(axis=(1, 2))[:, None, None] * direction
    ahead, behind = (law.cycle(U + s * step, N_t, tangents=False).p for s in (1.0, -1.0))
    difference = (ahead - behind).reshape(n, -1)
    checked = 0
    for k, i in enumerate(cycle.active):
        nearby = (U[i] + s * step[i] for s in (-1.0, 0.0, 1.0))
        patterns = {marched(near, law, i, N_t).pattern for near in nearby}
        if len(patterns) == 1:
            linear = 2.0 * cycle.P[k] @ step[i].ravel()
            bound = 1e-6 * stiffness(law)[i] * np.abs(step[i]).max() * np.sqrt(3 * N_H)
            assert np.abs(difference[i] - linear).max() <= bound
            checked += 1
    assume(checked > 0)


def taylor_remainders(law, U, V, N_t, steps):
    """Return |p(U + h V) - p(U) - h P V| by direction for each step h, (n_steps, n, 3), NaN where a sample switches."""
    n, _, N_H = U.shape
    cycle = law.cycle(U, N_t)
    P = np.zeros((n, 3 * N_H, 3 * N_H))
    P[cycle.active] = cycle.P
    slope = np.einsum("nij,nj->ni", P, V.reshape(n, -1)).reshape(U.shape)
    remainders = np.array([np.abs(law.cycle(U + h * V, N_t).p - cycle.p - h * slope).max(axis=2) for h in steps])
    for i in range(n):
        if len({marched((U + h * V)[i], law, i, N_t).pattern for h in (0.0, *steps)}) > 1:
            remainders[:, i] = np.nan
    return remainders


@pytest.mark.slow
@pytest.mark.parametrize("moved", range(3))
@pytest.mark.parametrize("separate", [False, True])
def test_taylor_remainder_of_each_block_falls_as_the_square_of_the_step(moved, separate):
    """The blocks of dp/dU: rows of each direction, columns of one; sliders start away from the origin."""
    rng, n = np.random.default_rng(21), 60
    U, V = rng.standard_normal((2, n, 3, 5))
    V[:, np.arange(3) != moved] = 0.0
    mu, k_t, k_n = rng.uniform(0.3, 1.0, (3, n))
    law = ElasticCoulomb(mu, rng.uniform(0.5, 2.0, n), k_t, k_n, np.full(n, separate), rng.standard_normal((n, 2)), True)
    coarse, fine = taylor_remainders(law, U, V, 16, (2e-4, 1e-4))
    assert np.count_nonzero(~np.isnan(coarse[:, 0])) > n // 2
    curved = coarse > 1e-10  # the others are linear as long as no sample switches
    assert curved[:, :2].any() != separate and not curved[:, 2].any()
    assert np.all(np.abs(coarse[curved] / fine[curved] - 4.0) < 0.2)
    straight = ~curved & ~np.isnan(coarse)
    assert np.all(fine[straight] < 1e-10)


ONE = np.ones(40)
ALONG_THE_PATH = {
    "elastic-coulomb": ElasticCoulomb(0.6 * ONE, ONE, 3.0 * ONE, 5.0 * ONE, np.zeros(40, dtype=bool)),
    "rough": Rough(0.4 * ONE, 2.0 * ONE, 3.0 * ONE, 5.0 * ONE, np.inf * ONE, n_sliders=6),
    "rough by a power": Rough(0.4 * ONE, 2.0 * ONE, 3.0 * ONE, 5.0 * ONE, 2.0 * ONE, n_sliders=6),
    "iwan": Iwan(2.0 * ONE, 5.0 * ONE, 7.0 * ONE, -0.6 * ONE, 0.4 * ONE, n_sliders=6),
}


@pytest.mark.parametrize("name", ALONG_THE_PATH)
def test_taylor_remainder_of_every_law_falls_as_the_square_of_the_step(name):
    """For the path between samples, except the few pairs that change state at a sample within the steps."""
    law, (U, V) = ALONG_THE_PATH[name], 0.3 * np.random.default_rng(1).standard_normal((2, 40, 3, 5))
    cycle, steps = law.cycle(U, 64), 1e-3 * 0.25 ** np.arange(4)
    U, V, p = (values[cycle.active] for values in (U, V, cycle.p))
    law, slope = law.take(cycle.active), np.einsum("nij,nj->ni", cycle.P, V.reshape(len(V), -1)).reshape(V.shape)
    left = [np.abs(law.cycle(U + h * V, 64, tangents=False).p - p - h * slope).max(axis=(1, 2)) for h in steps]
    rates = np.log2(np.array(left[:-1]) / left[1:]).min(axis=0) / 2.0
    assert len(rates) > 30 and np.mean(np.abs(rates - 2.0) < 0.1) > 0.8


@pytest.mark.slow
@FAST
@given(joints())
def test_kernel_agrees_with_the_formulas_of_the_law(joint):
    U, law, N_t = joint
    law = replace(law, sampled=True)
    du = synthesise(U, N_t)  # (n, 3, N_t)
    N = normal_force(du[:, 2], law.N0[:, None], law.k_n[:, None])
    w, before, T = law.w0, law.w0, np.empty((len(U), 2, N_t))
    for sample in range(1, 30 * N_t):
        j = sample % N_t
        if j == 0:
            before = w
        T[:, :, j], w, _ = friction_step(w, du[:, :2, j], N[:, j], law.k_t, law.mu, law.separate)
    if N_t == 1:
        T[:, :, 0], w, _ = friction_step(w, du[:, :2, 0], N[:, 0], law.k_t, law.mu, law.separate)
    is_settled = np.abs(w - before).max(axis=1) <= 1e-13 * size_of(U, law) if N_t > 1 else np.ones(len(U), dtype=bool)
    T += (law.k_t[:, None] * law.w0)[:, :, None]  # relative to rest
    f_nl = np.concatenate([T, normal_contact_force(N, law.N0[:, None])[:, None]], axis=1)
    expected = analyse(f_nl - law.stiffness[:, :, None] * du, Harmonics.full(U.shape[2]))
    force = np.abs(law.N0) + stiffness(law) * size_of(U, law)
    cycle = law.cycle(U, N_t, tangents=False)
    assert np.all((np.abs(cycle.p - expected).max(axis=(1, 2)) <= 1e-11 * force)[is_settled])


@FAST
@given(joints())
def test_friction_dissipates_energy(joint):
    U, law, N_t = joint
    p = law.cycle(U, max(N_t, 4 * U.shape[2]), tangents=False).p
    size = size_of(U, law)
    assert np.all(pair_energy(U, p) >= -1e-12 * (stiffness(law) * size + np.abs(law.N0)) * size)


@FAST
@given(joints(largest_H=3), st.randoms(use_true_random=False))
def test_pairs_are_independent_of_each_other(joint, random):
    U, law, N_t = joint
    order = list(range(len(U)))
    random.shuffle(order)
    unpermuted, mixed = law.cycle(U, N_t), law.take(order).cycle(U[order], N_t)
    assert np.array_equal(mixed.p, unpermuted.p[order]) and np.array_equal(mixed.state, unpermuted.state[order])
    assert sorted(np.array(order)[mixed.active]) == unpermuted.active.tolist()
    for k, i in enumerate(np.array(order)[mixed.active]):
        assert np.array_equal(mixed.P[k], unpermuted.P[np.searchsorted(unpermuted.active, i)])


@pytest.mark.parametrize("H", range(16))
def test_every_number_of_harmonics_with_its_smallest_number_of_samples(H):
    rng = np.random.default_rng(H)
    U = rng.standard_normal((9, 3, 2 * H + 1))
    law = ElasticCoulomb(*rng.uniform(0.2, 1.0, (4, 9)), rng.random(9) < 0.5, sampled=True)
    cycle = law.cycle(U, 2 * H + 1)
    for k, i in enumerate(cycle.active):
        expected = marched(U[i], law, i, 2 * H + 1)
        if not expected.is_settled:
            continue
        assert np.allclose(cycle.p[i], expected.p, rtol=0.0, atol=1e-12 * (1.0 + np.abs(U[i]).max()))
        assert np.allclose(cycle.P[k], expected.P, rtol=0.0, atol=1e-12)


def test_too_few_samples_are_refused():
    ones = np.ones(1)
    with pytest.raises(ValueError, match="at least 7"):
        ElasticCoulomb(ones, ones, ones, ones, ones > 2).cycle(np.zeros((1, 3, 7)), 6)


def one_pair(mu=0.5, N0=2.0, k_t=3.0, k_n=4.0, separate=False):
    return ElasticCoulomb(*(np.array([value]) for value in (mu, N0, k_t, k_n, separate)))


def test_no_pairs():
    none = np.zeros(0)
    cycle = ElasticCoulomb(none, none, none, none, none > 0).cycle(np.zeros((0, 3, 7)), 128)
    assert cycle.p.shape == (0, 3, 7) and cycle.P.shape == (0, 21, 21)
    assert cycle.state.shape == cycle.active.shape == (0,) and cycle.state.dtype == np.uint8


@pytest.mark.parametrize(
    ("which", "value"), [("U", np.nan), ("U", np.inf), *((name, np.nan) for name in ("N0", "mu", "k_t", "k_n", "w0"))]
)
def test_nan_affects_only_its_pair_and_is_returned(which, value):
    U = np.random.default_rng(3).standard_normal((3, 3, 7))
    arrays = dict(zip(("mu", "N0", "k_t", "k_n"), np.ones((4, 3)) * [[0.5], [2.0], [3.0], [4.0]], strict=True)) | {
        "w0": np.zeros((3, 2))
    }
    clean = ElasticCoulomb(**arrays, separate=np.zeros(3, dtype=bool)).cycle(U, 32)
    if which == "U":
        U[1, 0, 2] = value
    else:
        arrays[which][1] = value
    cycle = ElasticCoulomb(**arrays, separate=np.zeros(3, dtype=bool)).cycle(U, 32)
    assert 1 in cycle.active
    assert np.isnan(cycle.p[1]).all() and np.isnan(cycle.P[np.searchsorted(cycle.active, 1)]).all()
    assert np.array_equal(cycle.p[[0, 2]], clean.p[[0, 2]])


def test_without_tangents_the_forces_are_the_same():
    U = np.random.default_rng(4).standard_normal((13, 3, 5))
    law = one_pair().take(np.zeros(13, dtype=int))
    with_P, without = law.cycle(U, 64), law.cycle(U, 64, tangents=False)
    assert without.P is None and np.array_equal(with_P.p, without.p) and np.array_equal(with_P.active, without.active)


def test_without_friction_a_pair_slides_freely():
    U = np.zeros((1, 3, 5))
    for motion in (0.0, 1e-9, 1.0):
        U[0, :2] = motion * np.random.default_rng(1).standard_normal((2, 5))
        cycle = one_pair(mu=0.0).cycle(U, 64)
        assert cycle.state[0] == SLIP
        assert np.allclose(cycle.p, -3.0 * U, rtol=0.0, atol=1e-14 * motion)
        assert np.allclose(cycle.P[0], np.diag([-3.0] * 10 + [0.0] * 5), rtol=0.0, atol=1e-14)


def test_without_stiffness_a_pair_carries_no_force():
    U = np.random.default_rng(2).standard_normal((1, 3, 5)) * 100.0
    cycle = one_pair(k_t=0.0, k_n=0.0).cycle(U, 64)
    assert cycle.state[0] == STICK and len(cycle.active) == 0 and np.all(cycle.p == 0.0)


def test_huge_friction_sticks_until_the_pair_opens():
    U = np.random.default_rng(2).standard_normal((1, 3, 5))
    U[0, 2] = [-3.0, 0.1, 0.0, 0.0, 0.1]
    for mu in (1e6, 1e300):
        assert len(one_pair(mu=mu).cycle(U, 64).active) == 0
    U[0, 2, 0] = 3.0
    assert one_pair(mu=1e300).cycle(U, 64).state[0] == OPEN


def test_pairs_at_their_limit_stick_without_roundoff():
    """Peaks that reach the limit from inside to the last digit: p is exactly zero."""
    rng = np.random.default_rng(8)
    angle = rng.uniform(0.0, 2.0 * np.pi, 200)
    U = np.zeros((200, 3, 3))
    U[:, 0, 1], U[:, 1, 1] = np.cos(angle) / 3.0, np.sin(angle) / 3.0
    limit = 3.0 * np.hypot(U[:, 0, 1], U[:, 1, 1]) * (1.0 + 1e-15)
    law = replace(one_pair().take(np.zeros(200, dtype=int)), N0=2.0 * limit)
    cycle = law.cycle(U, 128)
    assert np.all(cycle.p == 0.0) and len(cycle.active) == 0


def test_slip_in_the_first_period_leaves_a_constant_force_and_the_state_stick():
    """The first samples move the slider; the cycle then lies within its limits."""
    U = np.zeros((1, 3, 3))
    U[0, 0] = [0.6, 0.0, 0.5]  # k_t (mean +- amplitude) = 3.3, 0.3; mu N0 = 2
    cycle = one_pair(mu=1.0).cycle(U, 64)
    assert cycle.state[0] == STICK and cycle.active.tolist() == [0]
    assert np.allclose(cycle.p[0, 0], [-1.3, 0.0, 0.0], atol=1e-14)
    assert np.allclose(cycle.P[0, 0, :3], [-3.0, 0.0, -3.0], atol=1e-13)  # the peak, sample 16, determines the slider
    assert abs(pair_energy(U, cycle.p)[0]) < 1e-14


def test_settled_pairs_are_not_marked_as_slipping_by_roundoff():
    """Each period touches the limit to the last digit where the first period left the slider."""
    phase = np.random.default_rng(5).uniform(0.1, 6.2, 300)
    U = np.zeros((300, 3, 3))
    U[:, 0, 0], U[:, 0, 1], U[:, 0, 2] = 0.6, 0.5 * np.cos(phase), 0.5 * np.sin(phase)
    for separate in (False, True):
        cycle = one_pair(mu=1.0, separate=separate).take(np.zeros(300, dtype=int)).cycle(U, 64)
        assert len(cycle.active) == 300 and np.all(cycle.state == STICK)


# -- the steady cycle, and the path between samples -------------------------------------------------------------------------


def many_pairs(n=300, seed=3, **changed):
    """Return pairs in slip, lift-off and drift, and their motion."""
    rng = np.random.default_rng(seed)
    U = rng.standard_normal((n, 3, 7)) / [1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0]
    mu, k_t, k_n = rng.uniform(0.3, 1.0, (3, n))
    return U, ElasticCoulomb(mu, rng.uniform(-0.3, 2.0, n), k_t, k_n, np.zeros(n, dtype=bool), **changed)


@pytest.mark.parametrize("sampled", [False, True])
def test_the_returned_cycle_repeats(sampled):
    """The same cycle follows from the sliders at its end, for slip and for rest after a drift, after two periods or 50."""
    U, law = many_pairs(sampled=sampled)
    cycle = law.cycle(U, 64)
    start = (
        cycle.p[:, :2].sum(axis=2) * 0.0
    )  # p at the last sample does not follow from its harmonics; the mean is known where a pair is at rest
    rests = cycle.state == STICK
    start[rests] = -cycle.p[rests, :2, 0] / law.k_t[rests, None]
    repeated = replace(law, w0=start).cycle(U, 64)
    shifted = cycle.p.copy()
    shifted[:, :2, 0] += law.k_t[:, None] * start
    error = np.abs(repeated.p - shifted).max(axis=(1, 2))
    assert not cycle.drifts.any() and rests.sum() > 5
    assert np.all(error[rests] < 1e-10) and np.all(error[cycle.state != STICK] < 1e-9)  # slip removes the initial state


@pytest.mark.slow
def test_a_slow_drift_is_not_taken_for_a_cycle():
    """Sliders that still move by a hundredth of their way after ten periods: two periods are far from the steady state."""
    U, law = many_pairs(2000, seed=5)
    du = np.moveaxis(synthesise(U, 64), -1, 0)
    N = law.N0 - law.k_n * du[..., 2]
    T = law.k_t[:, None] * du[0, :, :2]
    ends = []
    for sample in range(1, 11 * 64):
        i, j = (sample - 1) % 64, sample % 64
        T, _, _ = path.line_step(T, law.k_t[:, None] * (du[j] - du[i])[:, :2], N[i], N[j], law.mu, law.separate)
        if j == 0:
            ends.append(T)
    drifts = np.abs(ends[-1] - ends[-2]).max(axis=1) > 1e-3
    expected, is_settled = path_harmonics(U[drifts], law.take(drifts), 64)
    cycle = law.take(drifts).cycle(U[drifts], 64, tangents=False)
    assert drifts.sum() > 10 and np.mean(is_settled) > 0.9
    error = np.abs(cycle.p - expected).max(axis=(1, 2))[is_settled & ~cycle.drifts]
    assert np.all(error < 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(("sampled", "order"), [(False, 2), (True, 1)])
def test_order_of_the_samples_on_curved_paths(sampled, order):
    U, law = many_pairs(400, sampled=sampled)
    assert law.order == order
    reference = replace(law, sampled=False).cycle(U, 8192, tangents=False).p
    errors = np.array([np.sqrt(((law.cycle(U, N_t, tangents=False).p - reference) ** 2).mean()) for N_t in (64, 128, 256, 512)])
    rates = np.log2(errors[:-1] / errors[1:])
    assert np.all(np.abs(rates - order) < 0.35)


@pytest.mark.slow
def test_64_samples_of_the_path_are_as_accurate_as_256_of_the_return_map():
    U, law = many_pairs(400)
    reference = law.cycle(U, 8192, tangents=False).p
    path_64 = np.sqrt(((law.cycle(U, 64, tangents=False).p - reference) ** 2).mean())
    map_256 = np.sqrt(((replace(law, sampled=True).cycle(U, 256, tangents=False).p - reference) ** 2).mean())
    assert path_64 < 1.3 * map_256


@pytest.mark.parametrize("sampled", [False, True])
def test_p_of_a_pair_open_at_rest_is_its_whole_force(sampled):
    """docs/theory.md, eq. (3.8): p includes the force of the stuck springs, and its derivative their stiffness."""
    U, law = many_pairs(200, sampled=sampled)
    law = replace(law, N0=-np.abs(law.N0))
    gaps = replace(law, open_at_rest=np.arange(200) % 2 == 0)
    cycle, plain = gaps.cycle(U, 64), law.cycle(U, 64)
    n = U.shape[-1]
    expected = plain.p + np.where(gaps.open_at_rest[:, None, None], law.stiffness[:, :, None] * U, 0.0)
    assert cycle.p == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())
    assert not gaps.stiffness[gaps.open_at_rest].any() and gaps.stiffness[~gaps.open_at_rest] == pytest.approx(
        law.stiffness[1::2]
    )
    stays = gaps.open_at_rest & ~np.isin(np.arange(200), cycle.active)
    assert 0 < stays.sum() < 100 and not cycle.p[stays].any()
    springs = np.where(gaps.open_at_rest[:, None], law.stiffness, 0.0)[cycle.active]
    for i, P in zip(cycle.active, cycle.P):
        own_springs = np.diag(np.repeat(springs[np.flatnonzero(cycle.active == i)[0]], n))
        assert P == pytest.approx(plain.P[np.flatnonzero(plain.active == i)[0]] + own_springs)


def test_a_pair_open_at_rest_is_open_up_to_its_gap():
    law = replace(one_pair(N0=-2.0, k_n=4.0), open_at_rest=np.ones(1, dtype=bool))
    amplitudes = np.array([[0.1, 0.0, 0.25]])
    assert law.slip_safety(amplitudes) == pytest.approx([2.0]) and law.utilisation(amplitudes) == pytest.approx([0.5])
    with pytest.raises(ValueError, match="is open at rest, and has a preload"):
        replace(law, N0=np.ones(1))


@pytest.mark.parametrize("n_samples", [64, 256])
@pytest.mark.parametrize("excess", [1e-3, 1e-5, 2e-6, 1e-6])
def test_a_slider_pushed_by_two_opposite_samples_drifts_to_the_line_between_them(excess, n_samples):
    """The motion passes the two ends of a line whose distance slightly exceeds the limits; the slider ends on that line."""
    ones, U = np.ones(1), np.zeros((1, 3, 5))
    law = ElasticCoulomb(mu=0.5 * ones, N0=2.0 * ones, k_t=ones, k_n=ones, separate=np.zeros(1, dtype=bool))
    U[0, 0, 1], U[0, 1, 3] = 1.0 + excess, 0.3  # x = (1 + excess) cos t, y = 0.3 cos 2 t, within 1 about y = 0.3 between the ends
    cycle = law.cycle(U, n_samples, tangents=False)
    assert not cycle.drifts[0] and cycle.state[0] == SLIP
    assert cycle.p[0, 1, 0] == pytest.approx(-0.3, rel=5.0 * excess)  # the ends of the path differ by the order of excess
    nearby = law.cycle(U * (1.0 + 1e-12), n_samples, tangents=False)
    assert np.abs(nearby.p - cycle.p).max() < 1e-9


@pytest.mark.parametrize(
    ("phase", "excess", "across"), [(0.05, 2e-4, 0.1), (0.08, 2e-4, 0.2), (0.11, 3e-4, 0.05), (0.14, 3e-4, 0.1)]
)
def test_a_slider_pushed_by_two_neighbouring_samples_reaches_its_cycle(phase, excess, across):
    """The ends of the line lie between two samples: both push, and the slider drifts by 1e-4 of its distance per period."""
    ones, U, angle = np.ones(1), np.zeros((1, 3, 5)), phase * 2.0 * np.pi / 128
    law = ElasticCoulomb(mu=0.5 * ones, N0=2.0 * ones, k_t=ones, k_n=ones, separate=np.zeros(1, dtype=bool))
    U[0, 0, 1:3] = (1.0 + excess) * np.array([np.cos(angle), np.sin(angle)])
    U[0, 1, 2:4] = across, 0.3
    cycle = law.cycle(U, 128)
    assert not cycle.drifts[0] and cycle.state[0] == SLIP
    assert cycle.p[0, 1, 0] == pytest.approx(-0.3, rel=5.0 * excess)
    h = 1e-9  # this is the derivative of the cycle, not of the path to it
    ends = [law.cycle(U + way * h * np.eye(15)[6].reshape(1, 3, 5), 128, tangents=False).p for way in (-1.0, 1.0)]
    assert (ends[1] - ends[0]).ravel() / (2.0 * h) == pytest.approx(cycle.P[0, :, 6], abs=1e-3)
