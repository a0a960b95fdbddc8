"""Error bars compared with true errors from solved enriched problems; on any number of ranks, one of them without a pair."""

from functools import lru_cache

import numpy as np
import pytest
from dense_model import branch, forced, reduced
from mpi4py import MPI
from oracles import scenes

from microslip.continuation.grid import at_frequencies, solved_at, task_at
from microslip.error_estimate.correction import MOST_STEPS, Estimate, corrected
from microslip.error_estimate.estimate import Changes, ErrorEstimator
from microslip.harmonic import adjoint_solver
from microslip.harmonic.linearisation import Linearisation
from microslip.harmonic.operating_point import OperatingPoint
from microslip.points.error_parts import PARTS, SAFETY, total
from microslip.points.selection import AllPairs, NonStickingPairs
from microslip.receptance.motions import output_motion
from microslip.receptance.truncated_modes import EnrichedModel

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
OMEGAS = list(np.linspace(500.0, 640.0, 8))


def solved(level, H=3, n_samples=128, tolerance=1e-10, selection=None, comm=COMM, omegas=OMEGAS, name="chain"):
    """Return the points of a level at some frequencies, with error bars."""
    model, parameters = reduced(scenes.SCENES[name](), comm, H)
    estimator = ErrorEstimator(EnrichedModel.of_all_modes(model))
    task = task_at(forced(model, parameters, n_samples, level), selection or AllPairs(), omegas, tolerance, estimator)
    solution = solved_at(task, omegas)
    assert solution.failure is None
    return solution.points


@lru_cache
def coarsely_solved(level, **coarse):
    return solved(level, **coarse)


@lru_cache
def reference(level):
    """Return the amplitudes of a level with many more harmonics and samples."""
    return amplitudes(solved(level, H=21, n_samples=1024))


def amplitudes(points):
    return np.array([point.response[0, 1] - 1j * point.response[0, 2] for point in points])


def errors(points):
    return np.array([point.error[0] for point in points])


@pytest.mark.slow
@pytest.mark.parametrize("level", [40.0, pytest.param(100.0, marks=pytest.mark.ranks(1))])
@pytest.mark.parametrize("coarse", [{"H": 1}, {"H": 3}, {"H": 5, "n_samples": 32}])
def test_error_bars_bound_the_effect_of_more_harmonics_and_samples(level, coarse):
    points = coarsely_solved(level, **coarse)
    true, bars = np.abs(amplitudes(points) - reference(level)), total(errors(points))
    peak = np.abs(reference(level)).max()
    significant = true > 1e-7 * peak
    assert significant.any()
    assert (true <= bars + 1e-7 * peak).mean() >= 0.85
    assert 1.0 < np.median(bars[significant] / true[significant]) < 10.0


def test_a_stuck_point_has_zero_error_with_all_modes():
    assert np.all(errors(solved(0.3)) == 0.0)


def test_the_part_of_the_solver_is_the_distance_to_the_solution():
    model, parameters = reduced(scenes.chain(), COMM, 3)
    equation = forced(model, parameters, 128, 100.0).equation
    everything = equation.every_pair
    exact = COMM.bcast(solved(100.0, omegas=[560.0, 561.0], tolerance=1e-12)[0].U)
    away = 1e-6 * np.abs(exact).max() * np.random.default_rng(1).standard_normal(exact.shape)
    U = (exact + away)[model.owned]

    def response(U):
        p = equation.full_force(equation.contact_forces(U, everything, tangents=False))
        return output_motion(model, 100.0, 560.0, p)[0]

    off = response(U) - response(exact[model.owned])
    parts = ErrorEstimator(EnrichedModel.of_all_modes(model)).at(equation, U, OperatingPoint(560.0, 100.0), everything).parts[0]
    # tau . r is the distance to the solution: that of the response at U, plus that of U by its Newton step
    assert parts[PARTS.index("solver")] == pytest.approx(np.hypot(off[1], off[2]), rel=0.05)


def test_an_error_bar_includes_the_additional_damping_of_its_point():
    model, parameters = reduced(scenes.chain(), COMM, 3)
    sigma, omega, level = 4.0, 560.0, 100.0
    damped = model.with_damping(sigma)
    U = at_frequencies(forced(damped, parameters, 128, level), AllPairs(), [omega], tolerance=1e-10).points[0].U
    U = COMM.bcast(U)[model.owned]
    of_point, of_model, undamped = (
        ErrorEstimator(EnrichedModel.of_all_modes(each)).at(equation, U, OperatingPoint(omega, level, extra), equation.every_pair)
        for each, extra in ((model, sigma), (damped, 0.0), (model, 0.0))
        for equation in [forced(each, parameters, 128, level).equation]
    )
    assert of_point.parts == pytest.approx(of_model.parts, rel=1e-5, abs=1e-6 * of_model.parts.max())
    assert of_point.correction == pytest.approx(of_model.correction, rel=1e-4)
    assert undamped.parts.sum() > 10.0 * of_model.parts.sum()  # without the damping the point is no solution


