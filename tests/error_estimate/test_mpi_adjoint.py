"""The adjoint that error bars leave behind: derivatives of the outputs by numbers of the contact law, against differences."""

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
from microslip.harmonic.balance import HarmonicBalance
from microslip.harmonic.operating_point import LawParameter, OperatingPoint
from microslip.receptance.truncated_modes import EnrichedModel

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
OMEGA, LEVEL = 555.0, 100.0


@pytest.mark.parametrize("name", ["mu", "N0"])
def test_it_gives_the_derivative_of_the_outputs_by_the_law(name):
    system = scenes.chain()
    for load in system["loads"]:
        load.setdefault("phase", 0.0)
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
    rate = adjoint.by_law(vary)
    estimator.destroy()
    slope = (outputs(1.0 + 1e-5) - outputs(1.0 - 1e-5)) / 2e-5
    assert adjoint.is_found and adjoint.tau.shape == adjoint.chi.shape
    assert np.abs(rate - slope).max() < 1e-4 * np.abs(slope).max()
    with pytest.raises(ValueError, match="changes the structure"):
        adjoint.by_law(LawParameter("k_t", np.arange(2), system["k_t"]))
