"""Harmonics, samples and steps chosen for a requested accuracy; on any number of ranks."""

from dataclasses import replace

import numpy as np
import pytest
from dense_model import forced, reduced
from mpi4py import MPI
from oracles import scenes

from microslip.continuation.acceptance import accept
from microslip.continuation.accuracy import (
    MOST_SAMPLES,
    SHARES,
    Accuracy,
    Memory,
    Resolution,
    chord_error,
    least_samples,
    samples_from,
    steps_for,
)
from microslip.continuation.follow import follow_branch
from microslip.continuation.grid import at_frequencies, solved_at, task_at
from microslip.continuation.point_solver import Workspace
from microslip.continuation.task import BranchTask
from microslip.error_estimate.correction import parts_of_corrected
from microslip.error_estimate.estimate import ErrorEstimator
from microslip.fourier.harmonics import Harmonics
from microslip.points.error_parts import PARTS, total
from microslip.points.selection import AllPairs
from microslip.points.sweep import Sweep
from microslip.receptance.truncated_modes import EnrichedModel

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
LOW, HIGH = 520.0, 640.0  # beyond, several solutions exist


def problem_of(name, level, H=3, n_samples=128):
    system = scenes.SCENES[name]()
    model, parameters = reduced(system, COMM, H)
    return forced(model, parameters, n_samples, level), ErrorEstimator(EnrichedModel.of_all_modes(model))


def amplitudes(points):
    return np.array([point.response[0, 1] - 1j * point.response[0, 2] for point in points])


@pytest.mark.slow
@pytest.mark.ranks(1)
@pytest.mark.parametrize("level", [pytest.param(40.0, marks=pytest.mark.study), 100.0])
@pytest.mark.parametrize("target", [1e-2, 1e-3])
def test_a_branch_meets_the_requested_accuracy(level, target):
    problem, estimator = problem_of("chain", level)
    accuracy = Accuracy(target, Resolution(Harmonics.up_to(1), 16))
    task = BranchTask(problem, AllPairs(), Sweep(LOW, HIGH), steps_for(target), 1e-9, estimator, accuracy)
    curve = follow_branch(task, 2000)
    assert curve.failure is None
    fine, _ = problem_of("chain", level, 15, 2048)
    omegas = COMM.bcast([point.omega for point in curve.points])
    reference = at_frequencies(fine, AllPairs(), omegas, tolerance=1e-10)
    true = np.abs(amplitudes(curve.points) - amplitudes(reference.points)) / np.abs(amplitudes(reference.points)).max()
    assert true.max() <= target
    assert target == 1e-2 or max(point.harmonics for point in curve.points) > 1
    assert min(point.samples for point in curve.points) > 16
    # the curve between the points
    between = np.linspace(LOW, HIGH, 40)[1:-1]
    finer = at_frequencies(fine, AllPairs(), list(between), tolerance=1e-9)
    straight = np.interp(between, omegas, np.abs(amplitudes(curve.points)))
    assert np.abs(straight - np.abs(amplitudes(finer.points))).max() <= 2.0 * target * straight.max()


@pytest.mark.slow
@pytest.mark.parametrize("target", [1e-2, pytest.param(1e-3, marks=pytest.mark.ranks(1))])
def test_accuracy_of_the_corrected_amplitude_needs_fewer_harmonics(target):
    problem, estimator = problem_of("chain", 100.0)
    omegas, spent = list(np.linspace(LOW, HIGH, 14)), {}
    fine, _ = problem_of("chain", 100.0, 25, 2048)
    exact = amplitudes(at_frequencies(fine, AllPairs(), omegas, tolerance=1e-10).points)
    for is_corrected in (False, True):
        accuracy = Accuracy(target, Resolution(Harmonics.up_to(1), 16), is_corrected=is_corrected)
        curve = solved_at(task_at(problem, AllPairs(), omegas, 1e-9, estimator, accuracy), omegas)
        assert curve.failure is None
        u = np.array([(p.corrected[0] if is_corrected else p.response[0, 1:3]) @ [1.0, -1.0j] for p in curve.points])
        assert np.abs(u - exact).max() <= target * np.abs(exact).max()
        spent[is_corrected] = COMM.bcast([point.harmonics for point in curve.points])
    estimator.destroy()
    assert np.sum(spent[True]) < np.sum(spent[False])


