"""Laws combined in one scene, and the requirements on every law: derivatives, order, steps that agree with cycles."""

import numpy as np
import pytest

from microslip.contact import bundle
from microslip.contact.combined import CombinedLaw, as_one
from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.energy import pair_energy
from microslip.contact.iwan import Iwan
from microslip.contact.laws import LAWS, columns_of_joint, joined, law_of
from microslip.contact.rough import Rough
from microslip.fourier.coefficients import analyse, synthesise
from microslip.fourier.harmonics import Harmonics

N_H, SEPARATE = 7, 77


def limits(n, seed):
    """Return which pairs have separate limits; sliders in a circle drift, so that plain marching takes many periods."""
    return np.ones(n, dtype=bool) if seed == SEPARATE else np.random.default_rng(seed).random(n) < 0.5


def elastic(n, seed=0, **owned):
    rng = np.random.default_rng(seed)
    mu, N0, k_t, k_n = rng.uniform(0.2, 0.5, n), rng.uniform(0.5, 3.0, n), rng.uniform(2.0, 4.0, n), rng.uniform(2.0, 5.0, n)
    return ElasticCoulomb(mu, N0, k_t, k_n, **{"separate": limits(n, seed), **owned})


def by_direction(n, seed=0):
    rng = np.random.default_rng(seed + 9)
    w0, other = 0.05 * rng.standard_normal((n, 2)), {"k_ty": rng.uniform(1.0, 6.0, n), "mu_y": rng.uniform(0.1, 0.6, n)}
    return elastic(n, seed, separate=np.ones(n, dtype=bool), w0=w0, **other)


def rough(n, seed=0):
    rng = np.random.default_rng(seed + 1)
    mu, N0, k_t, k_n = rng.uniform(0.2, 0.5, n), rng.uniform(1.0, 3.0, n), rng.uniform(2.0, 4.0, n), rng.uniform(2.0, 5.0, n)
    return Rough(mu, N0, k_t, k_n, rng.choice([np.inf, 2.0, 3.3], n), limits(n, seed), n_sliders=8)


def iwan(n, seed=0):
    rng = np.random.default_rng(seed + 2)
    return Iwan(*rng.uniform(1.0, 4.0, (3, n)), rng.uniform(-0.9, -0.1, n), rng.uniform(0.0, 1.0, n), n_sliders=12)


def mixed(n, seed=0):
    owned = np.random.default_rng(seed).permutation(n)
    parts = [np.sort(owned[i::3]) for i in range(3)]
    return as_one([(part, make(len(part), seed)) for part, make in zip(parts, (elastic, rough, iwan))])


MAKERS = [by_direction, rough, iwan, mixed]


def motions(n, size, seed=5):
    return size * np.random.default_rng(seed).standard_normal((n, 3, N_H)) / np.arange(1, N_H + 1) ** 0.5


@pytest.mark.parametrize("make", MAKERS)
def test_derivative_of_a_cycle_is_exact(make):
    law_of_pairs, U = make(9), motions(9, 0.4)
    cycle, d = law_of_pairs.cycle(U, 64), motions(9, 0.3, seed=8)
    P = np.zeros((9, 3 * N_H, 3 * N_H))
    P[cycle.active] = cycle.P
    first = np.einsum("nij,nj->ni", P, d.reshape(9, -1))
    steps = 1e-4 * 0.25 ** np.arange(4)
    remains = np.array(
        [np.abs((law_of_pairs.cycle(U + h * d, 64, False).p - cycle.p).reshape(9, -1) - h * first).max(1) for h in steps]
    )
    assert len(cycle.active) >= 8 and np.abs(first).max() > 0.1
    assert np.all(remains[-1] < 1e-4 * steps[-1] * np.abs(first).max())
    assert np.median(np.log(remains[0] / remains[2]) / np.log(16.0)) == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize("make", MAKERS)
def test_derivative_of_a_step_is_exact(make):
    law_of_pairs, rng = make(40), np.random.default_rng(4)
    before = np.zeros((40, 3 + law_of_pairs.n_memory))
    for _ in range(3):
        before, _, _ = law_of_pairs.step(0.4 * rng.standard_normal((40, 3)), before)
    du, d = 0.4 * rng.standard_normal((2, 40, 3))
    after, L, _ = law_of_pairs.step(du, before)
    h = 1e-6
    change = [law_of_pairs.step(du + sign * h * d, before)[0][:, :3] for sign in (1.0, -1.0)]
    slope = (change[0] - change[1]) / (2.0 * h)
    assert np.abs(slope - np.einsum("nij,nj->ni", L, d)).max() < 1e-6 and np.abs(slope).max() > 0.1


