"""Iterations and marches of the corrector; every test runs on any number of ranks."""

import dataclasses

import numpy as np
import pytest
from dense_model import forced, reduced
from mpi4py import MPI
from oracles import scenes
from petsc4py import PETSc

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.continuation.constraint_rows import Plane, Scaling
from microslip.continuation.corrector import BorderedSystem, Corrector
from microslip.continuation.iterate import Iterate
from microslip.harmonic.newton_solver import NewtonSolver

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
OMEGA = 1.1


def jenkins():
    """Return the system of a point in gross slip and its linear motion."""
    problem = forced(*reduced(scenes.jenkins_mass(), COMM, 1), 256, 0.8)
    guess = Iterate(problem.equation.linear_motion(problem.at((OMEGA,))), (OMEGA,), problem.equation.harmonics)
    size = COMM.allreduce(float(np.vdot(guess.U, guess.U))) ** 0.5
    system = BorderedSystem(problem, (Plane.fixed_parameter(guess),), Scaling(size, (1.0,)), problem.equation.every_pair)
    return system, guess


def test_iterations_of_a_repeated_solve_are_those_of_all_runs(monkeypatch):
    """The third Newton step of the first run fails: a second run with a preconditioner follows."""
    system, guess = jenkins()
    corrector = Corrector(COMM, guess.U.shape, 1e-10)
    undisturbed = corrector.correct(system, guess)
    assert undisturbed.failure is None and undisturbed.newton > 2
    steps, solve = [], corrector.newton_solver.solve

    def failing(*of):
        steps.append(solve(*of))
        failed = PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT
        return dataclasses.replace(steps[-1], reason=failed) if len(steps) == 3 else steps[-1]

    monkeypatch.setattr(corrector.newton_solver, "solve", failing)
    repeated = corrector.correct(system, guess)
    corrector.destroy()
    assert repeated.failure is None
    assert repeated.newton == undisturbed.newton + 2
    assert repeated.krylov == sum(step.iterations for step in steps)
    assert repeated.iterate.U == pytest.approx(undisturbed.iterate.U, abs=1e-9 * system.scaling.U)


def test_a_motion_is_marched_once_for_forces_and_derivatives(monkeypatch):
    """The derivatives of the contact forces come from the march of the residual, but at most once from a second one."""
    system, guess = jenkins()
    corrector, motions, cycle = Corrector(COMM, guess.U.shape, 1e-10), [], ElasticCoulomb.cycle

    def counted(law, U, *of, **more):
        motions.append(U.tobytes())
        return cycle(law, U, *of, **more)

    monkeypatch.setattr(ElasticCoulomb, "cycle", counted)
    correction = corrector.correct(system, guess)
    corrector.destroy()
    assert correction.failure is None and correction.newton > 2
    assert len(motions) - len(set(motions)) <= 1 or not system.equation.n_owned


@pytest.mark.parametrize("error, is_repeated", [(1e-3, False), (0.1, True)])
def test_a_failed_solve_in_single_precision_is_repeated_if_its_newton_systems_were_not_solved(monkeypatch, error, is_repeated):
    """It is repeated in double precision; the residual of the last system decides whether that system was solved."""
    system, guess = jenkins()
    corrector = Corrector(COMM, guess.U.shape, 1e-10)
    solve, in_double = corrector.newton_solver.solve, []

    def rough(at, b_U, b_nu, border, exactness):
        in_double.append(exactness.in_double)
        step = solve(at, b_U, b_nu, border, exactness)
        return dataclasses.replace(step, d_xi=0.0 * step.d_xi, d_nu_owned=0.0 * b_nu, product=(1.0 - error) * b_U)

    monkeypatch.setattr(NewtonSolver, "is_single", property(lambda solver: not in_double[-1]))
    monkeypatch.setattr(corrector.newton_solver, "solve", rough)
    correction = corrector.correct(system, guess)
    corrector.destroy()
    assert correction.failure is not None and not in_double[0]
    assert in_double[-1] is is_repeated
