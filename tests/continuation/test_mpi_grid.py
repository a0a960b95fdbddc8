"""Solutions at given frequencies equal the points of the followed branch; on any number of ranks."""

import numpy as np
import pytest
from dense_model import branch, forced, reduced
from mpi4py import MPI
from oracles import scenes

from microslip.continuation.grid import at_frequencies, secant
from microslip.continuation.iterate import Iterate
from microslip.fourier.harmonics import Harmonics
from microslip.points.selection import AllPairs, NonStickingPairs

pytestmark = pytest.mark.ranks(1, 2)
COMM, ALL = MPI.COMM_WORLD, AllPairs()


def grid(system, level, omegas, selection=ALL, tolerance=1e-10):
    model, parameters = reduced(system, COMM, 3)
    return at_frequencies(forced(model, parameters, 128, level), selection, omegas, tolerance=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("level", [1e-3, pytest.param(10.0, marks=pytest.mark.ranks(1))])
def test_solutions_at_the_frequencies_of_a_branch_are_its_points(level):
    followed = branch(scenes.chain(), COMM, level, points=40, tolerance=1e-10)
    solved = grid(scenes.chain(), level, [point.omega for point in followed.points])
    assert solved.failure is None and len(solved.points) == len(followed.points)
    peak = max(np.abs(point.response).max() for point in followed.points)
    for a, b in zip(solved.points, followed.points):
        assert a.omega == pytest.approx(b.omega, rel=1e-14) and a.requested
        assert a.response == pytest.approx(b.response, abs=1e-8 * peak)
        assert np.array_equal(a.state, b.state)


@pytest.mark.ranks(1, 2, 3)
def test_the_order_of_the_frequencies_is_preserved_and_does_not_matter():
    low, high = scenes.chain()["omega"]
    omegas = np.linspace(low, high, 16)
    up, down = grid(scenes.chain(), 10.0, omegas), grid(scenes.chain(), 10.0, omegas[::-1])
    assert [point.omega for point in down.points] == pytest.approx(omegas[::-1], rel=1e-14)
    peak = max(np.abs(point.response).max() for point in up.points)
    for a, b in zip(up.points, down.points[::-1]):
        assert a.response == pytest.approx(b.response, abs=1e-8 * peak)


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_solutions_beyond_a_fold_lie_on_the_branch():
    system, omegas = scenes.chain(), np.linspace(*scenes.chain()["omega"], 15)
    followed = branch(system, COMM, 50.0, at=omegas, tolerance=1e-10)
    assert min(np.diff([point.omega for point in followed.points])) < -1.0  # it folds back
    solved = grid(system, 50.0, omegas)
    assert solved.failure is None and len(solved.points) == 15
    peak = max(np.abs(point.response).max() for point in followed.points)
    for point in solved.points:
        at_omega = [other for other in followed.points if other.omega == pytest.approx(point.omega, rel=1e-12)]
        assert min(np.abs(point.response - other.response).max() for other in at_omega) < 1e-7 * peak
    assert max(point.newton for point in solved.points) > 20  # a single solve of Newton's method ends after 20


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_check_within_a_point_makes_the_adaptive_selection_exact_at_given_frequencies():
    omegas = np.linspace(*scenes.chain()["omega"], 13)
    exact = grid(scenes.chain(), 20.0, omegas)
    late, checked = (grid(scenes.chain(), 20.0, omegas, NonStickingPairs(check)) for check in (False, True))
    peak = max(np.abs(point.response).max() for point in exact.points)

    def difference(solved):
        return max(np.abs(a.response - b.response).max() for a, b in zip(solved.points, exact.points)) / peak

    assert difference(checked) < 1e-8 < difference(late)


@pytest.mark.slow
def test_a_frequency_without_solution_is_named():
    solved = grid(scenes.chain(), 100.0, [500.0, 560.0], tolerance=1e-300)
    assert solved.failure is not None and "Hz" in solved.failure


def test_secant_is_not_used_for_long_or_backward_steps():
    a, b = (Iterate(np.array([u]), (omega,), Harmonics((0,))) for u, omega in ((0.0, 1.0), (1.0, 2.0)))
    assert secant(a, b, 3.0).U == pytest.approx([2.0])
    assert secant(None, b, 3.0).U == pytest.approx([1.0])
    assert secant(a, b, 4.5).U == pytest.approx([1.0])
    assert secant(a, b, 1.5).U == pytest.approx([1.0])
