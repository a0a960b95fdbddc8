"""The receptance on synthetic data: dense formulas, adjoint, rates, blocks; modal and full damping; one to three groups."""

import weakref
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from microslip.fourier.amplitudes import to_complex, to_real
from microslip.fourier.harmonics import Harmonics
from microslip.parallel.ownership import split_evenly
from microslip.receptance.columns import ActiveColumns, ReceptanceColumns
from microslip.receptance.damping import Damping, DynamicFlexibility, Flexibility
from microslip.receptance.modes import DampedModes
from microslip.receptance.motions import linear_motion, linear_motion_rate, load_motion, modal_motion, output_motion
from microslip.receptance.per_group import PerGroup
from microslip.receptance.receptance import Receptance
from microslip.receptance.reduced_model import ReducedModel
from microslip.receptance.static_columns import StaticColumns
from microslip.receptance.static_response import StaticResponse

COMM = MPI.COMM_WORLD
N_PAIRS, N_LOADS, N_OUT, OMEGA = 5, 2, 2, 1.7
STEPS = (1e-3, 5e-4, 2.5e-4)
HARMONICS = Harmonics((0, 1, 2, 5))
ACTIVE = np.array([0, 2, 3])


def modes_of(seed, m, full=False, is_complex=False):
    rng = np.random.default_rng(seed)
    omega_n = np.sort(rng.uniform(1.0, 9.0, m))
    A = numbers(rng, is_complex, m, m)
    C = 0.05 * (A @ A.conj().T) if full else 0.1 * omega_n
    shapes = (numbers(rng, is_complex, *shape) for shape in ((3 * N_PAIRS, m), (m, N_LOADS), (N_OUT, m)))
    return DampedModes(omega_n, Damping(C), *shapes)


def numbers(rng, is_complex, *shape):
    real = rng.standard_normal(shape)
    return real + 1j * rng.standard_normal(shape) if is_complex else real


def receptance(modes, seed=0):
    """Return modes with a random static response from a separate seed, complex if the modes are."""
    is_complex = np.iscomplexobj(modes.R_phi)
    n = 3 * N_PAIRS + N_OUT + N_LOADS
    A = numbers(np.random.default_rng(seed), is_complex, n, n)
    static = A @ A.conj().T / n
    pairs, outputs, loads = np.split(np.arange(n), [3 * N_PAIRS, 3 * N_PAIRS + N_OUT])
    ranges = split_evenly(N_PAIRS, COMM.size)
    owned = slice(3 * ranges[COMM.rank], 3 * ranges[COMM.rank + 1])

    def columns(of):
        return static[owned, (3 * of[:, None] + np.arange(3)).ravel()]

    response = StaticResponse(
        G_static=StaticColumns(N_PAIRS, ranges[COMM.rank + 1] - ranges[COMM.rank], columns, is_complex=is_complex),
        du_static=static[np.ix_(pairs, loads)],
        out_static=static[np.ix_(outputs, loads)],
        out_R=static[np.ix_(outputs, pairs)],
        load_static=static[np.ix_(loads, loads)],
        outputs_static=np.diag(static)[outputs].real,
    )
    return Receptance(modes, response)


def model_of(*receptances, harmonics=HARMONICS):
    """Return a model with a group per receptance; two groups are the even and the odd harmonics."""
    rng = np.random.default_rng(0)
    rng.standard_normal((3 * N_PAIRS + N_OUT + N_LOADS,) * 2)
    per_group = PerGroup(lambda group: receptances[group], lambda n: n % len(receptances), tuple(range(len(receptances))))
    return ReducedModel(
        comm=COMM,
        n_pairs=N_PAIRS,
        n_outputs=N_OUT,
        receptances=per_group,
        f=rng.standard_normal((N_LOADS, harmonics.n_coefficients)),
        harmonics=harmonics,
    )


def split(full=False, seeds=(1, 2), sizes=(4, 6), statics=(0, 3), is_complex=False):
    """Return a model of two groups, the even and the odd harmonics; the odd group may be complex."""
    even = receptance(modes_of(seeds[0], sizes[0], full), statics[0])
    return model_of(even, receptance(modes_of(seeds[1], sizes[1], full, is_complex), statics[1]))


