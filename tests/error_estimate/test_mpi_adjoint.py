"""The adjoint of the error bars: derivatives of the outputs by parameters of the contact law, compared with differences."""

from dataclasses import replace

import numpy as np
import pytest
from dense_model import reduced
from mpi4py import MPI
from oracles import scenes

from microslip.continuation.constraint_rows import Plane, Scaling
from microslip.continuation.corrector import BorderedSystem, Corrector
from microslip.continuation.iterate import Iterate
from microslip.continuation.problems import ForcedResponse
from microslip.error_estimate.estimate import ErrorEstimator, output_amplitude
from microslip.harmonic import adjoint_solver
from microslip.harmonic.adjoint_solver import AdjointSolver
from microslip.harmonic.balance import HarmonicBalance
from microslip.harmonic.linearisation import Linearisation
from microslip.harmonic.operating_point import LawParameter, OperatingPoint
from microslip.harmonic.parameter_rates import law_rate
from microslip.receptance.truncated_modes import EnrichedModel

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
OMEGA, LEVEL = 555.0, 100.0


@pytest.mark.parametrize("name", ["mu", "N0"])
def test_the_adjoint_gives_the_derivative_of_the_outputs_by_the_law(name):
    system = scenes.chain()
    model, law = reduced(system, COMM, 3)
    base, vary = HarmonicBalance.of_all(model, law, 128), LawParameter(name, np.arange(2), system[name])

    def solved(value):
        equation = base.under(OperatingPoint(OMEGA, LEVEL, law=((vary, value),)))
        problem = ForcedResponse(equation, LEVEL)
        guess = Iterate(equation.linear_motion(problem.at((OMEGA,))), (OMEGA,), equation.harmonics)
        corrector = Corrector(COMM, equation.shape, 1e-12)
        rows = (Plane.fixed_parameter(guess),)
        correction = corrector.correct(BorderedSystem(problem, rows, Scaling(1e-4, (OMEGA,)), equation.every_pair), guess)
        corrector.destroy()
        assert correction.failure is None
        return equation, problem.at((OMEGA,)), correction.iterate.U

    def outputs(value):
        equation, at, U = solved(value)
        return output_amplitude(model, at, equation.full_force(equation.contact_forces(U, equation.every_pair, tangents=False)))

    equation, at, U = solved(1.0)
    estimator = ErrorEstimator(EnrichedModel.of_all_modes(model))
    adjoint = estimator.at(equation, U, at, equation.every_pair).adjoint
    forces = adjoint.linear.forces
    d_p = equation.full_force(replace(forces, p=law_rate(equation, forces, vary)))
    rate = equation.agreed_sum(-adjoint.chi @ d_p[equation.model.owned_rows].ravel())
    estimator.destroy()
    slope = (outputs(1.0 + 1e-5) - outputs(1.0 - 1e-5)) / 2e-5
    assert adjoint.is_solved and adjoint.tau.shape == adjoint.chi.shape
    assert np.abs(rate - slope).max() < 1e-4 * np.abs(slope).max()


def test_steps_with_one_linearisation_share_the_operands_of_their_products(monkeypatch):
    """The solutions are those of a factorisation; another linearisation has different operands."""
    system = scenes.chain()
    model, law = reduced(system, COMM, 3)
    equation = HarmonicBalance.of_all(model, law, 128)

    def linear(omega):
        at = OperatingPoint(omega, LEVEL)
        forces = equation.contact_forces(equation.linear_motion(at), equation.every_pair, tangents=True)
        return Linearisation.of(equation, at, forces)

    steps = np.random.default_rng(2).standard_normal((3, 1, 3 * model.n_pairs, model.N_H))
    at_omega, at_other = linear(OMEGA), linear(1.1 * OMEGA)
    expected = [at.solve_several(step, AdjointSolver(COMM)) for at, step in zip((at_omega, at_omega, at_other), steps)]
    made, columns = [], adjoint_solver.ActiveColumns
    monkeypatch.setattr(adjoint_solver, "ActiveColumns", lambda *of: made.append(of) or columns(*of))
    monkeypatch.setattr(adjoint_solver, "DIRECT", 0)
    solver = AdjointSolver(COMM, 1e-10, np.float64)
    solved = [at.solve_several(step, solver) for at, step in zip((at_omega, at_omega, at_other), steps)]
    solver.destroy()
    assert len(made) == 2
    for (dU, dp, is_solved), (right_dU, right_dp, _) in zip(solved, expected):
        assert is_solved and dU == pytest.approx(right_dU, rel=1e-7, abs=1e-9) and dp == pytest.approx(right_dp, rel=1e-6)
