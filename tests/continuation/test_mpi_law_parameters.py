"""Continuation over a parameter of the contact law at a fixed frequency; every test runs on any number of ranks."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from dense_model import reduced
from mpi4py import MPI
from oracles import scenes

from microslip.continuation.constraint_rows import Plane, Scaling
from microslip.continuation.corrector import BorderedSystem, Corrector
from microslip.continuation.follow import follow_branch
from microslip.continuation.iterate import Iterate
from microslip.continuation.problems import ForcedResponse, ProblemBase
from microslip.continuation.steps import ArcLength
from microslip.continuation.task import BranchTask
from microslip.harmonic.balance import HarmonicBalance
from microslip.harmonic.operating_point import LawParameter, OperatingPoint
from microslip.points.selection import AllPairs
from microslip.points.sweep import Sweep

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
OMEGA, LEVEL = 555.0, 100.0
COLUMNS = {"mu": [0.3, 0.25], "N0": [60.0, 40.0]}


@dataclass(frozen=True, eq=False)
class OverLawParameter(ProblemBase):
    """The equation at a fixed frequency and level, over a factor of a column of the law."""

    varies: LawParameter

    @property
    def law_parameters(self):
        return (self.varies,)

    def at(self, parameters):
        return OperatingPoint(OMEGA, LEVEL, law=((self.varies, parameters[0]),))

    def rates(self, parameters):
        return ({self.varies: 1.0},)


def chain():
    system = scenes.chain()
    model, law = reduced(system, COMM, 3)
    return HarmonicBalance.of_all(model, law, 128)


def over(name):
    return OverLawParameter(chain(), LawParameter(name, np.arange(2), np.array(COLUMNS[name])))


def solved(problem, guess):
    """Return the solution with the parameter of the guess."""
    corrector = Corrector(COMM, problem.equation.shape, 1e-11)
    scaling = Scaling(1e-4, guess.parameters)
    plane = Plane.fixed_parameter(guess)
    solution = corrector.correct(BorderedSystem(problem, (plane,), scaling, problem.equation.every_pair), guess)
    corrector.destroy()
    assert solution.failure is None
    return solution


@pytest.mark.parametrize("name", COLUMNS)
def test_the_branch_over_a_law_parameter_equals_solutions_of_laws_with_its_values(name):
    problem = over(name)
    values = (0.5, 0.8, 1.3)
    steps = ArcLength(ds=0.05, ds_min=1e-4, ds_max=0.1)
    curve = follow_branch(BranchTask(problem, AllPairs(), Sweep(0.4, 1.5, values), steps, 1e-10), 400)
    assert curve.failure is None
    requested = [point for point in curve.points if point.requested]
    assert len(requested) == len(values) and len(curve.points) > 10
    if COMM.rank == 0:  # forces are recorded there
        assert np.abs(requested[0].p - requested[-1].p).max() > 0.1 * np.abs(requested[-1].p).max()
    for value, point in zip(values, requested):
        law = replace(problem.equation.law, **{name: value * getattr(problem.equation.law, name)})
        other = ForcedResponse(replace(problem.equation, law=law), LEVEL)
        U = other.equation.linear_motion(other.at((OMEGA,)))
        there = solved(other, Iterate(U, (OMEGA,), other.equation.harmonics))
        p = other.equation.full_force(other.equation.contact_forces(there.iterate.U, other.equation.every_pair, False))
        if COMM.rank == 0:
            assert point.p.reshape(p.shape) == pytest.approx(p, abs=1e-6 * np.abs(p).max())