@pytest.mark.parametrize("make", MAKERS)
def test_steps_through_the_samples_converge_to_the_cycle_of_the_return_map(make):
    law_of_pairs, U = make(6, SEPARATE).followed(False), motions(6, 0.3)
    du, before = np.moveaxis(synthesise(U, 64), -1, 0), np.zeros((6, 3 + law_of_pairs.n_memory))
    for _ in range(4):
        forces = []
        for at in du:
            before, _, _ = law_of_pairs.step(at, before)
            forces.append(before[:, :3])
    marched = analyse(np.moveaxis(np.array(forces), 0, -1), Harmonics.full(N_H))
    cycle = law_of_pairs.cycle(U, 64)
    assert np.abs(marched - cycle.p).max() < 1e-12 * np.abs(cycle.p).max()


@pytest.mark.parametrize("make", MAKERS)
def test_samples_converge_at_the_stated_order_of_the_law(make):
    for path in (True, False):
        law_of_pairs, U = make(24).followed(path), motions(24, 0.3)
        exact = law_of_pairs.cycle(U, 4096, False).p
        sizes = [np.linalg.norm(law_of_pairs.cycle(U, N_t, False).p - exact) for N_t in (64, 256)]
        assert np.log(sizes[0] / sizes[1]) / np.log(4.0) > law_of_pairs.order - 0.25
        assert sizes[1] < (2e-3 if path else 3e-2) * np.linalg.norm(exact)


@pytest.mark.parametrize("make", MAKERS)
def test_every_cycle_dissipates_energy(make):
    U = motions(60, 0.3, seed=11)
    p = make(60).cycle(U, 256, False).p
    assert pair_energy(U, p).min() > -1e-4 * np.abs(pair_energy(U, p)).max()


@pytest.mark.parametrize("make", MAKERS)
def test_no_pair_slips_within_its_slip_safety(make):
    law_of_pairs, U = make(30), motions(30, 0.2, seed=2)
    most = np.abs(U[..., 0]) + np.hypot(U[..., 1::2], U[..., 2::2]).sum(axis=-1)
    safety = law_of_pairs.slip_safety(most)
    sure = np.flatnonzero(np.isfinite(safety) & (safety > 0.0))
    below = law_of_pairs.take(sure).cycle(0.999 * safety[sure, None, None] * U[sure], 64)
    assert len(below.active) == 0
    share = law_of_pairs.slipping_share(most, 1.0)
    assert share.shape == (30, 3) and np.all((share >= 0.0) & (share <= 1.0))
    assert law_of_pairs.utilisation(most).shape == (30,)


def test_half_wave_symmetry_is_preserved_where_the_law_states_it():
    law_of_pairs, harmonics = mixed(12), Harmonics.odd_up_to(5)
    U = np.zeros((12, 3, N_H))
    U[:, :2, [1, 2, 5, 6]] = 0.3 * np.random.default_rng(1).standard_normal((12, 2, 4))
    moves = np.tile([True, True, False], (12, 1))
    assert law_of_pairs.keeps_half_wave_symmetry(moves).all()
    even = law_of_pairs.cycle(U, 64, False).p[:, :, [0, 3, 4]]
    assert np.abs(even).max() < 1e-8
    assert harmonics.n_coefficients == 6 and law_of_pairs.cycle(U[:, :, 1:], 64, harmonics=Harmonics((1, 2, 3))).P is not None


def test_combined_laws_equal_their_parts_bit_for_bit():
    law_of_pairs, U = mixed(15), motions(15, 0.4)
    assert isinstance(law_of_pairs, CombinedLaw) and law_of_pairs.n_pairs == 15 and law_of_pairs.order == 2
    cycle = law_of_pairs.cycle(U, 64)
    before = np.zeros((15, 3 + law_of_pairs.n_memory))
    after, L, state = law_of_pairs.step(U[..., 1], before)
    counts = np.zeros(15, dtype=int)
    for owned, law in law_of_pairs.parts:
        alone = law.cycle(U[owned], 64)
        counts[owned] += 1
        assert np.array_equal(cycle.p[owned], alone.p) and np.array_equal(cycle.state[owned], alone.state)
        place = np.searchsorted(cycle.active, owned[alone.active])
        assert np.array_equal(cycle.active[place], owned[alone.active]) and np.array_equal(cycle.P[place], alone.P)
        assert np.array_equal(law_of_pairs.stiffness[owned], law.stiffness)
        stepped = law.step(U[owned][..., 1], before[owned, : 3 + law.n_memory])
        assert np.array_equal(after[owned, : 3 + law.n_memory], stepped[0])
        assert np.array_equal(L[owned], stepped[1]) and np.array_equal(state[owned], stepped[2])
    assert np.all(counts == 1) and np.all(np.diff(cycle.active) > 0)


