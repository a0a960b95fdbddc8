"""Branches compared with exact results and an independent harmonic balance, and their consistency; on any number of ranks."""

import dataclasses

import numpy as np
import pytest
from dense_model import amplitude, branch, reduced
from mpi4py import MPI
from oracles import harmonic_balance, scenes

from microslip.continuation.point_solver import PointSolver
from microslip.points.selection import AllPairs, DissipatingPairs, NonStickingPairs

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD  # the one- and two-pair systems leave ranks without pairs


def load(system, key, value):
    for entry in system["loads"]:
        entry.setdefault(key, value)
    return system


def scene(name):
    return load(scenes.SCENES[name](), "phase", 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "X, frequencies",
    [
        pytest.param(0.5, (0.632495064828, 1.897248005129), marks=pytest.mark.ranks(1)),
        (1.5, (1.127402158122, 1.463083257582)),
        pytest.param(2.0, (1.136206225921, 1.305151377843), marks=pytest.mark.ranks(1)),
    ],
)
def test_amplitudes_of_a_jenkins_mass_are_exact(X, frequencies):
    curve = branch(scene("jenkins"), COMM, 0.8, H=1, n_samples=4096, at=frequencies, points=20)
    requested = [point for point in curve.points if point.requested]
    assert curve.failure is None
    assert [point.omega for point in requested] == pytest.approx(frequencies, abs=1e-12)
    # the sampled loop converges as N_t^-2; the exact amplitude is known to 12 digits
    assert [amplitude(point) for point in requested] == pytest.approx([X, X], rel=4e-6)


@pytest.mark.slow
@pytest.mark.ranks(1)
@pytest.mark.parametrize(
    "name, level, omega",
    [(name, *at[:2]) for name in ("spatial", "chain", "gap") for at in scenes.SCENES[name]()["levels"].values()],
)
def test_points_solve_an_independent_harmonic_balance_with_energy_balance(name, level, omega):
    system = {**scene(name), "sampled": True}
    low = {"gap": system["omega"][0]}.get(name, system["omega"][0])
    curve = branch(system, COMM, level, low=low, H=5, n_samples=64, at=(omega,))
    assert_energy_balance(curve)
    point = next(point for point in curve.points if point.requested)
    if COMM.rank > 0:  # motions and forces are recorded on rank 0
        return
    model, _ = reduced(system, COMM, 5)
    # both codes start from this point, so that they converge to the same solution where several exist
    start = full_motion(system, level, point)
    reference = harmonic_balance.solve(system, omega, level, H=5, n_samples=64, start=start)
    assert reference.u_hat == pytest.approx(start, abs=1e-6 * np.abs(start).max())
    assert np.array_equal(reference.state, point.state)
    assert point.response[0] == pytest.approx(system["output"] @ reference.u_hat, abs=1e-6 * np.abs(start).max())


def full_motion(system, level, point):
    """Return the harmonics of u, (n, N_H), under the loads and the contact forces of a point."""
    H = point.p.shape[-1] // 2
    f = scenes.force_coefficients(system, level, H) - system["R"].T @ point.p.reshape(-1, 2 * H + 1)
    K_L, C, M = scenes.stuck_stiffness(system), scenes.damping_matrix(system), system["M"]
    u = np.empty_like(f)
    u[:, 0] = np.linalg.solve(K_L, f[:, 0])
    for n in range(1, H + 1):
        Z = K_L - (n * point.omega) ** 2 * M + 1j * n * point.omega * C
        u_n = np.linalg.solve(Z, f[:, 2 * n - 1] - 1j * f[:, 2 * n])
        u[:, 2 * n - 1], u[:, 2 * n] = u_n.real, -u_n.imag
    return u


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_energy_balance_holds_at_every_point():
    system = scene("jenkins")
    for level, *_ in system["levels"].values():
        curve = branch(system, COMM, level, points=20)
        assert curve.failure is None
        assert_energy_balance(curve)