def test_parts_of_a_corrected_error_bar_are_those_of_the_remaining_error():
    parts = np.array([[1.0, 50.0, 8.0, 0.0, 0.5, 4.0], [1.0, 2.0, 3.0, 0.0, 0.5, 0.0]])
    remaining = np.array(
        [3.0 * (1.0 + 0.2 * 50.0 + 0.25 * (8.0 + 4.0) + 4.0), total(parts)[1]]
    )  # the first bar with 4 beyond first order
    corrected = parts_of_corrected(parts, remaining)
    np.testing.assert_allclose(corrected[0], [1.0, 14.0, 2.0, 0.0, 0.5, 1.0])
    np.testing.assert_array_equal(corrected[1], parts[1])  # the second bar is not corrected
    assert (corrected <= parts).all()


def test_prescribed_harmonics_and_samples_do_not_change():
    problem, estimator = problem_of("chain", 100.0, H=2, n_samples=48)
    accuracy = Accuracy(1e-4, Resolution(Harmonics.up_to(2), 48), frozenset({"harmonics", "samples"}), chooses_steps=False)
    omegas = [550.0, 560.0]
    curve = solved_at(task_at(problem, AllPairs(), omegas, 1e-9, estimator, accuracy), omegas)
    assert {(point.harmonics, point.samples) for point in curve.points} == {(2, 48)}


def test_odd_harmonics_remain_odd_with_enough_samples():
    start = Resolution(Harmonics.odd_up_to(3), 16)
    accuracy = Accuracy(1e-3, start)
    error = np.zeros((1, 5))
    error[0, 1] = 1.0
    finer, _ = accuracy.finer(start, *accuracy.ratios(np.array([1.0]), error, Memory()))
    assert all(n % 2 for n in finer.harmonics.chosen)
    assert finer.harmonics.highest == 7
    assert finer.n_samples >= least_samples(7) > 4 * 7


def judgements_of(accuracy, now, errors, memory, method):
    """Return the choices of ``method`` of an accuracy after each of some errors, and the memory after the last."""
    judgements = []
    for error in errors:
        choice, memory = getattr(accuracy, method)(now, *accuracy.ratios(np.array([1.0]), error, memory))
        judgements.append(choice)
    return judgements, memory


def test_resolution_is_lowered_after_small_errors_and_later_once_it_was_raised_again():
    coarse, fine = Resolution(Harmonics.up_to(1), 16), Resolution(Harmonics.up_to(9), 512)
    accuracy, quiet, loud = Accuracy(1e-3, coarse), np.zeros((1, 5)), np.zeros((1, 5))
    steps, memory = judgements_of(accuracy, fine, [quiet] * 3, Memory(), "coarser")
    assert steps[:2] == [fine, fine]
    assert steps[2].harmonics.highest == 7
    assert steps[2].n_samples == 256
    loud[0, 1] = 1.0
    _, memory = judgements_of(accuracy, fine, [loud], memory, "finer")
    steps, _ = judgements_of(accuracy, fine, [quiet] * 6, memory, "coarser")
    assert [step.harmonics.highest for step in steps] == [9, 9, 9, 9, 9, 7]


def test_harmonics_that_do_not_reduce_the_error_bar_are_not_raised_further():
    """The mean slip is nearly free: the error bar is as large with 31 harmonics as with 11, and more would cost time."""
    accuracy, calm = Accuracy(1e-3, Resolution(Harmonics.up_to(1), 64)), {"samples": 0.1, "solver": 0.0}
    before, raised = Resolution(Harmonics.up_to(11), 128), Resolution(Harmonics.up_to(15), 128)
    finer, memory = accuracy.finer(before, {"harmonics": 1.5, **calm}, Memory())
    assert finer == raised
    missed = {"harmonics": 1.4, **calm}
    finer, memory = accuracy.finer(raised, missed, memory)
    assert finer is None
    following, memory = accuracy.coarser(raised, missed, memory)
    assert following == before
    assert accuracy.finer(before, missed, memory)[0] is None  # nor at the next points
    _, memory = accuracy.coarser(before, {"harmonics": 0.9, **calm}, memory)
    assert accuracy.finer(before, missed, memory)[0].harmonics.highest > 11  # until a point meets the accuracy
    _, memory = accuracy.finer(before, missed, Memory())
    assert accuracy.coarser(before, missed, memory.after_raising())[1].ceiling == 11  # Newton's method fails with more
    _, memory = accuracy.finer(Resolution(Harmonics.up_to(3), 64), {"harmonics": 3.0, **calm}, Memory())
    assert (
        accuracy.finer(Resolution(Harmonics.up_to(7), 64), {"harmonics": 4.0, **calm}, memory)[0] is not None
    )  # with few harmonics, more may help


def test_memory_is_not_modified():
    accuracy, before = Accuracy(1e-3, Resolution(Harmonics.up_to(1), 16)), Memory()
    judgements_of(accuracy, Resolution(Harmonics.up_to(9), 512), [np.ones((1, 5))], before, "finer")
    assert before.peak is None and set(before.calm.values()) == {0} and len(set(before.patience.values())) == 1


