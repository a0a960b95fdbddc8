"""Harmonic balance on sets of harmonics: derivatives, the static problem, odd harmonics; on any number of ranks."""

import numpy as np
import pytest
from dense_model import amplitude, branch, forced, reduced
from mpi4py import MPI
from oracles import scenes
from taylor import Place, assert_second_order

from microslip.contact.law import OPEN, SLIP, STICK
from microslip.continuation.grid import at_frequencies
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.mean_slip import is_held_by_its_joint_alone
from microslip.harmonic.operating_point import OperatingPoint
from microslip.harmonic.symmetry import symmetric
from microslip.messages.errors import CaseError
from microslip.points.selection import AllPairs

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
SETS = [(0, 1, 2, 3), (1, 3, 5), (0, 1, 3), (1,), (0,), (2, 3)]


def scene(name, harmonic=None):
    """Return an oracle's system, with all loads in one harmonic if it is given."""
    system = scenes.SCENES[name]()
    for load in system["loads"]:
        load["harmonic"] = load["harmonic"] if harmonic is None else harmonic
    return system


def row_of_masses(n=3, separate=False, flat=False):
    """Return masses in a row, each on a friction pair to ground that moves in x, or in x and y if ``flat``."""
    k = 4.0 * np.eye(n) - 1.5 * np.eye(n, k=1) - 1.5 * np.eye(n, k=-1)
    if not flat:
        pairs = [[i, -1, -1, -1, -1, -1] for i in range(n)]
        vector, K, output = np.eye(n)[0], k, np.eye(n)[0]
    else:
        pairs = [[i, n + i, -1, -1, -1, -1] for i in range(n)]
        K = np.block([[k, 0.2 * np.eye(n)], [0.2 * np.eye(n), 1.3 * k]])
        vector, output = np.concatenate([np.eye(n)[0], 0.8 * np.eye(n)[1]]), np.eye(2 * n)[0]
    loads = [{"vector": vector, "harmonic": 1, "phase": 0.3}, {"vector": 0.4 * vector[::-1], "harmonic": 3, "phase": 0.0}]
    return scenes.make_system(
        "row",
        np.eye(len(K)),
        K,
        pairs,
        mu=[0.5, 0.3, 0.4][:n],
        N0=[2.0, 1.0, 1.5][:n],
        k_t=[1.0, 1.5, 0.7][:n],
        k_n=1.0,
        zeta=0.02,
        loads=loads,
        output=output,
        omega=(1.2, 2.4),
        levels={},
        separate=separate,
    )


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("chosen", SETS)
def test_jacobian_is_the_derivative_of_the_residual(chosen):
    harmonics = Harmonics(chosen)
    system = scene("chain", harmonic=chosen[min(1, len(chosen) - 1)])
    problem = forced(*reduced(system, COMM, harmonics), 128, 100.0)
    place = Place(problem, (555.0,), 1.3)
    assert place.n_active > 0 and problem.equation.shape[2] == harmonics.n_coefficients
    assert_second_order(place)


@pytest.mark.slow
@pytest.mark.parametrize("chosen", [pytest.param((1, 3, 5), marks=pytest.mark.ranks(1)), (0, 1, 3)])
def test_a_subset_of_harmonics_solves_its_rows_of_the_full_set(chosen):
    """A branch on a subset of the harmonics: its residual in the full set vanishes in these rows, and its energy is balanced."""
    harmonics, full = Harmonics(chosen), Harmonics.up_to(5)
    system = scene("chain")
    curve = branch(system, COMM, 20.0, low=530.0, high=590.0, H=harmonics, points=8, tolerance=1e-11)
    assert curve.failure is None
    model, parameters = reduced(system, COMM, full)
    equation = forced(model, parameters, 128, 20.0).equation
    for point in curve.points[::2]:
        U_all = COMM.bcast(point.U)
        U = full_of(U_all, full)[model.owned]
        forces = equation.contact_forces(U, equation.every_pair, tangents=False)
        r = equation.residual(U, OperatingPoint(point.omega, 20.0), forces)
        size = np.abs(U_all).max()
        assert np.abs(full.carry(r, harmonics)).max(initial=0.0) < 1e-8 * size
        assert abs(point.input - point.damping - point.friction) < 1e-8 * point.input
    assert any(point.state.any() for point in curve.points) and max(amplitude(point) for point in curve.points) > 0.0


def full_of(U, full):
    """Return recorded coefficients, of a full set, as those of another set."""
    return Harmonics.full(U.shape[-1]).carry(U, full)


