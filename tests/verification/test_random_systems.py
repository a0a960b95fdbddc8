"""Error bars of a few random structures compared with time integration; random_systems.py runs any number of structures."""

from dataclasses import replace

import numpy as np
import pytest
from oracles import shooting
from verification import random_systems
from verification.random_structures import draw, kinds

from microslip.continuation.point_record import FAR

SYSTEMS = (3, 7, 9)


def judged():
    """Return points of three structures with 3 harmonics and 128 samples, in which a pair slips or opens."""
    outcomes = [random_systems.solve(1, number, 3, {"points": 20}) for number in SYSTEMS]
    assert not [failure for result in outcomes for failure in result.failures]
    return [result for result in random_systems.judge(outcomes, steps=1024) if any(result.state)]


@pytest.mark.study
def test_error_bars_are_valid_and_a_tenth_of_them_would_not_be():
    """Shorter error bars fail: their length is meaningful.  One test, because parallel processes would repeat the points."""
    points = judged()
    by_key = {kind for result in points for kind in result.kinds}
    assert len(points) >= 20 and {"circle", "separate", "varying normal force", "gap", "opens", "drifts"} <= by_key
    assert all(result.is_steady for result in points) and max(result.own for result in points) < 1e-3
    assert np.mean([result.holds for result in points]) >= 0.95
    assert np.mean([replace(result, bar=0.1 * result.bar).holds for result in points]) < 0.8


@pytest.mark.study
def test_errors_above_a_hundredth_of_the_peak_are_within_their_error_bars():
    computed = random_systems.judge([random_systems.solve(1, 3, 6, {})], steps=512)
    assert all(result.holds for result in computed if result.error > 1e-2 and "beside a fold" not in result.kinds)


@pytest.mark.study
def test_points_that_solve_only_the_truncated_equations_are_noted_with_valid_error_bars():
    """A branch with 2 harmonics passes frequencies twice that have one true solution: one point is wrong by more than the peak."""
    outcome = random_systems.solve(8, 9, 9, {"harmonics": 2})
    noted = [i for i, result in enumerate(outcome.judged) if FAR in result.notes]
    names = ("judged", "cases", "forces", "amplitudes", "means", "peaks")
    few = replace(outcome, **{name: [getattr(outcome, name)[i] for i in noted] for name in names})
    points = [result for result in random_systems.judge([few], steps=512) if result.is_steady]
    assert len(points) >= 4 and max(result.error for result in points) > 0.5
    assert all(result.error > 0.02 and result.holds for result in points), [(result.error, result.bar) for result in points]


@pytest.mark.study
def test_near_a_fold_the_nearest_steady_state_is_compared():
    """Integration from a motion of 3 harmonics leaves the nearby solution for one 17 % of the peak away; from 15 it does not."""
    system, omega, outcome = draw(21, 25, True), 1.7816905098116933, random_systems.Computed()
    level = max(system["levels"].values())
    (branch,) = random_systems.followed(system, [level], {"harmonics": 3, "at": [omega]})
    peak = max(float(np.hypot(*point.response[0, 1:3])) for point in branch.points)
    for point in branch.points:
        if abs(point.omega / omega - 1.0) < 1e-9:
            random_systems.keep(outcome, 25, system, level, point, peak)
    away = [i for i, result in enumerate(random_systems.judge([outcome], steps=512)) if result.error > 0.1]
    assert len(away) == 1 and outcome.judged[away[0]].is_steady
    random_systems.judge_from_more(outcome, away[0], steps=512)
    result = outcome.judged[away[0]]
    assert result.is_steady and result.error < result.bar < 0.05 and "beside a fold" in result.kinds


@pytest.mark.study
def test_a_wrong_point_is_detected():
    """An amplitude wrong by one percent lies beyond its error bar where more harmonics have made the bar short."""
    outcome = random_systems.solve(1, 7, 3, {"harmonics": 15, "samples": 512})
    wrong = replace(outcome, amplitudes=[1.01 * amplitude for amplitude in outcome.amplitudes])
    assert np.mean([result.holds for result in random_systems.judge([wrong], steps=512)]) < 0.2


def test_equal_seeds_draw_equal_structures():
    a, b = draw(2, 5), draw(2, 5)
    assert np.array_equal(a["K"], b["K"]) and a["levels"] == b["levels"] and kinds(a) == kinds(b)
    assert not np.array_equal(draw(2, 6)["mu"], a["mu"])


def test_sliders_of_a_stuck_structure_do_not_move_in_time_integration():
    system = draw(1, 3)
    point = shooting.Point(system, 1e-6, 0.5)
    assert not point.steady(np.zeros(2 * point.n + 2 * point.m), 64).moved.any()