def thirds(full):
    """Return a model with a real group of the mean, and complex groups of harmonic 1 and of harmonics 2 and 5."""
    of_complex = [receptance(modes_of(2 + i, 6 - i, full[i], is_complex=True), 3 + i) for i in range(2)]
    return model_of(receptance(modes_of(1, 4)), *of_complex)


MODELS = {
    "modal": lambda: model_of(receptance(modes_of(1, 4))),
    "full": lambda: model_of(receptance(modes_of(1, 4, full=True))),
    "two": split,
    "two full": lambda: split(full=True),
    "two, complex": lambda: split(is_complex=True),
    "two, complex full": lambda: split(full=True, is_complex=True),
    "three, of 1 and 2 harmonics": lambda: thirds((False, False)),
    "three, one full": lambda: thirds((False, True)),
}
of_each_model = pytest.mark.parametrize("name", list(MODELS))


def dynamic(model, n, x, y, omega=OMEGA):
    """Return x c_n y^H by dense algebra; x and y name participations of the modes of harmonic n."""
    modes = model.receptance_of(n).modes
    C = modes.damping.C if modes.damping.couples_modes else np.diag(modes.damping.C)
    D = np.diag(modes.omega_n**2) - (n * omega) ** 2 * np.eye(len(C)) + 1j * n * omega * C
    return x(modes) @ (np.linalg.inv(D) - np.diag(modes.omega_n**-2.0)) @ y(modes).conj().T


def exact(model, static, x, y, q):
    """Return real coefficients of A_n q_n with A_n = static + x c_n y^H, ``static`` of a receptance."""
    q_n = to_complex(q)
    A = [static(model.receptance_of(n)) + dynamic(model, n, x, y) for n in model.harmonics.chosen]
    return to_real(np.stack([A[i] @ q_n[:, i] for i in range(len(A))], axis=1), q.shape[1])


def whole(owned):
    return np.concatenate(COMM.allgather(owned))


def of_pairs(receptance):
    return whole(receptance.static.G_static.transposed(np.arange(N_PAIRS)).T)


def pairs_of(modes):
    return modes.R_phi


def loads_of(modes):
    return modes.b.conj().T


def random(seed, *shape):
    return np.random.default_rng(seed).standard_normal(shape)


@of_each_model
def test_motions_equal_dense_algebra(name):
    model = MODELS[name]()
    p, level = random(3, 3 * N_PAIRS, model.N_H), 2.5
    f, still = level * model.f, np.zeros((3 * N_PAIRS, model.N_H))

    def moved(static_f, static_p, x, p):
        return exact(model, static_f, x, loads_of, f) - exact(model, static_p, x, pairs_of, p)

    expected = moved(lambda of: of.static.du_static, of_pairs, pairs_of, still)
    np.testing.assert_allclose(whole(linear_motion(model, level, OMEGA)), expected, atol=1e-12)
    np.testing.assert_allclose(linear_motion(model, level, OMEGA, slice(None)), expected, atol=1e-12)
    outputs = moved(lambda of: of.static.out_static, lambda of: of.static.out_R, lambda m: m.o, p)
    np.testing.assert_allclose(output_motion(model, level, OMEGA, p), outputs, atol=1e-12)
    loads = moved(lambda of: of.static.load_static, lambda of: of.static.du_static.conj().T, loads_of, p)
    np.testing.assert_allclose(load_motion(model, level, OMEGA, p), loads, atol=1e-12)
    for n in model.harmonics.chosen:
        A = model.receptance_of(n).static.out_R + dynamic(model, n, lambda m: m.o, pairs_of)
        np.testing.assert_allclose(model.output_receptance(OMEGA, n), A, atol=1e-12)