@pytest.mark.ranks(1, 2, 3)
def test_points_record_all_harmonics_that_the_model_had():
    model, parameters = reduced(row_of_masses(), COMM, Harmonics.up_to(4))
    odd = model.with_harmonics(Harmonics((1, 3)))
    assert (
        odd.recorded == model.recorded == Harmonics.up_to(4)
        and odd.receptance_of(1).static.G_static is model.receptance_of(1).static.G_static
    )
    assert odd.with_harmonics(model.harmonics).f.tolist() == model.f.tolist()
    assert odd.with_harmonics(Harmonics.odd_up_to(7)).recorded == Harmonics.up_to(7)
    solution = at_frequencies(forced(odd, parameters, 64, 1.0), AllPairs(), [1.5, 1.6], tolerance=1e-10)
    for point in solution.points:
        assert point.response.shape == (1, 9)
        assert not point.response[:, [0, 3, 4, 7, 8]].any() and point.response[:, [1, 2, 5, 6]].all()
        assert COMM.rank > 0 or point.U.shape == point.p.shape == (3, 3, 9)


def test_a_set_without_the_harmonic_of_a_load_is_rejected():
    model, _ = reduced(row_of_masses(), COMM, Harmonics.up_to(4))
    with pytest.raises(CaseError, match="harmonic 3, which is not one of the harmonics 0, 1, 2"):
        model.with_harmonics(Harmonics.up_to(2))


# -- harmonic 0: statics --------------------------------------------------------------------------------------------


def static_force(system, u):
    """Return K u + R^T f_nl(R u), with the contact loaded in one step from rest."""
    du = (system["R"] @ u).reshape(-1, 3)
    N = np.maximum(system["N0"] - system["k_n"] * du[:, 2], 0.0)
    T = system["k_t"][:, None] * du[:, :2]
    T *= np.minimum(1.0, system["mu"] * N / np.maximum(np.linalg.norm(T, axis=1), 1e-300))[:, None]
    f_nl = np.column_stack([T, np.maximum(system["N0"], 0.0) - N])
    return system["K"] @ u + system["R"].T @ f_nl.ravel()


def static_solution(system, level):
    """Return u by Newton's method on the dense equations, with finite-difference derivatives and halved steps."""
    f = level * sum(np.asarray(load["vector"]) * np.cos(load["phase"]) for load in system["loads"])
    u = np.linalg.solve(scenes.stuck_stiffness(system), f)
    h = 1e-7 * np.abs(u).max()
    for _ in range(200):
        r = static_force(system, u) - f
        if np.linalg.norm(r) <= 1e-13 * np.linalg.norm(f):
            return u
        J = np.column_stack([static_force(system, u + h * e) - static_force(system, u - h * e) for e in np.eye(len(u))]) / (
            2.0 * h
        )
        step, share = np.linalg.solve(J, -r), 1.0
        while share > 1e-6 and np.linalg.norm(static_force(system, u + share * step) - f) >= np.linalg.norm(r):
            share /= 2.0
        u = u + share * step
    raise AssertionError(f"static reference: |r| = {np.linalg.norm(r):.1e} N")


def static_state(system, u):
    """Return which pairs stick, slip or are open."""
    du = (system["R"] @ u).reshape(-1, 3)
    N = np.maximum(system["N0"] - system["k_n"] * du[:, 2], 0.0)
    slips = system["k_t"] * np.linalg.norm(du[:, :2], axis=1) > system["mu"] * N
    return np.where(N == 0.0, OPEN, np.where(slips, SLIP, STICK))


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize(
    "name, level, states",
    [
        ("chain", 0.1, {STICK}),
        ("chain", 40.0, {STICK, SLIP}),
        ("chain", 400.0, {SLIP}),
        ("spatial", 2.0, {SLIP}),
        ("spatial", 20.0, {OPEN}),
        ("gap", 0.4, {OPEN}),
        ("gap", -4.0, {STICK}),
    ],
)
def test_statics_are_those_of_a_dense_contact_problem_at_every_frequency(name, level, states):
    system = scene(name, harmonic=0)
    if level < 0.0:
        system["loads"] = [{**load, "vector": -np.asarray(load["vector"])} for load in system["loads"]]
    u = static_solution(system, abs(level))
    low, high = system["omega"]
    starts = np.linspace(low, high, 3)[:-1]
    branches = [branch(system, COMM, abs(level), low=start, H=0, points=5, tolerance=1e-12) for start in starts]
    assert [branch.failure for branch in branches] == [None] * 2
    points = [point for branch in branches for point in branch.points]
    assert [point.omega for point in points] == pytest.approx(starts)  # one point per branch, valid for all frequencies
    exact = float(system["output"] @ u)
    for point in points:
        assert point.response[0].tolist() == [pytest.approx(exact, rel=1e-9), 0.0, 0.0]
        assert (point.friction, point.damping, point.input) == (0.0, 0.0, 0.0)
        if COMM.rank == 0:
            assert point.U[..., 0].ravel() == pytest.approx(system["R"] @ u, abs=1e-9 * np.abs(u).max())
    assert points[-1].state.tolist() == static_state(system, u).tolist() and set(static_state(system, u)) == states


