"""Joints much stiffer than their structure, motions much smaller than the previous point, gaps much wider than the motion.

Every test runs on any number of ranks; the single pair leaves ranks without one.
"""

import numpy as np
import pytest
from dense_model import branch, forced, reduced
from mpi4py import MPI
from oracles import point_check
from verification import extreme_structures as structures

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.continuation import acceptance, point_solver
from microslip.continuation.corrector import row_weights
from microslip.continuation.follow import follow_branch
from microslip.continuation.point_record import HELD
from microslip.continuation.steps import ArcLength
from microslip.continuation.task import BranchTask
from microslip.harmonic.linearisation import Linearisation
from microslip.harmonic.mean_slip import is_held_by_its_joint_alone
from microslip.harmonic.operating_point import OperatingPoint
from microslip.harmonic.whole_inverse import WholeInverse
from microslip.messages.errors import CaseError
from microslip.points.selection import AllPairs
from microslip.points.sweep import Sweep

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD


def worst(system, curve, name):
    """Return the largest error of a kind over the points of a branch, on every rank; rank 0 has the motions."""
    judge, (output,) = point_check.Judge(system, 3, 128), np.flatnonzero(system["output"])
    verdicts = judge.verdicts(curve.points, curve.level, [output]) if COMM.rank == 0 else []
    return COMM.bcast(max((getattr(verdict, name) for verdict in verdicts), default=0.0))


@pytest.mark.slow
@pytest.mark.ranks(1, 2)
def test_contact_forces_of_a_stiff_joint_are_accurate():
    system = structures.spatial(k_t=1e-3, k_n=1e5)
    curve = branch(system, COMM, 1.3, low=0.85, high=1.1, points=20, tolerance=1e-8)
    assert curve.failure is None and {1, 2} & set(np.concatenate([point.state for point in curve.points]))
    assert worst(system, curve, "force") < 1e-5


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_contact_forces_without_row_weights_are_rejected(monkeypatch):
    monkeypatch.setattr(point_solver, "row_weights", lambda k, size, force, tolerance: np.ones_like(k))
    system = structures.spatial(k_t=1e-3, k_n=1e5)
    curve = branch(system, COMM, 1.3, low=0.85, high=1.1, points=20, tolerance=1e-8)
    assert "contact forces of" in curve.failure and "are rounding errors of a motion" in curve.failure
    assert worst(system, curve, "force") < 1e-5
    monkeypatch.setattr(acceptance, "UNBALANCED", np.inf)
    unchecked = branch(system, COMM, 1.3, low=0.85, high=1.1, points=20, tolerance=1e-8)
    assert worst(system, unchecked, "force") > 1e-5


def test_row_weights_are_1_for_a_joint_as_stiff_as_its_structure():
    assert row_weights(np.array([1.0, 50.0]), 2.0, 1.0, 1e-8) == pytest.approx([1.0, 1.0])
    assert row_weights(np.array([1e4, 1e30, 0.0]), 2.0, 1.0, 1e-8) == pytest.approx([200.0, 1e-10 / np.finfo(float).eps, 1.0])


@pytest.mark.slow
@pytest.mark.ranks(1)
def test_a_motion_that_shrinks_a_thousandfold_in_a_step_is_solved_relative_to_its_size():
    system = structures.two_masses(zeta=1e-6)
    curve = branch(system, COMM, 3.0, low=0.7, high=2.0, points=20, tolerance=1e-8)
    assert worst(system, curve, "motion") < 1e-7


def test_a_wide_gap_does_not_reduce_the_accuracy():
    """The force p of an open pair is -k_n du_z, however wide the gap."""
    law = ElasticCoulomb(*np.array([[0.3], [-1e9], [1.0], [2.0]]), np.array([False]))
    U = np.array([[[0.0, 1e-3, 0.0], [0.0, 0.0, 0.0], [1e-4, 1e-3, 2e-3]]])
    cycle = law.cycle(U, 16)
    assert cycle.p[0, 2] == pytest.approx(-2.0 * U[0, 2], rel=1e-12)
    assert cycle.P[0, 6:, 6:] == pytest.approx(-2.0 * np.eye(3), abs=1e-12)


@pytest.mark.parametrize("system, is_free", [(structures.spatial(k_t=1e5), False), (structures.free_body(), True)])
def test_only_a_body_without_other_supports_is_held_by_springs(system, is_free):
    model, parameters = reduced(system, COMM, 1)
    equation = forced(model, parameters, 16, 1.0).equation
    assert is_held_by_its_joint_alone(equation.model, equation.law) is is_free


@pytest.mark.ranks(1)
@pytest.mark.slow
def test_the_first_point_of_a_body_on_its_joint_alone_may_slip_everywhere():
    system = structures.free_body(rayleigh=(0.8, 0.0))
    system = {**system, "C": 0.8 * system["M"]}
    curve = branch(system, COMM, 17.0, low=0.8, high=1.2, points=20)
    assert curve.failure is None and HELD in curve.points[0].notes and (curve.points[0].state == 1).all()


@pytest.mark.ranks(1)
def test_the_branch_of_a_body_on_one_pair_continues_when_the_pair_slips():
    curve = branch(structures.free_body(n_pairs=1), COMM, 0.06, low=0.62, high=0.7, points=6, tolerance=1e-8)
    sticks = [not point.state.any() for point in curve.points]
    assert curve.failure is None and sticks[0] and not all(sticks)
    assert all(HELD in point.notes for point, stuck in zip(curve.points, sticks) if not stuck)


@pytest.mark.filterwarnings("error")
def test_resonance_without_damping_is_reported():
    """By one message, without warnings of NumPy on the infinite response."""
    system = structures.coincident(2, zeta=0.0, k_t=3.0)  # omega_n = 2, the same to the last bit
    model, parameters = reduced(system, COMM, 3)
    assert model.omega_n == pytest.approx(2.0)
    with pytest.raises(CaseError, match="no damping"):
        branch(system, COMM, 0.1, low=float(model.omega_n[0]), high=3.0)
    problem = forced(model, parameters, 64, 0.1)
    sweep = Sweep(float(model.omega_n[0]), 3.0)
    steps = ArcLength(ds=0.1, ds_min=1e-3, ds_max=0.2)
    curve = follow_branch(BranchTask(problem, AllPairs(), sweep, steps, 1e-8), 10)
    assert "resonates without damping" in curve.failure and not curve.points


@pytest.mark.ranks(1, 2, 3)
def test_whole_inverse_is_the_inverse():
    system = structures.chain(N0=0.1)
    model, parameters = reduced(system, COMM, 3)
    equation, at = forced(model, parameters, 64, 1.0).equation, OperatingPoint(0.5, 1.0)
    U = equation.linear_motion(at)
    forces = equation.contact_forces(3.0 * U, equation.every_pair, tangents=True)
    assert len(forces.active) == 2
    linear = Linearisation.of(equation, at, forces)
    inverse = WholeInverse(linear)
    x = np.random.default_rng(COMM.rank).standard_normal(U.shape)
    dp = linear.pair_forces(x[forces.active_owned]).reshape(-1, 7)
    product = x + linear.G.apply(equation.gather(dp))
    assert inverse.apply(product) == pytest.approx(x, abs=1e-9)