@of_each_model
def test_modal_motion_solves_the_modal_equations(name):
    model = MODELS[name]()
    p = random(4, 3 * N_PAIRS, model.N_H)
    for group, eta in zip(model.groups, modal_motion(model, 2.0, OMEGA, p), strict=True):
        modes, n_omega = group.receptance.modes, OMEGA * group.harmonics.numbers
        f_n, p_n = (to_complex(x[:, group.columns]) for x in (2.0 * model.f, p))
        q = modes.b @ f_n - modes.R_phi.conj().T @ p_n
        left = modes.omega_n[:, None] ** 2 * eta - n_omega**2 * eta + 1j * n_omega * modes.damping.apply(eta)
        np.testing.assert_allclose(left, q, atol=1e-11)


@of_each_model
@pytest.mark.parametrize("active", [ACTIVE, np.arange(N_PAIRS), np.array([], dtype=int)], ids=["some", "all", "none"])
def test_products_blocks_and_matrix_agree(name, active):
    model = MODELS[name]()
    G, rows = ReceptanceColumns(model, OMEGA, active), (3 * active[:, None] + np.arange(3)).ravel()
    p = random(5, len(rows), model.N_H)
    p_all = np.zeros((3 * N_PAIRS, model.N_H))
    p_all[rows] = p
    expected = exact(model, of_pairs, pairs_of, pairs_of, p_all)
    product = whole(G.apply(p)).reshape(expected.shape)
    np.testing.assert_allclose(product, expected, atol=1e-12)
    np.testing.assert_allclose((G.matrix() @ p.ravel()).reshape(p.shape), expected[rows], atol=1e-12)
    for n, block in zip(model.harmonics.chosen, G.blocks(), strict=True):
        dense = (of_pairs(model.receptance_of(n)) + dynamic(model, n, pairs_of, pairs_of))[np.ix_(rows, rows)]
        np.testing.assert_allclose(block, dense, atol=1e-12)
    if len(active) > 0:
        chosen = np.arange(len(active))[::2]
        some = (3 * chosen[:, None] + np.arange(3)).ravel()
        between = np.stack(list(G.blocks(chosen)))
        np.testing.assert_allclose(between, np.stack(list(G.blocks()))[:, some][:, :, some], atol=1e-12)
        force = random(8, len(chosen), len(model.harmonics), 3, 2) + 1j * random(9, len(chosen), len(model.harmonics), 3, 2)
        moved = np.concatenate(COMM.allgather(G.moved_by(chosen, force)), axis=1)
        by_row = force.swapaxes(0, 1).reshape(len(moved), len(some), 2)
        np.testing.assert_allclose(moved, np.stack(list(G.blocks()))[:, :, some] @ by_row, atol=1e-12)
        columns = ActiveColumns(G, np.float64)
        product = whole(columns.apply(p * columns.unit))
        np.testing.assert_allclose(product, expected[rows], atol=1e-12)
        several = columns.apply_to_several(np.stack([p, 2.0 * p, 0.0 * p]) * columns.unit)
        np.testing.assert_allclose(several, [columns.apply(s * p * columns.unit) for s in (1.0, 2.0, 0.0)], atol=1e-12)


@pytest.mark.parametrize("unit_of_time", [1e-25, 1e25])
@pytest.mark.parametrize("full", [False, True], ids=["modal", "full"])
@pytest.mark.parametrize("is_complex", [False, True], ids=["real", "complex"])
def test_single_precision_does_not_depend_on_the_unit_of_time(is_complex, full, unit_of_time):
    harmonics = Harmonics((1, 2, 5)) if is_complex else HARMONICS

    def of(modes):
        return model_of(receptance(modes), harmonics=harmonics)

    modes, p = modes_of(1, 4, full, is_complex), random(5, 3 * len(ACTIVE), harmonics.n_coefficients)
    damping = Damping(modes.damping.C / unit_of_time)
    omega_n, R_phi = modes.omega_n / unit_of_time, modes.R_phi / unit_of_time
    rows = (3 * ACTIVE[:, None] + np.arange(3)).ravel()
    reference, scaled = (
        ActiveColumns(ReceptanceColumns(of(modes), omega, ACTIVE), np.float32)
        for modes, omega in [
            (modes, OMEGA),
            (replace(modes, omega_n=omega_n, damping=damping, R_phi=R_phi), OMEGA / unit_of_time),
        ]
    )
    expected = whole(ReceptanceColumns(of(modes), OMEGA, ACTIVE).apply(p)).reshape(-1, harmonics.n_coefficients)[rows]
    for columns in (reference, scaled):
        np.testing.assert_allclose(whole(columns.apply(p * columns.unit)), expected, atol=2e-5 * np.abs(expected).max())


