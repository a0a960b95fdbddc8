"""Changed contact stiffness by a low-rank update, compared with structures built with it; on any number of ranks."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from dense_model import forced, reduced
from mpi4py import MPI
from oracles import scenes
from ring import LAW, LIMIT, Sector

from microslip.continuation.grid import at_frequencies, solved_at, task_at
from microslip.continuation.problems import ForcedResponse
from microslip.error_estimate.estimate import ErrorEstimator
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.balance import HarmonicBalance
from microslip.harmonic.operating_point import LawParameter, OperatingPoint
from microslip.points.error_parts import total
from microslip.points.selection import AllPairs
from microslip.receptance.columns import ReceptanceColumns
from microslip.receptance.motions import linear_motion, load_motion, output_motion
from microslip.receptance.other_springs import with_springs
from microslip.receptance.springs import SpringChange
from microslip.receptance.truncated_modes import EnrichedModel
from microslip.reduction.settings import ModalDamping

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM = MPI.COMM_WORLD  # two pairs: a third rank owns none
FACTORS = [0.01, pytest.param(0.3, marks=pytest.mark.ranks(1)), pytest.param(4.0, marks=pytest.mark.ranks(1)), 100.0]
LEVEL, OMEGAS = 100.0, [450.0, 555.0, 700.0]


def chain(k_t=1.0, k_n=1.0, pairs=(0, 1), **damping):
    system = scenes.chain()
    system["k_t"][list(pairs)] *= k_t
    system["k_n"][list(pairs)] *= k_n
    if damping:
        del system["zeta"]
    return {**system, **damping}


def whole(owned):
    return np.concatenate(COMM.allgather(owned))


def springs_of(system):
    return np.stack([system["k_t"], system["k_t"], system["k_n"]], axis=1).ravel()


@dataclass(frozen=True, eq=False)
class ChangedLaw(ForcedResponse):
    """The response over the frequency with changed parameters of the law."""

    values: tuple

    @property
    def law_parameters(self):
        return tuple(parameter for parameter, _ in self.values)

    def at(self, parameters):
        return OperatingPoint(parameters[0], self.level, law=self.values)


def with_bars(problem, omegas, estimator):
    return solved_at(task_at(problem, AllPairs(), omegas, 1e-10, estimator), omegas).points


def parameter(name, pairs=(0, 1)):
    return LawParameter(name, np.array(pairs), chain()[name][list(pairs)])


@pytest.mark.parametrize("names", [("k_t",), ("k_n",), ("k_t", "k_n")], ids=" ".join)
@pytest.mark.parametrize("factor", FACTORS)
def test_the_updated_receptance_is_that_of_a_structure_built_with_the_springs(factor, names):
    other = chain(**dict.fromkeys(names, factor))
    (model, _), (built, _) = (reduced(system, COMM, 3) for system in (chain(), other))
    K_J = springs_of(other)
    changed = with_springs(model, SpringChange(K_J - springs_of(chain()), K_J, model.stated_damping))
    np.testing.assert_allclose(changed.omega_n, built.omega_n, rtol=1e-9)
    p = np.random.default_rng(2).standard_normal((6, model.N_H))
    for of in (
        lambda model: whole(linear_motion(model, 2.0, 600.0)),
        lambda model: output_motion(model, 2.0, 600.0, p),
        lambda model: load_motion(model, 2.0, 600.0, p),
        lambda model: whole(ReceptanceColumns(model, 600.0, np.arange(2)).apply(p)),
        lambda model: model.output_receptance(600.0, 1),
        lambda model: model.receptance_of(1).static.outputs_static,
    ):
        expected = of(built)
        np.testing.assert_allclose(of(changed), expected, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("n_modes", [2, 5])
@pytest.mark.parametrize("factor", FACTORS)
def test_truncated_modes_are_updated_by_the_forces_of_the_changed_springs(factor, n_modes):
    """(1 + G dK) V' = V for motions V under any forces, with the damping matrix of the structure."""
    C = scenes.damping_matrix(scenes.chain())
    model, _ = reduced(chain(C=C), COMM, 3, n_modes)
    dK = (factor - 1.0) * springs_of(chain())
    changed = with_springs(model, SpringChange(dK, factor * springs_of(chain())))
    V, V_changed = (whole(linear_motion(each, 1.0, 600.0)) for each in (model, changed))
    columns = ReceptanceColumns(model, 600.0, np.arange(2))
    product = V_changed + whole(columns.apply(dK[:, None] * V_changed)).reshape(V.shape)
    np.testing.assert_allclose(product, V, atol=1e-10 * np.abs(V).max())