def assert_energy_balance(curve):
    closure = [abs(p.input - p.damping - p.friction) / p.input for p in curve.points]
    assert max(closure) < 1e-6
    assert min(point.energy.min() for point in curve.points) > -1e-9 * max(point.input for point in curve.points)


def test_linear_points_are_exact_to_roundoff_without_newton_steps():
    system = scene("chain")
    curve = branch(system, COMM, 1e-3)
    K_L, C = scenes.stuck_stiffness(system), scenes.damping_matrix(system)
    for point in curve.points:
        Z = K_L - point.omega**2 * system["M"] + 1j * point.omega * C
        force = 1e-3 * sum(entry["vector"] * np.exp(1j * entry["phase"]) for entry in map(as_array, system["loads"]))
        exact = system["output"] @ np.linalg.solve(Z, force)
        assert point.response[0, 1] - 1j * point.response[0, 2] == pytest.approx(exact, rel=1e-10)
        assert point.newton <= 1 and not point.p.any()


def as_array(entry):
    return {**entry, "vector": np.asarray(entry["vector"])}


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_folds_are_passed_and_the_downward_branch_is_the_same_curve():
    system = scene("gap")
    up, down = branch(system, COMM, 0.1, points=70), branch(system, COMM, 0.1, points=70, down=True)
    assert up.failure is None and down.failure is None
    steps = np.diff([point.omega for point in up.points])
    turns = int(np.sum(steps[1:] * steps[:-1] < 0))
    assert turns >= 2 and turns % 2 == 0  # forward, backward, forward
    # every point of the way back lies on the way forward: solved again at its own frequency from the nearest point
    forward = np.array([[p.omega, *p.response[0, 1:3]] for p in up.points])
    for point in down.points[::5]:
        here = np.array([point.omega, *point.response[0, 1:3]])
        distance = distance_to_polyline(here, forward)
        assert distance < 5e-3 * np.abs(forward[:, 1:]).max()


def distance_to_polyline(point, line):
    a, b = line[:-1], line[1:]
    share = np.clip(np.sum((point - a) * (b - a), axis=1) / np.sum((b - a) ** 2, axis=1), 0.0, 1.0)
    return np.linalg.norm(a + share[:, None] * (b - a) - point, axis=1).min()


@pytest.mark.ranks(1)
def test_second_point_does_not_jump_over_folds_near_the_first():
    curve = branch(scene("spatial"), COMM, 0.8, low=0.97, high=1.9, H=5, points=30)
    assert curve.failure is None
    assert max(amplitude(point) for point in curve.points) > 3.5  # 2.1 at the start; the peak lies between two folds


def test_branch_that_leaves_the_range_at_its_start_fails_with_a_message():
    curve = branch(scene("spatial"), COMM, 0.8, low=0.98, high=1.9, H=5, points=30)
    assert curve.points and "back out of the range" in curve.failure


@pytest.mark.ranks(1)
def test_first_point_that_newton_misses_is_continued_over_the_level():
    curve = branch(scene("spatial"), COMM, 1.5, low=0.97, high=1.9, points=30)
    assert curve.failure is None and curve.points[0].omega == 0.97
    assert curve.points[0].notes == ("first point reached over the level, where there may be other solutions",)
    assert not any(point.notes for point in curve.points[1:])


@pytest.mark.ranks(1)
def test_small_newton_steps_continue_a_branch_on_which_all_other_solves_fail(monkeypatch):
    """From the tenth solve Newton's method fails until a patient solve was made: the curve is the same."""
    whole, solve, solves = branch(scene("jenkins"), COMM, 0.8, H=1, points=12), PointSolver.solve, []

    def failing(solver, *of):
        solution, selected = solve(solver, *of)
        solves.append(solver.is_patient)
        return (solution if any(solves) or len(solves) < 10 else dataclasses.replace(solution, failure="tired")), selected

    monkeypatch.setattr(PointSolver, "solve", failing)
    curve = branch(scene("jenkins"), COMM, 0.8, H=1, points=12)
    assert curve.failure is None and any(solves)
    assert max(map(amplitude, curve.points)) == pytest.approx(max(map(amplitude, whole.points)), rel=0.05)