@of_each_model
def test_the_adjoint_product_is_the_transposed_product(name):
    model = MODELS[name]()
    G = ReceptanceColumns(model, OMEGA, ACTIVE)
    p, x = random(6, 3 * len(ACTIVE), model.N_H), random(7, N_PAIRS, 3, model.N_H)[model.owned]
    left = COMM.allreduce(float(np.vdot(x, G.apply(p))))
    transposed = COMM.allreduce(G.apply_transposed(x))
    assert left == pytest.approx(np.vdot(transposed, p), rel=1e-12)
    y = np.zeros((3 * N_PAIRS, model.N_H))
    rows = (3 * ACTIVE[:, None] + np.arange(3)).ravel()
    y[rows] = random(8, len(rows), model.N_H)
    adjoint = whole(G.adjoint().apply(y[rows])).reshape(y.shape)
    np.testing.assert_allclose(
        adjoint[rows], COMM.allreduce(G.apply_transposed(y.reshape(-1, 3, model.N_H)[model.owned])), atol=1e-12
    )
    np.testing.assert_allclose(G.adjoint().matrix(), G.matrix().T, atol=1e-14)


@of_each_model
@pytest.mark.parametrize("d_omega, d_sigma", [(1.0, 0.0), (0.0, 1.0), (0.7, -1.3), (0.0, 0.0)])
def test_rates_have_a_second_order_taylor_remainder(name, d_omega, d_sigma):
    model, p = MODELS[name](), random(9, 3 * len(ACTIVE), HARMONICS.n_coefficients)

    def at(h):
        moved, omega = model.with_damping(h * d_sigma), OMEGA + h * d_omega
        return whole(ReceptanceColumns(moved, omega, ACTIVE).apply(p)), whole(linear_motion(moved, 2.0, omega))

    rates = (
        whole(ReceptanceColumns(model, OMEGA, ACTIVE).apply_rate(p, d_omega, d_sigma)),
        whole(linear_motion_rate(model, 2.0, OMEGA, d_omega, d_sigma)),
    )
    for here, rate, *steps in zip(at(0.0), rates, *(at(h) for h in STEPS)):
        if d_omega == d_sigma == 0.0:
            assert not rate.any()
            continue
        remainders = [np.linalg.norm(there - here - h * rate) for there, h in zip(steps, STEPS)]
        assert np.log2(np.divide(remainders[:-1], remainders[1:])) == pytest.approx(2.0, abs=0.05)


