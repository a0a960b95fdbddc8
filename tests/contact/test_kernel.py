"""The compiled kernel against the plain oracle and central differences; what it must do at the edges of its input."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy_oracle import pair_harmonics
from oracles.law import friction_step, normal_contact_force, normal_force

from microslip.contact.aft import contact_harmonics, pair_energy
from microslip.contact.law import OPEN, SLIP, STICK, ContactParameters
from microslip.fourier.coefficients import analyse, synthesise
from microslip.fourier.harmonics import Harmonics

FAST = settings(max_examples=60, deadline=None, derandomize=True)


@st.composite
def joints(draw, largest_H=6, regular=False):
    """Pairs of every kind, with their motion and the number of samples; ``regular`` leaves out zero parameters."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n, H = draw(st.integers(1, 20)), draw(st.integers(0, largest_H))
    N_t = draw(st.integers(2 * H + 1, 2 * H + 70))
    U = rng.standard_normal((n, 3, 2 * H + 1)) * 10.0 ** rng.uniform(-1.0, 1.0, (n, 1, 1))
    zero = np.zeros((3, n), dtype=bool) if regular else rng.random((3, n)) < 0.15
    mu, k_t, k_n = np.where(zero, 0.0, rng.uniform(0.1, 2.0, (3, n)))
    N0 = rng.standard_normal(n) + rng.integers(0, 5, n)
    return U, ContactParameters(mu, N0, k_t, k_n, rng.random(n) < 0.5), N_t


def values_of(parameters, i):
    return tuple(getattr(parameters, name)[i] for name in ("mu", "N0", "k_t", "k_n", "separate"))


def stiffness(parameters):
    return (1.0 + parameters.mu) * np.maximum(parameters.k_t, parameters.k_n)


@FAST
@given(joints(largest_H=9))
def test_kernel_meets_the_oracle(joint):
    U, parameters, N_t = joint
    found = contact_harmonics(U, parameters, N_t)
    P = np.zeros((len(U), 3 * U.shape[2], 3 * U.shape[2]))
    P[found.active] = found.P
    for i in range(len(U)):
        expected = pair_harmonics(U[i], *values_of(parameters, i), N_t)
        force = np.abs(parameters.N0[i]) + stiffness(parameters)[i] * np.abs(U[i]).max()
        assert np.abs(found.p[i] - expected.p).max() <= 1e-12 * force
        if i in found.active:
            assert np.abs(P[i] - expected.P).max() <= 1e-12 * stiffness(parameters)[i]
        else:
            assert np.all(found.p[i] == 0.0) and np.abs(expected.P).max() <= 1e-12 * stiffness(parameters)[i]
        if expected.margin > 1e-10:
            assert found.state[i] == expected.state


@FAST
@given(joints(largest_H=4, regular=True))
def test_jacobian_meets_central_differences_where_no_sample_switches(joint):
    U, parameters, N_t = joint
    n, _, N_H = U.shape
    found = contact_harmonics(U, parameters, N_t)
    assume(len(found.active) > 0)
    rng = np.random.default_rng(0)
    direction = rng.standard_normal(U.shape)
    step = 1e-6 * np.abs(U).max(axis=(1, 2))[:, None, None] * direction
    ahead, behind = (contact_harmonics(U + s * step, parameters, N_t, tangents=False).p for s in (1.0, -1.0))
    difference = (ahead - behind).reshape(n, -1)
    checked = 0
    for k, i in enumerate(found.active):
        nearby = (U[i] + s * step[i] for s in (-1.0, 0.0, 1.0))
        patterns = {pair_harmonics(near, *values_of(parameters, i), N_t).pattern for near in nearby}
        if len(patterns) == 1:
            linear = 2.0 * found.P[k] @ step[i].ravel()
            bound = 1e-6 * stiffness(parameters)[i] * np.abs(step[i]).max() * np.sqrt(3 * N_H)
            assert np.abs(difference[i] - linear).max() <= bound
            checked += 1
    assume(checked > 0)


