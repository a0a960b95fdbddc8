"""Peaks as points of their own, against exact ones and a fine sweep; every test runs on any number of ranks."""

from types import SimpleNamespace

import numpy as np
import pytest
from dense_model import amplitude, branch, forced, reduced
from mpi4py import MPI
from oracles import scenes

from microslip.continuation.constraint_rows import Place, Scaling
from microslip.continuation.peaks import EXACT, Stationary, peaks_of
from microslip.harmonic.adjoint_solver import AdjointSolver
from microslip.harmonic.linearisation import Linearisation
from microslip.observe.level_log import peak_lines

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD


def damper():
    """Return the friction damper of Ansys' verification manual, VM320: one mass, one Jenkins element, mu N = 246.048 N."""
    return scenes.make_system(
        "friction damper",
        [[944.6]],
        [[2.4e7]],
        [[0, -1, -1, -1, -1, -1]],
        mu=1.0,
        N0=246.048,
        k_t=2.4e7,
        k_n=0.0,
        C=np.array([[7700.0]]),
        loads=[{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}],
        output=[1.0],
        omega=(150.0, 300.0),
        levels={},
    )


def peaks(system, level, H, n_samples, points=40):
    found = branch(system, COMM, level, H=H, n_samples=n_samples, points=points)
    assert found.failure is None
    return found, peaks_of(forced(*reduced(system, COMM, H), n_samples, level), found, 1e-9)


def test_the_peak_of_one_harmonic_is_met_as_samples_grow():
    """Exact with one harmonic: 1.4979492641e-5 m at 209.21110546 rad/s."""
    for n_samples in (128, 256, 1024):
        _, (peak,) = peaks(damper(), 123.024, 1, n_samples)
        assert abs(peak.amplitude) == pytest.approx(1.4979492641e-5, rel=5.0 / n_samples**2)
        assert peak.omega == pytest.approx(209.21110546, rel=0.6 / n_samples)  # the slope knows where slip ends to a sample


@pytest.mark.ranks(1)
@pytest.mark.slow
def test_peaks_are_those_of_a_fine_sweep():
    system = scenes.chain()
    for load in system["loads"]:
        load.setdefault("phase", 0.0)
    found, solved = peaks(system, 100.0, 3, 128)
    assert solved and all(peak.within < 1e-5 * peak.omega for peak in solved)
    for peak in solved:
        near = np.linspace(-1e-4, 1e-4, 9) * peak.omega + peak.omega
        fine = branch(system, COMM, 100.0, H=3, n_samples=128, points=40, at=tuple(near))
        sizes = np.array([amplitude(point) / abs(peak.amplitude) for point in fine.points if point.asked])
        beside = sizes[np.abs(sizes - 1.0) < 1e-4]  # a folded branch passes there on other parts, too
        assert len(beside) >= 5
        assert beside.max() == pytest.approx(1.0, abs=1e-8)


def test_a_linear_peak_and_its_width_are_those_of_the_oscillator():
    _, (peak,) = peaks(damper(), 1.0, 1, 128, points=100)
    omega_0, c = np.sqrt(4.8e7 / 944.6), 7700.0 / 944.6
    assert peak.omega == pytest.approx(np.sqrt(omega_0**2 - c**2 / 2.0), rel=1e-9)
    assert peak.damping == pytest.approx(c / (2.0 * omega_0), rel=1e-2)
    assert peak.slipping == 0


def test_the_gradient_of_the_constraint_is_its_derivative():
    problem = forced(*reduced(damper(), COMM, 1), 256, 123.024)
    equation, omega = problem.equation, 205.0
    solvers = AdjointSolver(COMM, EXACT, np.float64), AdjointSolver(COMM, EXACT, np.float64)
    unit, constraint = 8.0, Stationary(0, 1e-10 / 8.0, 8.0, *solvers)
    U, scaling = 1.4 * equation.linear_motion(problem.at((omega,))), Scaling(1e-5, (unit,))
    direction = np.random.default_rng(2).standard_normal(U.shape) if len(U) else np.zeros(U.shape)

    def place(h):
        at = problem.at((omega + 0.3 * unit * h,))
        there = U + scaling.U * h * direction
        forces = equation.contact_forces(there, equation.every_pair, tangents=True)
        return Place(problem.at, scaling, there, np.array([at.omega / unit]), Linearisation.of(equation, at, forces))

    n_U, n_nu = constraint.gradient(place(0.0))
    slope = COMM.allreduce(float(np.vdot(n_U, direction))) + 0.3 * n_nu[0]
    steps = 1e-3 * 0.5 ** np.arange(3)
    differences = [(constraint.value(0.0, place(h)) - constraint.value(0.0, place(-h))) / (2.0 * h) for h in steps]
    for solver in solvers:
        solver.destroy()
    assert len(place(0.0).linear.forces.active) == 1 and abs(slope) > 0.0
    assert differences == pytest.approx([slope] * 3, rel=2e-3)


def test_a_peak_that_no_solve_reaches_says_so():
    """A tolerance below rounding: the highest point of the curve comes back, and is marked."""
    found = branch(damper(), COMM, 123.024, H=1, n_samples=128, points=40)
    (peak,) = peaks_of(forced(*reduced(damper(), COMM, 1), 128, 123.024), found, 1e-30)
    assert peak.within > 1e-4 * peak.omega
    assert abs(peak.amplitude) == pytest.approx(max(amplitude(point) for point in found.points), rel=1e-6)
    assert "(within " in peak_lines(SimpleNamespace(peaks=[peak]))[0]
