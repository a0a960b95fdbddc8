"""Nonlinear elimination of few pairs, on any number of ranks."""

from dataclasses import replace

import numpy as np
import pytest
from dense_model import reduced
from mpi4py import MPI
from oracles import scenes

from microslip.continuation import corrector as corrector_of
from microslip.continuation.constraint_rows import Plane, Scaling
from microslip.continuation.corrector import BorderedSystem, Corrector
from microslip.continuation.iterate import Iterate
from microslip.continuation.problems import ForcedResponse
from microslip.harmonic import few_pairs
from microslip.harmonic.balance import HarmonicBalance
from microslip.harmonic.few_pairs import eliminated, with_most_of
from microslip.harmonic.operating_point import OperatingPoint

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM = MPI.COMM_WORLD  # the two-pair system leaves a third rank without pairs
AT = OperatingPoint(555.0, 100.0)


@pytest.fixture
def equation():
    system = scenes.chain()
    model, law = reduced(system, COMM, 3)
    return HarmonicBalance.of_all(model, law, 128)


@pytest.mark.parametrize("pairs", [[0], [1], [0, 1]])
def test_elimination_solves_the_rows_of_few_pairs_for_fixed_forces_of_the_others(equation, pairs):
    pairs, U = np.array(pairs), equation.linear_motion(AT) * 0.8
    forces = equation.contact_forces(U, equation.every_pair, tangents=False)
    r = equation.residual(U, AT, forces)
    V = eliminated(equation, AT, pairs, U, r)
    p = equation.full_force(forces).reshape(-1, 3, equation.model.N_H).copy()
    forces_of_V = equation.full_force(equation.contact_forces(V, equation.every_pair, tangents=False)).reshape(p.shape)
    p[pairs] = forces_of_V[pairs]
    every = np.arange(equation.model.n_pairs)
    remaining = equation.gather(equation.residual_under(V, AT, every, p.reshape(-1, equation.model.N_H)))
    before, others = equation.gather(r), np.setdiff1d(every, pairs)
    assert np.linalg.norm(remaining[pairs]) < 1e-2 * np.linalg.norm(before[pairs])
    np.testing.assert_array_equal(equation.gather(V)[others], equation.gather(U)[others])


def test_pairs_with_most_of_the_residual_are_selected(equation, monkeypatch):
    r = np.zeros((equation.model.n_pairs, *equation.shape[1:]))
    r[1], none = 1.0, np.zeros(0, dtype=int)
    assert with_most_of(equation, r[equation.model.owned], none, 2) is None  # one pair of two is not few
    monkeypatch.setattr(few_pairs, "FEW", 1)
    np.testing.assert_array_equal(with_most_of(equation, r[equation.model.owned], none, 2), [1])
    np.testing.assert_array_equal(with_most_of(equation, r[equation.model.owned], np.array([0]), 2), [0, 1])


def test_solutions_with_elimination_are_those_of_newtons_method(equation, monkeypatch):
    solutions, calls = [], []
    guess = Iterate(equation.linear_motion(AT), (AT.omega,), equation.harmonics)
    scaling = Scaling(float(np.sqrt(COMM.allreduce(np.sum(guess.U**2)))), (1.0,))
    problem = ForcedResponse(equation, AT.level)
    system = BorderedSystem(problem, (Plane.fixed_parameter(guess),), scaling, equation.every_pair)
    monkeypatch.setattr(corrector_of, "eliminated", lambda *given: calls.append(given) or eliminated(*given))
    for few, poor in ((16, 1.0), (1, 0.0)):
        monkeypatch.setattr(few_pairs, "FEW", few)
        monkeypatch.setattr(corrector_of, "POOR", poor)
        corrector = Corrector(COMM, equation.shape, 1e-11)
        solution = corrector.correct(system, replace(guess, U=guess.U.copy()))
        corrector.destroy()
        assert solution.failure is None
        solutions.append(solution.iterate.U)
    assert calls
    np.testing.assert_allclose(solutions[1], solutions[0], rtol=0.0, atol=1e-10 * scaling.U)