@pytest.mark.ranks(2, 3)
def test_all_ranks_agree_with_a_single_rank():
    system = scene("chain")
    together, alone = (branch(system, comm, 100.0, points=15) for comm in (COMM, MPI.COMM_SELF))
    peak = max(amplitude(point) for point in alone.points)
    assert len(together.points) == len(alone.points)
    for a, b in zip(together.points, alone.points):
        assert a.omega == pytest.approx(b.omega, rel=1e-7)
        assert a.response == pytest.approx(b.response, abs=1e-6 * peak)
        assert np.array_equal(a.state, b.state)


@pytest.mark.study
@pytest.mark.ranks(1)
def test_check_within_a_point_removes_the_error_of_the_late_selection():
    system = scene("chain")
    low, high = system["omega"]
    at = tuple(np.linspace(low, high, 9)[1:-1])
    requested = {}
    for name, selection in {"all": AllPairs(), "late": NonStickingPairs(), "checked": NonStickingPairs(True)}.items():
        curve = branch(system, COMM, 10.0, at=at, selection=selection)
        assert curve.failure is None
        requested[name] = np.array([point.response[0] for point in curve.points if point.requested])
    peak = np.abs(requested["all"]).max()
    assert np.abs(requested["checked"] - requested["all"]).max() < 1e-7 * peak


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_energy_filter_reduces_the_unknowns():
    system = scene("chain")
    plain = branch(system, COMM, 10.0, selection=NonStickingPairs())
    filtered = branch(system, COMM, 10.0, selection=DissipatingPairs(energy_tolerance=1e3))
    N_H, n_modes = 7, 9
    assert plain.points[0].unknowns == (n_modes + 3 * 2) * N_H  # Algorithm 1 starts with all pairs
    assert filtered.points[-1].unknowns == n_modes * N_H  # nothing dissipates a kilojoule
    assert max(point.unknowns for point in plain.points[2:]) > n_modes * N_H


@pytest.mark.ranks(1)
@pytest.mark.slow
def test_unknowns_are_those_of_the_active_pairs():
    stuck = branch(scene("chain"), COMM, 1e-3, selection=AllPairs())
    assert {point.unknowns for point in stuck.points} == {0}
    curve = branch(scene("chain"), COMM, 10.0, selection=AllPairs())
    unknowns = [point.unknowns for point in curve.points]
    assert max(unknowns) > 0
    if COMM.rank == 0:
        moving = [int((point.p != 0.0).any(axis=(1, 2)).sum()) for point in curve.points]
        assert unknowns == [3 * n * 7 for n in moving]


@pytest.mark.ranks(1)
@pytest.mark.slow
def test_failure_names_the_frequency():
    system = scene("gap")
    curve = branch(system, COMM, 0.2, points=12, ds_min=1.0, tolerance=1e-300)
    assert curve.failure is not None and "Hz" in curve.failure


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_error_falls_as_modes_are_added():
    system = scene("chain")
    at = tuple(np.linspace(*system["omega"], 9)[1:-1])

    def requested(n_modes):
        return np.array([p.response[0] for p in branch(system, COMM, 10.0, at=at, n_modes=n_modes).points if p.requested])

    exact = requested(9)
    errors = [np.abs(requested(n_modes) - exact).max() / np.abs(exact).max() for n_modes in (3, 5, 8)]
    assert errors[0] > 5 * errors[1] > 25 * errors[2] and errors[2] < 1e-3


@pytest.mark.slow
def test_point_records_are_complete():
    point = branch(scene("chain"), COMM, 10.0).points[3]
    assert {field.name for field in dataclasses.fields(point)} >= {"omega", "response", "U", "p", "energy", "state"}
    assert point.U.shape == point.p.shape == ((2, 3, 7) if COMM.rank == 0 else (0, 3, 0))
