"""A constraint of the linearisation: the amplitude of an output is prescribed, and the level follows from it."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from dense_model import amplitude, branch, reduced
from mpi4py import MPI
from oracles import scenes

from microslip.continuation.constraint_rows import Plane, Scaling
from microslip.continuation.corrector import BorderedSystem, Corrector
from microslip.continuation.iterate import Iterate
from microslip.continuation.output_rates import rate_along
from microslip.continuation.problems import ProblemBase
from microslip.error_estimate.estimate import output_amplitude, sensitivity
from microslip.harmonic.balance import HarmonicBalance
from microslip.harmonic.operating_point import OperatingPoint

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
OMEGA, LEVEL = 555.0, 100.0


@dataclass(frozen=True, eq=False)
class OverLevelAndFrequency(ProblemBase):
    """The equation over the level and the frequency."""

    def at(self, parameters):
        return OperatingPoint(level=parameters[0], omega=parameters[1])

    def rates(self, parameters):
        return {"level": 1.0}, {"omega": 1.0}


@dataclass(frozen=True, eq=False)
class PrescribedAmplitude:
    """The constraint |a|^2 / A^2 = 1 on the only output: it depends on its forces, not on the motion alone."""

    problem: OverLevelAndFrequency
    A: float
    takes_linearisation: ClassVar[bool] = True

    def of_motion(self, U, scaling):
        return 0.0

    def output(self, place, nu):
        linear, at = place.linear, self.problem.at(tuple(nu * place.scaling.parameters))
        return output_amplitude(linear.equation.model, at, linear.equation.full_force(linear.forces))

    def value(self, of_motion, place):
        a = self.output(place, place.nu)
        return a @ a / self.A**2 - 1.0

    def gradient(self, place):
        linear, a = place.linear, self.output(place, place.nu)
        model, active = linear.equation.model, linear.forces.active_owned
        by_forces = -np.tensordot(a, sensitivity(model, linear.at.omega)[:, model.owned_rows], 1).reshape(linear.equation.shape)
        n_U = np.zeros(linear.equation.shape)
        of_active = by_forces[active].reshape(len(active), -1)
        n_U[active] = np.einsum("mi,mij->mj", of_active, linear.P).reshape(len(active), *n_U.shape[1:])
        n_nu = [a @ rate_along(lambda d: self.output(place, place.nu + d), e) for e in np.eye(len(place.nu))]
        return 2.0 * place.scaling.U / self.A**2 * n_U, 2.0 / self.A**2 * np.array(n_nu)


def test_the_level_of_a_prescribed_amplitude_is_that_of_the_curve():
    system = scenes.chain()
    (point,) = (p for p in branch(system, COMM, LEVEL, at=(OMEGA,), tolerance=1e-11).points if p.requested)
    model, law = reduced(system, COMM, 3)
    problem = OverLevelAndFrequency(HarmonicBalance.of_all(model, law, 128))
    U = COMM.bcast(point.U if COMM.rank == 0 else None)[model.owned]
    guess = Iterate(0.98 * U, (0.97 * LEVEL, OMEGA), model.harmonics)
    rows = Plane(guess, np.zeros_like(guess.U), (0.0, 1.0)), PrescribedAmplitude(problem, amplitude(point))
    corrector = Corrector(COMM, problem.equation.shape, 1e-10, n_parameters=2)
    size = float(np.sqrt(COMM.allreduce(np.vdot(U, U))))
    solution = corrector.correct(BorderedSystem(problem, rows, Scaling(size, (LEVEL, OMEGA)), problem.equation.every_pair), guess)
    corrector.destroy()
    assert solution.failure is None and (point.state != 0).any()
    assert solution.newton <= 6  # the gradient is exact
    assert solution.iterate.parameters == pytest.approx((LEVEL, OMEGA), rel=1e-7)