@pytest.mark.parametrize("factor", FACTORS)
def test_updated_complex_groups_are_those_of_a_ring_built_with_the_springs(factor, monkeypatch):
    harmonics = Harmonics.up_to(3)
    model = replace(Sector(COMM, 5, lambda n: n % 5).model(harmonics), stated_damping=ModalDamping(ratio=0.02))
    K_J = factor * LIMIT
    changed = with_springs(model, SpringChange(K_J - LIMIT, K_J, model.stated_damping))
    ours = [whole(linear_motion(changed, 1.0, 700.0)), changed.output_receptance(700.0, 1)]
    p = np.random.default_rng(2).standard_normal((6, model.N_H))
    ours.append(whole(ReceptanceColumns(changed, 700.0, np.arange(2)).apply(p)))
    monkeypatch.setattr("ring.LIMIT", K_J)
    built = Sector(COMM, 5, lambda n: n % 5).model(harmonics)
    theirs = [whole(linear_motion(built, 1.0, 700.0)), built.output_receptance(700.0, 1)]
    theirs.append(whole(ReceptanceColumns(built, 700.0, np.arange(2)).apply(p)))
    assert np.iscomplexobj(theirs[1]) and len(LAW["mu"]) == 2
    for our, their in zip(ours, theirs):
        np.testing.assert_allclose(our, their, atol=1e-10 * np.abs(their).max())


@pytest.mark.parametrize(
    "names, pairs",
    [
        (("k_t", "k_n"), (0, 1)),
        *(pytest.param((name,), (pair,), marks=pytest.mark.ranks(1)) for name, pair in (("k_t", 1), ("k_n", 0))),
    ],
    ids=str,
)
@pytest.mark.parametrize("factor", FACTORS)
def test_the_response_with_changed_springs_is_that_of_a_structure_built_with_them(factor, names, pairs):
    built = forced(*reduced(chain(pairs=pairs, **dict.fromkeys(names, factor)), COMM, 3), 128, LEVEL)
    points = at_frequencies(built, AllPairs(), OMEGAS, tolerance=1e-11).points
    values = tuple((parameter(name, pairs), factor) for name in names)
    equation = HarmonicBalance.of_all(*reduced(chain(), COMM, 3), 128)
    assert len(points) > 1
    for point in points:
        at = OperatingPoint(point.omega, LEVEL, law=values)
        under, U = equation.under(at), COMM.bcast(point.U)
        mine = U[under.model.owned]
        forces = under.contact_forces(mine, under.every_pair, tangents=False)
        np.testing.assert_allclose(whole(under.residual(mine, at, forces)), 0.0, atol=1e-9 * np.abs(U).max())
        response = output_motion(under.model, LEVEL, point.omega, under.full_force(forces))
        np.testing.assert_allclose(response, point.response, atol=1e-9 * np.abs(point.response).max())


def test_newton_converges_to_the_response_with_changed_springs():
    values = tuple((parameter(name), 3.0) for name in ("k_t", "k_n"))
    equation = HarmonicBalance.of_all(*reduced(chain(), COMM, 3), 128)
    points = at_frequencies(ChangedLaw(equation, LEVEL, values), AllPairs(), OMEGAS, tolerance=1e-11).points
    built = forced(*reduced(chain(k_t=3.0, k_n=3.0), COMM, 3), 128, LEVEL)
    expected = at_frequencies(built, AllPairs(), OMEGAS, tolerance=1e-11).points
    ours, theirs = (np.array([point.response[0] for point in of]) for of in (points, expected))
    assert len(points) == len(expected) == len(OMEGAS)
    np.testing.assert_allclose(ours, theirs, atol=1e-8 * np.abs(theirs).max())