def test_a_static_load_beyond_all_friction_is_not_held_by_springs():
    system = scenes.make_system(
        "sliding",
        [[1.0]],
        [[1e-9]],
        [[0, -1, -1, -1, -1, -1]],
        mu=0.5,
        N0=2.0,
        k_t=1.0,
        k_n=1.0,
        zeta=0.02,
        loads=[{"vector": [1.0], "harmonic": 0, "phase": 0.0}],
        output=[1.0],
        omega=(0.5, 2.0),
        levels={},
    )
    within, beyond = (branch(system, COMM, level, H=0, points=5) for level in (0.9, 1.2))
    assert within.failure is None and within.points[0].response[0, 0] == pytest.approx(0.9, rel=1e-6)
    for H in (0, 1):
        equation = forced(*reduced(system, COMM, H), 8, 1.0).equation
        assert is_held_by_its_joint_alone(equation.model, equation.law) is (H == 1)
    # displacement if the weak spring carried the load beyond the limit of 1 N
    assert beyond.failure is not None or beyond.points[0].response[0, 0] == pytest.approx(0.2 / 1e-9, rel=1e-6)


# -- odd harmonics --------------------------------------------------------------------------------------------------


def equation_of(system, H=5, n_samples=64):
    return forced(*reduced(system, COMM, H), n_samples, 1.0).equation


def changed(system, **values):
    arrays = {**system}
    for key, value in values.items():
        arrays[key] = np.broadcast_to(np.asarray(value, dtype=system[key].dtype), system[key].shape).copy()
    return arrays


def with_load(system, harmonic):
    return {**system, "loads": [*system["loads"], {**system["loads"][0], "harmonic": harmonic}]}


def tilted(system):
    """Return the system with an additional motion of the first pair in z."""
    R = system["R"].copy()
    R[2, -1] = 1e-9
    return {**system, "R": R}


@pytest.mark.parametrize(
    "system, n_samples, expected",
    [
        (row_of_masses(), 64, True),
        (row_of_masses(), 65, False),
        (row_of_masses(flat=True, separate=True), 64, True),
        (row_of_masses(flat=True), 64, True),
        (changed(row_of_masses(flat=True), mu=0.0), 64, True),
        (changed(row_of_masses(flat=True), N0=-1.0), 64, True),
        (changed(row_of_masses(), N0=-1.0), 64, True),
        (with_load(row_of_masses(), 2), 64, False),
        (with_load(row_of_masses(), 0), 64, False),
        (with_load(row_of_masses(), 5), 64, True),
        (tilted(row_of_masses()), 64, False),
        (scene("jenkins"), 64, True),
        (scene("chain"), 64, False),
        (scene("gap"), 64, False),
    ],
)
def test_scenes_with_odd_symmetry_are_detected(system, n_samples, expected):
    assert symmetric(equation_of(system, n_samples=n_samples)) is expected


def test_static_coupling_alone_breaks_the_symmetry():
    equation = equation_of(row_of_masses())
    model = equation.model
    columns = model.receptance_of(1).static.G_static.transposed(np.arange(model.n_pairs))
    if COMM.rank == 0:
        columns[3, 2] = 1e-20  # a force in x of the second pair moves the first in z
    model.receptance_of(1).static.G_static.put(np.arange(model.n_pairs), columns.T)
    assert symmetric(equation) is False


@pytest.mark.slow
@pytest.mark.parametrize(
    "system, level",
    [
        (row_of_masses(), 0.3),
        (row_of_masses(), 1.0),
        (row_of_masses(), 4.0),
        (row_of_masses(flat=True, separate=True), 2.0),
        (row_of_masses(flat=True), 3.0),
        (changed(row_of_masses(flat=True), N0=-1.0), 1.0),
        pytest.param(scene("jenkins"), 0.8, marks=pytest.mark.ranks(1)),
    ],
)
def test_odd_harmonics_give_the_solution_of_the_full_set(system, level):
    full, odd = Harmonics.up_to(7), Harmonics.odd_up_to(7)
    model, parameters = reduced(system, COMM, full)
    omegas = np.linspace(*system["omega"], 9)[2:6]
    values = []
    for of in (model, model.with_harmonics(odd)):
        problem = forced(of, parameters, 128, level)
        assert symmetric(problem.equation)
        values.append(at_frequencies(problem, AllPairs(), omegas, tolerance=1e-12))
    for a, b in zip(values[0].points, values[1].points, strict=True):
        size = np.abs(a.response).max()
        assert a.response == pytest.approx(b.response, abs=1e-10 * size)
        assert np.abs(full.carry(a.response, Harmonics((0, 2, 4, 6)))).max() < 1e-10 * size
        assert np.array_equal(a.state, b.state) and a.friction == pytest.approx(b.friction, rel=1e-8, abs=1e-12)
    assert len(values[0].points) == 4
