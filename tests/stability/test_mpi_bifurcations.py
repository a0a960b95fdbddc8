"""Folds and stability along a curve with two states, a mass that strikes a stop; every test runs on any number of ranks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dense_model import branch, forced, reduced
from mpi4py import MPI
from oracles import scenes
from oracles.shooting import Point as Shooting

import microslip
from microslip.continuation.bifurcations import bifurcations_of, kind_of
from microslip.continuation.branch_points import iterate_of
from microslip.continuation.point_record import DOUBTFUL, with_stability
from microslip.fourier.harmonics import Harmonics
from microslip.points.bifurcation import FOLD, NEIMARK_SACKER, PERIOD_DOUBLING
from microslip.points.multipliers import is_stable

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
H, N_SAMPLES, LEVEL = 5, 64, 0.2
SCENE = Path(__file__).parents[2] / "jobs" / "stop.toml"
FURTHER = (15, 512, 3e-3), (31, 1024, 6e-4)


def curve_with(points):
    """Return the curve of a mass with a stop for some requested points, with multipliers; its system and problem."""
    system = scenes.gap_mass()
    loads = [{"phase": 0.0} | load | {"vector": np.array(load["vector"])} for load in system["loads"]]
    system = system | {"loads": loads}
    followed = branch(system, COMM, LEVEL, low=1.05, high=1.4, H=H, n_samples=N_SAMPLES, points=points)
    problem = forced(*reduced(system, COMM, H), N_SAMPLES, LEVEL)
    followed.points = [
        with_stability(problem, iterate_of(point, problem, Harmonics.up_to(H)), point) for point in followed.points
    ]
    return system, followed, problem


@pytest.fixture(scope="module")
def curve():
    """Return the curve of 12 requested points, its bifurcations and its system."""
    system, followed, problem = curve_with(12)
    return system, followed, bifurcations_of(problem, followed, 1e-9)


def test_a_bifurcation_that_a_later_segment_passes_again_is_listed_once(curve):
    """With other points of the curve, as of a segment with shorter steps."""
    _, followed, bifurcations = curve
    _, again, problem = curve_with(17)
    both = replace(followed, points=[*followed.points, *(replace(point, segment=2) for point in again.points)])
    assert len(bifurcations) >= 2 and len(bifurcations_of(problem, again, 1e-9)) == len(bifurcations)
    listed = bifurcations_of(problem, both, 1e-9)
    assert [each.after for each in listed] == [each.after for each in bifurcations]


@pytest.mark.study
@pytest.mark.ranks(1)
def test_folds_are_where_the_frequency_turns(curve):
    _, followed, bifurcations = curve
    omega = np.array([point.omega for point in followed.points])
    folds = [there for there in bifurcations if there.kind == FOLD]
    assert len(folds) == 2
    for fold in folds:
        i = fold.after
        assert abs(fold.multiplier - 1.0) < 0.07  # few harmonics
        assert fold.within <= 1e-9 * fold.omega
        is_maximum = omega[i] > omega[i - 1]
        beyond = omega[i - 1 : i + 3].max() - fold.omega if is_maximum else fold.omega - omega[i - 1 : i + 3].min()
        assert beyond < 1e-9  # no point of the curve lies beyond


@pytest.mark.ranks(1)
@pytest.mark.parametrize(
    ("harmonics", "samples", "most"),
    [(3, 128, 9e-2), (7, 256, 1.2e-2), *(pytest.param(*of, marks=pytest.mark.study) for of in FURTHER)],
)
def test_the_multiplier_at_a_fold_converges_to_1_with_the_harmonics(harmonics, samples, most):
    """The multiplier at the fold of the truncated equations, for both folds of jobs/stop.toml, also from below.

    Between them the motion is unstable: points that appear stable with few harmonics have a note.
    """
    with microslip.build(microslip.read(SCENE), COMM) as structure:
        keys = {"frequencies": (0.18, 0.21), "levels": [0.2], "stability": True, "points": 12}
        curve = microslip.respond(structure, harmonics=harmonics, samples=samples, **keys).level(0.2)
    folds = [each for each in curve.bifurcations if each.kind == FOLD]
    away = [abs(each.multiplier - 1.0) for each in folds]
    print(f"{harmonics} harmonics, {samples} samples: multiplier less 1 at the folds {', '.join(f'{each:.1e}' for each in away)}")
    assert len(away) == 2 and 0.2 * most < max(away) < most
    between = slice(folds[0].after + 2, folds[1].after)
    missed = [DOUBTFUL in notes for notes, stable in zip(curve.notes[between], curve.stable[between]) if stable]
    assert all(missed) and (missed or harmonics > 3)
    assert sum(DOUBTFUL in notes for notes in curve.notes) <= len(missed) + 1


@pytest.mark.ranks(1)
def test_the_curve_is_unstable_between_its_folds(curve):
    _, followed, bifurcations = curve
    first, last = (there.after for there in bifurcations if there.kind == FOLD)
    stable = [is_stable(point.multipliers) for point in followed.points]
    assert not any(stable[first + 2 : last])
    assert all(stable[:first])
    assert all(stable[last + 2 :])


@pytest.mark.ranks(1)
def test_stability_agrees_with_an_independent_integration(curve):
    system, followed, _ = curve
    if COMM.rank != 0:
        return
    judged = 0
    unstable = [point for point in followed.points if not is_stable(point.multipliers)]
    for point in (*followed.points[1::6], min(unstable, key=lambda point: abs(np.hypot(*point.multipliers[0]) - 1.05))):
        shooting, u = Shooting(system, LEVEL, point.omega), point.U[0]  # the mass is the pair
        n, lin = np.arange(1, H + 1), shooting.U
        begin = u[:, 0] + u[:, 1::2].sum(axis=1) - lin[:, 0] - lin[:, 1] - lin[:, 3]
        rate = point.omega * (u[:, 2::2] @ n - lin[:, 2] - 2.0 * lin[:, 4])
        p_t = -system["k_t"][0] * (u[:, 0] + u[:, 1::2].sum(axis=1))[:2]
        steady = shooting.steady(np.concatenate([begin, rate, p_t]), 1024)
        largest = np.abs(np.linalg.eigvals(shooting.derivative(steady.x, 1024) + np.eye(len(steady.x)))).max()
        assert shooting.forgets(steady.x, 1024, np.random.default_rng(0)) == (largest < 1.0)  # also if another motion is near
        if abs(largest - 1.0) > 0.05 and abs(steady.amplitude) == pytest.approx(np.hypot(*point.response[0, 1:3]), rel=0.03):
            assert (largest < 1.0) == is_stable(point.multipliers), point.omega
            judged += 1
    assert judged >= 4


def test_kinds_of_bifurcations():
    assert kind_of(-1.0 + 1e-9j) == PERIOD_DOUBLING
    assert kind_of(0.6 + 0.8j) == NEIMARK_SACKER