def test_cycles_in_batches_equal_cycles_of_all_pairs(monkeypatch):
    law_of_pairs, U = rough(9), motions(9, 0.4)
    all_at_once = law_of_pairs.cycle(U, 32)
    monkeypatch.setattr(bundle, "_MOST_DERIVATIVES", 2 * law_of_pairs.bundle.size * (3 * N_H) ** 2)
    separate = law_of_pairs.cycle(U, 32)
    assert np.allclose(separate.p, all_at_once.p, rtol=0.0, atol=1e-13) and np.array_equal(separate.active, all_at_once.active)
    assert np.allclose(separate.P, all_at_once.P, rtol=0.0, atol=1e-10) and np.array_equal(separate.state, all_at_once.state)


def test_subsets_of_combined_laws():
    law_of_pairs, U = mixed(15), motions(15, 0.4)
    whole = law_of_pairs.cycle(U, 32, False)
    for chosen in (np.array([11, 3, 4]), slice(2, 9), np.arange(15) % 2 == 0):
        assert np.allclose(law_of_pairs.take(chosen).cycle(U[chosen], 32, False).p, whole.p[chosen], rtol=0.0, atol=1e-14)
    owned, law = law_of_pairs.parts[1]
    assert type(law_of_pairs.take(owned)) is type(law)  # a single law is not wrapped
    assert law_of_pairs.take([]).n_pairs == 0 and law_of_pairs.take([]).cycle(np.zeros((0, 3, N_H)), 32).p.shape == (0, 3, N_H)


def test_pairs_select_their_laws_by_name():
    columns = {name: np.array(values) for name, values in {"mu": [0.3] * 4, "N0": [2.0] * 4, "k_t": [3.0] * 4}.items()}
    columns |= {"k_n": np.full(4, 5.0), "separate": np.zeros(4, dtype=bool), "T0": np.zeros((4, 2))}
    columns |= {"open_at_rest": np.zeros(4, dtype=bool)}
    keys = {"exponent": None, "sliders": None, "chi": -0.5, "beta": 0.2}
    owned = joined([(1, {}), (2, columns_of_joint("rough", keys, 2)), (1, columns_of_joint("iwan", keys, 1))])
    assert np.isnan(owned["exponent"][[0, 3]]).all() and owned["sliders"].tolist()[1:] == [24.0, 24.0, 50.0]
    law_of_pairs = law_of(["elastic-coulomb", "rough", "rough", "iwan"], columns | owned)
    assert [type(law).__name__ for _, law in law_of_pairs.parts] == ["ElasticCoulomb", "Rough", "Iwan"]
    assert law_of_pairs.parts[2][1].F_S.tolist() == [0.6]
    alone = law_of(["elastic-coulomb"] * 4, columns)
    assert type(alone) is ElasticCoulomb and alone.k_ty is None
    assert law_of([], {name: values[:0] for name, values in columns.items()}).n_pairs == 0
    assert tuple(LAWS) == ("elastic-coulomb", "rough", "iwan")


# -- parameters of y ------------------------------------------------------------------------------------------------


def test_different_parameters_in_x_and_y_are_two_elements_under_one_pressure():
    law_of_pairs, U = by_direction(20), motions(20, 0.3)
    cycle = law_of_pairs.cycle(U, 128)
    for axis, k, mu in ((0, law_of_pairs.k_t, law_of_pairs.mu), (1, law_of_pairs.k_ty, law_of_pairs.mu_y)):
        w0 = np.zeros((20, 2))
        w0[:, 0] = law_of_pairs.w0[:, axis]
        alone = ElasticCoulomb(mu, law_of_pairs.N0, k, law_of_pairs.k_n, law_of_pairs.separate, w0)
        turned = U.copy()
        turned[:, 0], turned[:, 1] = U[:, axis], 0.0
        assert np.allclose(cycle.p[:, axis], alone.cycle(turned, 128).p[:, 0], rtol=1e-10, atol=1e-12)
    assert np.allclose(law_of_pairs.stiffness, np.column_stack([law_of_pairs.k_t, law_of_pairs.k_ty, law_of_pairs.k_n]))


def test_equal_parameters_in_x_and_y_are_isotropic():
    plain = elastic(5, separate=np.ones(5, dtype=bool))
    twice = ElasticCoulomb(plain.mu, plain.N0, plain.k_t, plain.k_n, plain.separate, k_ty=plain.k_t, mu_y=plain.mu)
    assert twice.k_ty is None and twice.mu_y is None
    U = motions(5, 0.3)
    assert np.array_equal(twice.cycle(U, 64).P, plain.cycle(U, 64).P)


def test_a_friction_circle_takes_a_single_parameter():
    ones = np.ones(2)
    with pytest.raises(ValueError, match="k_ty of pair 1 differs from x, which needs separate limits"):
        ElasticCoulomb(ones, ones, ones, ones, np.array([True, False]), k_ty=2.0 * ones)
    with pytest.raises(ValueError, match="mu_y of pair 0 differs"):
        ElasticCoulomb(ones, ones, ones, ones, ones > 0, mu_y=0.0 * ones)