@FAST
@given(joints())
def test_kernel_meets_the_formulas_of_the_law(joint):
    U, parameters, N_t = joint
    du = synthesise(U, N_t)  # (n, 3, N_t)
    N = normal_force(du[:, 2], parameters.N0[:, None], parameters.k_n[:, None])
    w, T = np.zeros((len(U), 2)), np.empty((len(U), 2, N_t))
    for sample in range(1, 2 * N_t):
        j = sample % N_t
        T[:, :, j], w, _ = friction_step(w, du[:, :2, j], N[:, j], parameters.k_t, parameters.mu, parameters.separate)
    if N_t == 1:
        T[:, :, 0], w, _ = friction_step(w, du[:, :2, 0], N[:, 0], parameters.k_t, parameters.mu, parameters.separate)
    f_nl = np.concatenate([T, normal_contact_force(N, parameters.N0[:, None])[:, None]], axis=1)
    K_J = np.stack([parameters.k_t, parameters.k_t, parameters.k_n], axis=1)[:, :, None]
    expected = analyse(f_nl - K_J * du, Harmonics.full(U.shape[2]))
    force = np.abs(parameters.N0) + stiffness(parameters) * np.abs(U).max(axis=(1, 2))
    found = contact_harmonics(U, parameters, N_t, tangents=False)
    assert np.all(np.abs(found.p - expected).max(axis=(1, 2)) <= 1e-12 * force)


@FAST
@given(joints())
def test_friction_never_gives_energy(joint):
    U, parameters, N_t = joint
    p = contact_harmonics(U, parameters, max(N_t, 4 * U.shape[2]), tangents=False).p
    size = np.abs(U).max(axis=(1, 2))
    assert np.all(pair_energy(U, p) >= -1e-12 * (stiffness(parameters) * size + np.abs(parameters.N0)) * size)


@FAST
@given(joints(largest_H=3), st.randoms(use_true_random=False))
def test_a_pair_does_not_depend_on_its_neighbours(joint, random):
    U, parameters, N_t = joint
    order = list(range(len(U)))
    random.shuffle(order)
    whole, mixed = contact_harmonics(U, parameters, N_t), contact_harmonics(U[order], parameters.take(order), N_t)
    assert np.array_equal(mixed.p, whole.p[order]) and np.array_equal(mixed.state, whole.state[order])
    assert sorted(np.array(order)[mixed.active]) == whole.active.tolist()
    for k, i in enumerate(np.array(order)[mixed.active]):
        assert np.array_equal(mixed.P[k], whole.P[np.searchsorted(whole.active, i)])


@pytest.mark.parametrize("H", range(16))
def test_every_number_of_harmonics_at_its_least_number_of_samples(H):
    rng = np.random.default_rng(H)
    U = rng.standard_normal((9, 3, 2 * H + 1))
    parameters = ContactParameters(*rng.uniform(0.2, 1.0, (4, 9)), rng.random(9) < 0.5)
    found = contact_harmonics(U, parameters, 2 * H + 1)
    for k, i in enumerate(found.active):
        expected = pair_harmonics(U[i], *values_of(parameters, i), 2 * H + 1)
        assert np.allclose(found.p[i], expected.p, rtol=0.0, atol=1e-12 * (1.0 + np.abs(U[i]).max()))
        assert np.allclose(found.P[k], expected.P, rtol=0.0, atol=1e-12)


def test_too_few_samples_are_refused():
    one = np.ones(1)
    with pytest.raises(ValueError, match="at least 7"):
        contact_harmonics(np.zeros((1, 3, 7)), ContactParameters(one, one, one, one, one > 2), 6)


def one_pair(mu=0.5, N0=2.0, k_t=3.0, k_n=4.0, separate=False):
    return ContactParameters(*(np.array([value]) for value in (mu, N0, k_t, k_n, separate)))


def test_no_pairs():
    none = np.zeros(0)
    found = contact_harmonics(np.zeros((0, 3, 7)), ContactParameters(none, none, none, none, none > 0), 128)
    assert found.p.shape == (0, 3, 7) and found.P.shape == (0, 21, 21)
    assert found.state.shape == found.active.shape == (0,) and found.state.dtype == np.uint8


@pytest.mark.parametrize(
    ("which", "value"), [("U", np.nan), ("U", np.inf), *((name, np.nan) for name in ("N0", "mu", "k_t", "k_n"))]
)
def test_not_a_number_stays_with_its_pair_and_is_not_hidden(which, value):
    U = np.random.default_rng(3).standard_normal((3, 3, 7))
    arrays = dict(zip(("mu", "N0", "k_t", "k_n"), np.ones((4, 3)) * [[0.5], [2.0], [3.0], [4.0]], strict=True))
    clean = contact_harmonics(U, ContactParameters(**arrays, separate=np.zeros(3, dtype=bool)), 32)
    if which == "U":
        U[1, 0, 2] = value
    else:
        arrays[which][1] = value
    found = contact_harmonics(U, ContactParameters(**arrays, separate=np.zeros(3, dtype=bool)), 32)
    assert 1 in found.active
    assert np.isnan(found.p[1]).all() and np.isnan(found.P[np.searchsorted(found.active, 1)]).all()
    assert np.array_equal(found.p[[0, 2]], clean.p[[0, 2]])