def test_the_part_of_the_pairs_bounds_the_effect_of_a_dropped_pair():
    complete = solved(40.0)
    late = solved(40.0, selection=NonStickingPairs())
    true, parts = np.abs(amplitudes(late) - amplitudes(complete)), errors(late)
    dropped = true > 1e-6 * np.abs(amplitudes(complete)).max()
    assert np.all(parts[~dropped, PARTS.index("pairs")] <= 1e-5 * np.abs(amplitudes(complete)).max())
    assert np.all(true[dropped] <= total(parts[dropped]))


@pytest.mark.ranks(2, 3)
def test_error_bars_agree_on_any_number_of_ranks():
    together, alone = (solved(100.0, omegas=OMEGAS[2:4], comm=comm) for comm in (COMM, MPI.COMM_SELF))
    peak = np.abs(amplitudes(alone)).max()
    np.testing.assert_allclose(errors(together), errors(alone), rtol=1e-4, atol=1e-9 * peak)
    np.testing.assert_allclose(corrections(together), corrections(alone), rtol=0.0, atol=1e-6 * peak)


def test_points_of_a_branch_have_the_error_bars_of_single_points():
    estimated = branch(scenes.chain(), COMM, 40.0, low=500.0, high=640.0, points=20)
    assert estimated.failure is None
    assert all(point.error is None for point in estimated.points)


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize(("name", "level"), [("chain", 100.0), pytest.param("chain", 40.0, marks=pytest.mark.ranks(1, 2))])
@pytest.mark.parametrize("direct", [0, 10**6])
def test_adjoints_solve_the_transposed_system(monkeypatch, name, level, direct):
    monkeypatch.setattr(adjoint_solver, "DIRECT", direct)
    model, parameters = reduced(scenes.SCENES[name](), COMM, 3)
    equation = forced(model, parameters, 128, level).equation
    U = COMM.bcast(solved(level, omegas=[560.0, 561.0], name=name)[0].U)[model.owned]
    forces = equation.contact_forces(U, equation.every_pair, tangents=True)
    assert len(forces.active) > 0
    linear = Linearisation.of(equation, OperatingPoint(560.0, level), forces)
    # B of any size: one quantity ten orders below the other, and one that is zero
    B = np.random.default_rng(3).standard_normal((3, 3 * model.n_pairs, model.N_H)) * np.array([1.0, 1e-10, 0.0])[:, None, None]
    B[1:2] = B[0:1] * 1e-10
    solver = adjoint_solver.AdjointSolver(COMM)
    try:
        chi, tau, is_solved = linear.solve_transposed(B, solver)
    finally:
        solver.destroy()
    assert is_solved
    assert not chi[2].any()
    np.testing.assert_allclose(chi[1], 1e-10 * chi[0], rtol=1e-5, atol=1e-12 * np.abs(chi[1]).max(initial=0.0))
    # v . (1 + G^T P^T) chi = (v + P G v) . chi  for any force v: compared with the forward operators
    v = np.random.default_rng(4).standard_normal((3 * model.n_pairs, model.N_H))
    in_active = v.reshape(-1, 3, model.N_H)[forces.active].reshape(-1, model.N_H)
    G_v = linear.G.apply(in_active)
    owned = v.reshape(-1, 3, model.N_H)[model.owned]
    B_own = B[0].reshape(-1, 3, model.N_H)[model.owned]
    mine = np.zeros_like(owned)
    mine[forces.active_owned] = owned[forces.active_owned]
    lhs = np.vdot(mine, chi[0].reshape(owned.shape)) + np.vdot(G_v, tau[0].reshape(owned.shape))
    sums = COMM.allreduce(np.array([lhs, np.vdot(mine, B_own), np.vdot(mine, mine) ** 0.5]))
    assert sums[0] == pytest.approx(sums[1], abs=5e-3 * np.linalg.norm(in_active) * np.abs(B[0]).max())
    off = COMM.allreduce(float(np.abs(sums[0] - sums[1])))
    assert direct == 0 or off < 1e-9 * np.linalg.norm(in_active) * np.linalg.norm(B[0])


def corrections(points):
    return np.array([point.corrected[0, 0] - 1j * point.corrected[0, 1] for point in points])