@pytest.mark.ranks(1)
@pytest.mark.parametrize(("n_modes", "N_H"), [(1, 3), (1, 4), (2, 2)])
def test_a_product_does_not_depend_on_the_addresses_of_its_operands(n_modes, N_H):
    """So that runs are repeated bit for bit: NumPy rounds products of complex numbers less than 64 bytes apart differently."""
    rng, results = np.random.default_rng(1), []
    for _ in range(10):
        c, q = numbers(rng, True, n_modes, (N_H + 1) // 2), numbers(rng, False, n_modes, N_H)
        results.append([Flexibility(c.copy()).apply(q.copy()) for _ in range(200)])  # all in memory at the same time
        exact = to_real(c * to_complex(q), N_H)
        np.testing.assert_allclose(results[-1][0][:, N_H % 2 :], exact[:, N_H % 2 :], rtol=1e-14, atol=1e-14)
    assert [len({product.tobytes() for product in products}) for products in results] == [1] * 10


@pytest.mark.parametrize("full", [False, True])
def test_a_mode_without_damping_has_no_response_at_its_resonance(full):
    """The other harmonics have theirs, with damping that couples the other modes, too."""
    C = np.array([0.1, 0.1, 0.0])
    damping = Damping(np.diag(C) + 0.05 * np.diag([1.0, 0.0], 1) + 0.05 * np.diag([1.0, 0.0], -1) if full else C)
    of_harmonics = DynamicFlexibility(np.array([1.0, 2.0, 3.0]), damping, np.array([1, 2]), 3.0).matrices
    assert np.isnan(of_harmonics[0, 2, 2]) and np.isfinite(of_harmonics[1]).all()


def test_modal_damping_is_full_damping_with_a_diagonal_matrix():
    modes, n = modes_of(1, 4), HARMONICS.numbers
    full = replace(modes, damping=Damping(np.diag(modes.damping.C)))
    assert (modes.damping.couples_modes, full.damping.couples_modes) == (False, True)
    np.testing.assert_array_equal(modes.zeta, full.zeta)
    for a, b in ((modes, full), (modes.with_damping(0.3), full.with_damping(0.3))):
        np.testing.assert_allclose(a.damping.diagonal, b.damping.diagonal)
        eta = random(1, 4, 3)
        np.testing.assert_allclose(a.damping.apply(eta), b.damping.apply(eta))
        np.testing.assert_allclose(a.damping.apply_to_rows(eta.T), b.damping.apply(eta).T)
        np.testing.assert_allclose(b.damping.apply_to_rows(eta.T), b.damping.apply(eta).T)
        c, c_full = (DynamicFlexibility(x.omega_n, x.damping, n, OMEGA) for x in (a, b))
        q, x = random(2, 4, HARMONICS.n_coefficients), random(3, 5, 4)
        for i in range(len(HARMONICS)):
            np.testing.assert_allclose(c.between(x, i, x), c_full.between(x, i, x), atol=1e-13)
            np.testing.assert_allclose(c.whole(x.T, i), c_full.whole(x.T, i), atol=1e-13)
        for diagonal, full_matrix in ((c, c_full), (c.adjoint(), c_full.adjoint()), (c.rate(0.4, 1.1), c_full.rate(0.4, 1.1))):
            np.testing.assert_allclose(diagonal.apply(q), full_matrix.apply(q), atol=1e-13)
        h = np.array([0.1, 0.2])
        A, A_full = (x.damping.step_matrix(x.omega_n, 0.6, 0.5, h, h**2) for x in (a, b))
        forces = random(4, 2, 4)
        np.testing.assert_allclose(A.solve(forces), A_full.solve(forces), rtol=1e-12)
        F, F_full = (M.flexibility(h) for M in (A, A_full))
        np.testing.assert_allclose(F.apply(forces), h[:, None] * A.solve(forces), rtol=1e-12)
        np.testing.assert_allclose(F.apply(forces), F_full.apply(forces), rtol=1e-12)
        np.testing.assert_allclose(F.between(x, 1, x), F_full.between(x, 1, x), rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("full", [False, True])
def test_two_groups_with_the_same_receptance_equal_one_group(full):
    single, double = model_of(receptance(modes_of(1, 4, full))), split(full, seeds=(1, 1), sizes=(4, 4), statics=(0, 0))
    assert (len(single.groups), len(double.groups)) == (1, 2)
    p = random(10, 3 * N_PAIRS, single.N_H)
    for act in (
        lambda model: linear_motion(model, 2.0, OMEGA),
        lambda model: linear_motion_rate(model, 2.0, OMEGA, 0.3, 0.4),
        lambda model: output_motion(model, 2.0, OMEGA, p),
        lambda model: ReceptanceColumns(model, OMEGA, np.arange(N_PAIRS)).apply(p),
        lambda model: ReceptanceColumns(model, OMEGA, np.arange(N_PAIRS)).apply_rate(p, 0.3, 0.4),
        lambda model: ReceptanceColumns(model, OMEGA, ACTIVE).matrix(),
    ):
        np.testing.assert_allclose(act(double), act(single), atol=1e-13)


def test_groups_of_further_harmonics_are_built_when_needed():
    made = []

    def make(group):
        made.append(group)
        return receptance(modes_of(group, 4), group)

    model = replace(split(), receptances=PerGroup(make, lambda n: n % 3, (0, 1, 2)))
    model = replace(model, f=model.f * [0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    only = model.with_harmonics(Harmonics((1, 4)))
    assert made == [] and [group.harmonics.chosen for group in only.groups] == [(1, 4)] and only.groups[0].columns == slice(None)
    wider = model.with_harmonics(Harmonics((1, 3, 4, 5)))
    assert [group.harmonics.chosen for group in wider.groups] == [(1, 4), (3,), (5,)] and made == [1, 0, 2]
    assert [list(group.columns) for group in wider.groups] == [[0, 1, 4, 5], [2, 3], [6, 7]]
    assert wider.groups[0].receptance is only.groups[0].receptance is model.receptance_of(10)
    loaded = wider.groups[0].receptance.modes
    assert [list(each) for each in wider.loaded_modes] == [list(loaded.omega_n), list(loaded.zeta)]
    assert len(replace(wider, f=0.0 * wider.f).loaded_modes[0]) == 0
    damped = wider.with_damping(0.3)
    assert damped.receptance_of(3).static is wider.receptance_of(3).static and made == [1, 0, 2]


@pytest.mark.parametrize("full", [False, True], ids=["modal", "full"])
def test_the_conjugate_receptance_belongs_to_conjugate_matrices(full):
    """The G of nodal diameter N - d from that of d equals a receptance built from conjugate arrays; static columns are shared."""
    base, harmonics = receptance(modes_of(1, 4, full, is_complex=True)), Harmonics((1, 2, 5))
    modes, static = base.modes, base.static
    reference = Receptance(
        DampedModes(modes.omega_n, Damping(modes.damping.C.conj()), modes.R_phi.conj(), modes.b.conj(), modes.o.conj()),
        replace(
            static,
            G_static=StaticColumns(
                N_PAIRS, static.G_static.n_owned, lambda of: static.G_static.solve(of).conj(), is_complex=True
            ),
            **{name: getattr(static, name).conj() for name in ("du_static", "out_static", "out_R", "load_static")},
        ),
    )
    view, dense = (model_of(each, harmonics=harmonics) for each in (base.conjugated(), reference))
    G, G_dense = (ReceptanceColumns(model, OMEGA, ACTIVE) for model in (view, dense))
    p, x = random(5, 3 * len(ACTIVE), view.N_H), random(6, view.owned.stop - view.owned.start, 3, view.N_H)
    assert np.allclose(G.matrix(), G_dense.matrix(), rtol=1e-13, atol=1e-13)
    assert np.allclose(whole(G.apply(p)).reshape(-1), whole(G_dense.apply(p)).reshape(-1), rtol=1e-12, atol=1e-13)
    assert np.allclose(G.apply_transposed(x), G_dense.apply_transposed(x), rtol=1e-12, atol=1e-13)
    assert np.allclose(ActiveColumns(G, np.float64).apply(p), ActiveColumns(G_dense, np.float64).apply(p), rtol=1e-12, atol=1e-13)
    # both share one memory: a column computed by either is known to both, and conjugating twice gives the original
    columns, twice = view.receptance_of(1).static.G_static, view.receptance_of(1).conjugated()
    assert columns.known is static.G_static.known and static.G_static.known[ACTIVE].all() and columns.batches == 0
    assert twice.static.G_static is static.G_static
    assert np.array_equal(twice.modes.R_phi, modes.R_phi)


def test_a_real_receptance_is_its_own_conjugate():
    real = receptance(modes_of(1, 4))
    assert real.conjugated() is real


def test_a_single_group_has_all_columns_without_a_copy():
    model = MODELS["modal"]()
    (group,) = model.groups
    term = random(1, 3, model.N_H)
    assert model.joined([term]) is term and np.shares_memory(term[:, group.columns], term)
    assert model.flexibilities(OMEGA) is model.flexibilities(OMEGA)
    with pytest.raises(ValueError, match="read-only"):
        model.flexibilities(OMEGA)[0].c[0] = 0.0


def test_an_unused_model_is_freed():
    model = MODELS["modal"]()
    for omega in np.arange(1.0, 9.0):
        model.flexibilities(omega)
    assert len(model._flexibilities) == 4 and 8.0 in model._flexibilities
    gone = weakref.ref(model)
    del model
    assert gone() is None