def test_without_tangents_the_forces_are_the_same():
    U = np.random.default_rng(4).standard_normal((13, 3, 5))
    parameters = one_pair().take(np.zeros(13, dtype=int))
    with_P, without = contact_harmonics(U, parameters, 64), contact_harmonics(U, parameters, 64, tangents=False)
    assert without.P is None and np.array_equal(with_P.p, without.p) and np.array_equal(with_P.active, without.active)


def test_no_friction_slides_freely():
    U = np.zeros((1, 3, 5))
    for motion in (0.0, 1e-9, 1.0):
        U[0, :2] = motion * np.random.default_rng(1).standard_normal((2, 5))
        found = contact_harmonics(U, one_pair(mu=0.0), 64)
        assert found.state[0] == SLIP
        assert np.allclose(found.p, -3.0 * U, rtol=0.0, atol=1e-14 * motion)
        assert np.allclose(found.P[0], np.diag([-3.0] * 10 + [0.0] * 5), rtol=0.0, atol=1e-14)


def test_no_stiffness_carries_no_force():
    U = np.random.default_rng(2).standard_normal((1, 3, 5)) * 100.0
    found = contact_harmonics(U, one_pair(k_t=0.0, k_n=0.0), 64)
    assert found.state[0] == STICK and len(found.active) == 0 and np.all(found.p == 0.0)


def test_huge_friction_sticks_until_the_pair_opens():
    U = np.random.default_rng(2).standard_normal((1, 3, 5))
    U[0, 2] = [-3.0, 0.1, 0.0, 0.0, 0.1]
    for mu in (1e6, 1e300):
        assert len(contact_harmonics(U, one_pair(mu=mu), 64).active) == 0
    U[0, 2, 0] = 3.0
    assert contact_harmonics(U, one_pair(mu=1e300), 64).state[0] == OPEN


def test_pairs_at_their_limit_stick_without_roundoff():
    """Peaks that reach the limit from inside, to the last digit, leave p exactly zero."""
    rng = np.random.default_rng(8)
    angle = rng.uniform(0.0, 2.0 * np.pi, 200)
    U = np.zeros((200, 3, 3))
    U[:, 0, 1], U[:, 1, 1] = np.cos(angle) / 3.0, np.sin(angle) / 3.0
    limit = 3.0 * np.hypot(U[:, 0, 1], U[:, 1, 1]) * (1.0 + 1e-15)
    parameters = replace(one_pair().take(np.zeros(200, dtype=int)), N0=2.0 * limit)
    found = contact_harmonics(U, parameters, 128)
    assert np.all(found.p == 0.0) and len(found.active) == 0


def test_slip_while_settling_leaves_a_constant_force_and_the_state_stick():
    """The first samples push the slider, the cycle then fits between its limits."""
    U = np.zeros((1, 3, 3))
    U[0, 0] = [0.6, 0.0, 0.5]  # k_t (mean +- amplitude) = 3.3, 0.3; mu N0 = 2
    found = contact_harmonics(U, one_pair(mu=1.0), 64)
    assert found.state[0] == STICK and found.active.tolist() == [0]
    assert np.allclose(found.p[0, 0], [-1.3, 0.0, 0.0], atol=1e-14)
    assert np.allclose(found.P[0, 0, :3], [-3.0, 0.0, -3.0], atol=1e-13)  # the peak, sample 16, set the slider
    assert abs(pair_energy(U, found.p)[0]) < 1e-14


def test_settled_pairs_are_not_marked_as_slipping_by_roundoff():
    """Each period touches the limit again where the first one left the slider, up to the last digit."""
    phase = np.random.default_rng(5).uniform(0.1, 6.2, 300)
    U = np.zeros((300, 3, 3))
    U[:, 0, 0], U[:, 0, 1], U[:, 0, 2] = 0.6, 0.5 * np.cos(phase), 0.5 * np.sin(phase)
    for separate in (False, True):
        found = contact_harmonics(U, one_pair(mu=1.0, separate=separate).take(np.zeros(300, dtype=int)), 64)
        assert len(found.active) == 300 and np.all(found.state == STICK)
