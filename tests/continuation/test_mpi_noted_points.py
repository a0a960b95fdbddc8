"""Points near which the error bar detects no solution: Newton's method with more harmonics; on any number of ranks."""

import numpy as np
import pytest
from dense_model import forced, reduced
from mpi4py import MPI
from oracles import shooting
from verification.random_structures import draw

from microslip.continuation import acceptance
from microslip.continuation.grid import solved_at, task_at
from microslip.continuation.point_record import FAR
from microslip.error_estimate.estimate import ErrorEstimator
from microslip.points.error_parts import total
from microslip.points.selection import AllPairs
from microslip.receptance.truncated_modes import EnrichedModel

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
OMEGAS = [0.661356, 0.664463]  # of a structure whose pair opens: with 3 harmonics both points have far changes in (11.4)


def points_of_structure():
    """Return a random structure with pairs that open, a level, and its points with 3 harmonics."""
    system = draw(21, 35, lift_off=True)
    level = sorted(system["levels"].values())[1]
    model, law = reduced(system, COMM, 3)
    estimator = ErrorEstimator(EnrichedModel.of_all_modes(model))
    curve = solved_at(task_at(forced(model, law, 128, level), AllPairs(), OMEGAS, 1e-8, estimator), OMEGAS)
    assert curve.failure is None
    return system, level, curve.points


def test_a_point_with_a_nearby_solution_of_more_harmonics_has_its_error_and_no_note():
    system, level, (wrong, near) = points_of_structure()
    assert FAR in wrong.notes and FAR not in near.notes
    at = shooting.Point(system, level, near.omega)
    true = COMM.bcast(at.by_rule(at.state_of(near.p), 512)[0].amplitude if COMM.rank == 0 else None)
    cos_sin, size = np.array([true.real, -true.imag]), np.hypot(*near.response[0, 1:3])
    error, corrected = (np.linalg.norm(u[0] - cos_sin) for u in (near.response[:, 1:3], near.corrected))
    assert corrected < 0.5 * error < error < total(near.error)[0] < 0.1 * size
    assert corrected < near.error_corrected[0] + 1e-3 * size  # the accuracy of the time integration


def test_a_solution_with_more_harmonics_changes_the_record_of_its_point_alone(monkeypatch):
    _, _, (wrong, near) = points_of_structure()
    monkeypatch.setattr(acceptance, "with_nearby_solution", lambda solver, solution, point, estimator: point)
    _, _, (same, noted) = points_of_structure()
    np.testing.assert_array_equal(wrong.error, same.error)
    assert (wrong.response == same.response).all() and (near.response == noted.response).all()
    assert FAR in noted.notes and noted.newton < near.newton and total(near.error)[0] < 0.1 * total(noted.error)[0]