def test_the_finest_resolution_ends_the_search():
    finest = Resolution(Harmonics.up_to(31), MOST_SAMPLES)
    assert Accuracy(1e-6, finest).finer(finest, {"harmonics": 50.0, "samples": 50.0}, Memory())[0] is None


@pytest.mark.parametrize("radius", [0.5, 3.0])
def test_chord_error_of_a_circle_is_its_sagitta(radius):
    turn = 0.05
    points = radius * np.exp(1j * turn * np.arange(3))[:, None]
    chord = abs(points[1, 0] - points[0, 0])
    assert chord_error(*points, (chord, chord))[0] == pytest.approx(radius * (1 - np.cos(turn / 2)), rel=1e-2)


def test_a_significant_residual_tightens_the_tolerance_until_the_error_is_small():
    loose = Resolution(Harmonics.up_to(3), 64, 1e-4)
    tight, accuracy = replace(loose, tolerance=1e-8), Accuracy(1e-2, loose)
    nothing, significant = np.zeros((1, 5)), np.zeros((1, 5))
    significant[0, PARTS.index("solver")] = 0.2e-2
    judgements, memory = judgements_of(accuracy, loose, [nothing, significant], Memory(), "finer")
    assert judgements == [None, tight]
    judgements, memory = judgements_of(accuracy, tight, [significant], memory, "finer")
    assert judgements == [None]
    judgements, _ = judgements_of(accuracy, tight, [nothing] * 6, memory, "coarser")
    assert [resolution.tolerance for resolution in judgements] == [1e-8] * 5 + [1e-4]
    stated = Accuracy(1e-2, loose, frozenset({"solver"}))
    assert judgements_of(stated, loose, [significant], Memory(), "finer")[0] == [None]


def test_samples_may_use_the_accuracy_that_harmonics_do_not_need():
    now, error = Resolution(Harmonics.up_to(3), 64), np.zeros((1, 5))
    error[0, PARTS.index("samples")] = 0.5e-2
    accuracy = Accuracy(1e-2, now)
    assert accuracy.ratios(np.array([1.0]), error, Memory())[0]["samples"] == pytest.approx(0.5 / 0.55)
    error[0, PARTS.index("harmonics")] = 0.3e-2
    ratios, _ = accuracy.ratios(np.array([1.0]), error, Memory())
    assert ratios == {"harmonics": pytest.approx(0.75), "samples": pytest.approx(2.0), "solver": 0.0}
    assert accuracy.finer(now, ratios, Memory())[0] == Resolution(Harmonics.up_to(3), 128)
    assert [samples_from(n) for n in (64, 65, 97, 300)] == [64, 96, 128, 384]


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-5, 1e-2, 1e-1])
def test_the_part_of_the_solver_is_within_its_share_of_the_accuracy(tolerance):
    problem, estimator = problem_of("chain", 100.0)
    accuracy = Accuracy(1e-3, Resolution(Harmonics.up_to(3), 128, tolerance), frozenset({"harmonics", "samples"}))
    omegas = list(np.linspace(LOW, HIGH, 12))
    curve = solved_at(task_at(problem, AllPairs(), omegas, 1e-9, estimator, accuracy), omegas)
    assert curve.failure is None
    peak = np.abs(amplitudes(curve.points)).max()
    parts = np.array([point.error[0, PARTS.index("solver")] for point in curve.points])
    assert parts.max() <= SHARES["solver"] * 1e-3 * peak
    assert (parts.max() > 1e-8 * peak) == (tolerance < 1e-1)  # a large error at the first point tightens the tolerance at once


@pytest.mark.ranks(1, 2, 3)
def test_an_intermediate_point_has_no_error_bar_and_does_not_change_the_resolution():
    problem, estimator = problem_of("chain", 100.0)
    accuracy = Accuracy(1e-3, Resolution(Harmonics.up_to(1), 16))
    task = BranchTask(problem, AllPairs(), Sweep(560.0, HIGH), steps_for(1e-3), 1e-9, estimator, accuracy)
    workspace = Workspace(problem.equation)
    state = task.start(workspace)
    try:
        intermediate = accept(task, state, state.solver.first(), on_the_way=True)
        assert (intermediate.point.error, intermediate.state.solver.resolution) == (None, state.solver.resolution)
        regular = accept(task, state, state.solver.first())
        assert regular.point.error is not None
        assert regular.state.solver.resolution != state.solver.resolution
    finally:
        workspace.destroy()
        estimator.destroy()