@pytest.mark.parametrize("level", [40.0, pytest.param(100.0, marks=pytest.mark.ranks(1))])
@pytest.mark.parametrize("coarse", [{"H": 1}, {"H": 3}, {"H": 5, "n_samples": 32}])
def test_the_corrected_amplitude_has_a_smaller_error_and_a_smaller_valid_error_bar(level, coarse):
    points, peak = coarsely_solved(level, **coarse), np.abs(reference(level)).max()
    before, after = np.abs(amplitudes(points) - reference(level)), np.abs(corrections(points) - reference(level))
    bars, remaining = total(errors(points)), np.array([point.error_corrected[0] for point in points])
    assert np.median(after / before) < 0.25
    assert np.all(remaining <= bars) and np.median(remaining / bars) < 0.5
    assert (after <= remaining + 1e-7 * peak).mean() >= 0.85


def test_the_error_after_correction_falls_as_the_square_of_the_correction():
    """Motions at two distances from the solution: the enriched model of the error bar is the solved model."""
    model, parameters = reduced(scenes.chain(), COMM, 3)
    equation = forced(model, parameters, 128, 100.0).equation
    everything, at = equation.every_pair, OperatingPoint(560.0, 100.0)
    exact = COMM.bcast(solved(100.0, omegas=[560.0, 561.0], tolerance=1e-13)[0].U)
    away = np.abs(exact).max() * np.random.default_rng(1).standard_normal(exact.shape)

    def values(size):
        """Return the amplitude of a motion that is off by this share, without and with its correction."""
        U, estimator = (exact + size * away)[model.owned], ErrorEstimator(EnrichedModel.of_all_modes(model))
        p = equation.full_force(equation.contact_forces(U, everything, tangents=False))
        none = np.zeros_like(p)
        estimator.changes = lambda *_: Changes(none, none, none, none, equation, np.zeros_like(U), p)
        computed, first = estimator.at(equation, U, at, everything), output_motion(model, 100.0, 560.0, p)[0, 1:3]
        estimator.destroy()
        return first[0] - 1j * first[1] + np.array([0.0, computed.correction[0]])

    true = values(0.0)[0]
    errors_of = np.abs(np.array([values(size) for size in (1e-3, 1e-4)]) - true)
    assert errors_of[1, 0] / errors_of[0, 0] == pytest.approx(0.1, rel=0.3)
    assert errors_of[1, 1] < 0.02 * errors_of[0, 1] and errors_of[0, 1] < 0.05 * errors_of[0, 0]


def test_a_stuck_point_needs_no_correction():
    for point in solved(0.3):
        assert np.array_equal(point.corrected, point.response[:, 1:3]) and not point.error_corrected.any()


LINEAR = np.array([[0.0, 0.0], [0.3, 0.4], [0.0, 0.1], [0.0, 0.0], [0.0, 0.0], [0.0, 0.2]])


def test_the_error_bar_of_a_stuck_point_has_no_change_of_contact_forces():
    truncated, nothing = np.array([3.0, 0.0, 4.0, 1.0]), np.zeros((6, 4))
    parts = nothing.copy()
    parts[PARTS.index("modes")] = truncated
    expected, computed = corrected(parts, nothing, nothing[:1], True, truncated, np.ones(4)), Estimate.of_modes_alone(truncated)
    for name in ("parts", "correction", "remaining", "is_near"):
        assert np.array_equal(getattr(computed, name), getattr(expected, name))


@pytest.mark.parametrize("second", [[0.01, 0.0], [1.0, 1.0], [-0.3, -0.4]])
def test_the_second_order_term_is_part_of_the_harmonics(second):
    steps = LINEAR.sum(axis=0) + np.array([[0.0, 0.0], second])
    computed, size = corrected(LINEAR, LINEAR, steps, True, np.zeros(2), np.ones(2)), np.hypot(0.3 + second[0], 0.4 + second[1])
    assert computed.is_near and computed.correction == pytest.approx([0.3 + second[0] - 1j * (0.7 + second[1])])
    assert computed.remaining == pytest.approx([SAFETY * (0.2 * size + 0.25 * (0.1 + 0.2) + 0.2 * np.hypot(*second))])
    assert total(computed.parts) == pytest.approx([SAFETY * (size + 0.1 + 0.2)])


@pytest.mark.parametrize(
    ("amplitude", "is_near", "size"), [([30.0, 40.0], True, 5.0), ([6.0, 8.0], False, 10.0), ([0.1, 0.0], False, 0.5)]
)
def test_no_correction_where_steps_do_not_converge_and_large_steps_mean_no_solution_nearby(amplitude, is_near, size):
    steps = np.tile([3.0, 4.0] if amplitude[0] > 1.0 else [0.05, 0.0], (MOST_STEPS, 1))
    steps[0] = 1e6  # an early step is ignored
    computed = corrected(LINEAR, LINEAR, steps, False, np.zeros(2), np.array(amplitude))
    assert computed.is_near == is_near and computed.correction == 0.0
    assert computed.remaining == pytest.approx(SAFETY * (size + 0.3)) and computed.remaining == total(computed.parts)