@pytest.mark.parametrize("factor", [0.3, 4.0])
def test_error_bars_bound_the_effect_of_truncated_modes_with_changed_springs(factor):
    sector = Sector(COMM, 5, lambda n: 0)
    shapes = [LawParameter(name, np.arange(2), np.array(LAW[name])) for name in ("k_t", "k_n")]
    values = tuple((shape, factor) for shape in shapes)

    def solved(n_modes):
        model = replace(sector.model(Harmonics.up_to(3), n_modes), stated_damping=ModalDamping(ratio=0.02))
        equation = HarmonicBalance.of_all(model, sector.law, 128)
        estimator = ErrorEstimator(sector.enriched(model)) if n_modes else None
        return with_bars(ChangedLaw(equation, 150.0, values), [600.0, 680.0, 740.0], estimator)

    truncated, exact = solved(4), solved(None)
    amplitudes = [np.array([point.response[0, 1] - 1j * point.response[0, 2] for point in of]) for of in (truncated, exact)]
    true, bars = np.abs(amplitudes[0] - amplitudes[1]), np.array([point.error[0, 0] for point in truncated])
    assert (true > 1e-7 * np.abs(amplitudes[1]).max()).all()
    assert (true <= 3.0 * bars).all() and np.median(bars / true) < 30.0


def test_the_enriched_model_has_the_changed_springs():
    model, law = reduced(chain(), COMM, 3)
    equation = HarmonicBalance.of_all(model, law, 128)
    estimator = ErrorEstimator(EnrichedModel.of_all_modes(model))
    problem = ChangedLaw(equation, LEVEL, ((parameter("k_t"), 2.0),))
    (point,) = with_bars(problem, [555.0], estimator)
    finer = forced(*reduced(chain(k_t=2.0), COMM, 15), 1024, LEVEL)
    expected = at_frequencies(finer, AllPairs(), [555.0], tolerance=1e-10).points[0]
    true = np.hypot(*(expected.response[0, 1:3] - point.response[0, 1:3]))
    assert true <= total(point.error[0]) <= 20.0 * true


def test_removing_the_only_springs_of_a_body_is_rejected_on_every_rank():
    """A mass held by its pair only, whose springs vanish."""
    system = scenes.make_system(
        "loose", 0.5 * np.eye(3), np.zeros((3, 3)), [[0, 1, 2, -1, -1, -1]], mu=0.3, N0=60.0, k_t=5e5, k_n=8e5, zeta=0.02,
        loads=[{"vector": np.ones(3), "harmonic": 1, "phase": 0.0}], output=np.eye(3)[0], omega=(400.0, 800.0), levels={},
    )  # fmt: skip
    equation = HarmonicBalance.of_all(*reduced(system, COMM, 3), 128)
    vary = LawParameter("k_t", np.array([0]), np.array([5e5]))
    half, none = (OperatingPoint(555.0, 1.0, law=((vary, factor),)) for factor in (0.5, 0.0))
    assert equation.allows(half) and not equation.allows(none)
    with pytest.raises(ValueError, match="build the structure again"):
        equation.under(none)


@pytest.mark.parametrize("name, value", [("N0", -0.5), ("gap", 0.5), ("mu", -0.1), ("k_t", -1.0)])
def test_a_parameter_value_invalid_for_one_pair_is_rejected_on_every_rank(name, value):
    equation = HarmonicBalance.of_all(*reduced(chain(), COMM, 3), 128)
    vary = LawParameter(name, np.array([1]), np.array([1.0]))
    at = OperatingPoint(555.0, LEVEL, law=((vary, value),))
    assert not equation.allows(at)
    with pytest.raises(ValueError, match="pair|negative"):
        equation.under(at)
    problem = ChangedLaw(equation, LEVEL, ((vary, value),))
    assert not problem.allows((555.0,)) and not problem.allows((-1.0,))
    assert replace(problem, values=((parameter("mu"), 1.1),)).allows((555.0,))
