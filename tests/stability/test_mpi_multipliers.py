"""Floquet multipliers compared with exact values and differences of integrated maps; on any number of ranks."""

import numpy as np
import pytest
from dense_model import branch, forced, reduced
from mpi4py import MPI
from oracles import scenes
from oracles.shooting import Point as Shooting
from scipy.optimize import root

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.law import ContactCycle
from microslip.continuation.branch_points import iterate_of
from microslip.fourier.coefficients import analysis_matrix, synthesis_matrix
from microslip.fourier.harmonics import Harmonics
from microslip.receptance.damping import Damping
from microslip.stability.contact_variation import contact_variation
from microslip.stability.cycle_map import CycleMap
from microslip.stability.multipliers import multipliers_at

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM = MPI.COMM_WORLD


def at_point(system, level, omega, H=15, n_samples=512, **steps):
    """Return the point of a curve at a frequency, and its multipliers."""
    system = system | {"loads": [{"phase": 0.0} | load | {"vector": np.array(load["vector"])} for load in system["loads"]]}
    curve = branch(system, COMM, level, H=H, n_samples=n_samples, at=(omega,), points=20)
    (point,) = [point for point in curve.points if point.requested]
    problem = forced(*reduced(system, COMM, H), n_samples, level)
    there = iterate_of(point, problem, Harmonics.up_to(H))
    return point, multipliers_at(problem.equation, problem.at(there.parameters), there.U, **steps)


def one_mass(**damping):
    load = {"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}
    place = {"loads": [load], "output": [1.0], "omega": (0.6, 2.0), "levels": {}}
    return scenes.make_system(
        "one", [[1.0]], [[1.0]], [[0, -1, -1, -1, -1, -1]], mu=1.0, N0=1.0, k_t=1.0, k_n=0.0, separate=True, **place, **damping
    )


@pytest.mark.ranks(1)
def test_a_jenkins_oscillator_that_slips_in_every_cycle():
    """0.34687 +- 0.27507 i, by differences of the map integrated with DOP853 (1e-13) from event to event.

    Tangents at the instant without the slider's memory give 1.76.
    """
    _, multipliers = at_point(one_mass(C=np.array([[0.02]])), 0.8, 1.25)
    assert multipliers.n_neutral == 0
    exact = 0.34687006 + 0.27506631j
    assert multipliers.values[:2] == pytest.approx(np.array([exact, exact.conjugate()]), abs=2.5e-4)
    assert multipliers.values[0] == pytest.approx(0.34678 + 0.27561j, abs=1e-3)  # the reference of the formulation
    assert np.abs(multipliers.values[2:]).max() < 1e-9  # a slider that slips in each cycle loses its initial state


def test_a_slider_that_never_slips_is_neutral():
    point, multipliers = at_point(one_mass(C=np.array([[0.02]])), 0.02, 1.25)
    exact = np.exp(np.roots([1.0, 0.02, 2.0]) * 2.0 * np.pi / point.omega)
    assert multipliers.n_neutral == 1
    assert np.allclose(np.sort_complex(multipliers.values[:2]), np.sort_complex(exact), atol=1e-12)


@pytest.mark.parametrize("name, regime", [("spatial", "lift-off"), pytest.param("chain", "gross", marks=pytest.mark.ranks(1))])
def test_multipliers_agree_with_the_map_of_an_independent_integration(name, regime):
    system = scenes.SCENES[name]()
    level, omega, _ = system["levels"][regime]
    _, multipliers = at_point(system, level, omega, H=9, n_samples=128)
    values = None
    if COMM.rank == 0:
        shooting = Shooting(system, level, omega)
        steady = shooting.steady(np.zeros(2 * shooting.n + 2 * shooting.m), 1024)
        values = np.linalg.eigvals(shooting.derivative(steady.x, 1024) + np.eye(len(steady.x)))
    values = COMM.bcast(values)
    values = np.abs(values[np.argsort(-np.abs(values))][:4])
    assert np.abs(multipliers.values[:4]) == pytest.approx(values, abs=5e-3)


def test_sliders_that_never_slip_in_one_direction_are_excluded():
    """Of 120 pairs with a limit for each direction only x slips: the memory of y has the multiplier 1, which is not one of them."""
    n, m = 120, 3
    law = ElasticCoulomb(*np.ones((4, n)), np.ones(n, dtype=bool))
    U = np.zeros((n, 3, 3))
    U[:, 0, 1], U[:, 1, 2] = np.linspace(1.1, 3.0, n), 0.5
    R_phi = 0.05 * np.random.default_rng(2).standard_normal((3 * n, m))
    contact = contact_variation(law, np.arange(n), U, Harmonics.up_to(1), 32, 4)
    cycle = CycleMap(1.0, np.array([0.7, 1.3, 2.1]), Damping(np.full(m, 0.3)), R_phi, 0.3 * np.eye(3 * n), contact)
    moving = np.append(np.full(2 * m, True), np.tile([True, False], n))
    unit = np.eye(2 * m + cycle.n_memory)[:, moving]
    x, memory = cycle.apply(unit[: 2 * m].reshape(2, m, -1), unit[2 * m :])
    exact = np.sort(np.abs(np.linalg.eigvals(np.vstack([x.reshape(2 * m, -1), memory])[moving])))[::-1]
    assert 0.1 < exact[0] < 0.9
    assert np.abs(cycle.multipliers()) == pytest.approx(exact[:6], abs=1e-6)


def test_sliders_that_the_modes_do_not_excite_have_multipliers():
    """Four of 80 pairs with memory have no modal motion and slip little: their multipliers are just below 1."""
    n, n_not_excited, m = 80, 4, 3
    law = ElasticCoulomb(*np.ones((4, n)), np.zeros(n, dtype=bool))
    U, R_phi = np.zeros((n, 3, 3)), 0.05 * np.random.default_rng(1).standard_normal((3 * n, m))
    U[:, 0, 1], U[:, 1, 2] = 3.0, 2.0
    U[-n_not_excited:, 0, 1], U[-n_not_excited:, 1, 2], R_phi[-3 * n_not_excited :] = (
        1.0 + 0.01 * np.arange(1, 1 + n_not_excited),
        0.0,
        0.0,
    )
    contact = contact_variation(law, np.arange(n), U, Harmonics.up_to(1), 32, 4)
    cycle = CycleMap(1.0, np.array([0.7, 1.3, 2.1]), Damping(np.full(m, 0.3)), R_phi, 0.3 * np.eye(3 * n), contact)
    unit = np.eye(2 * m + cycle.n_memory)
    x, memory = cycle.apply(unit[: 2 * m].reshape(2, m, -1), unit[2 * m :])
    exact = np.linalg.eigvals(np.vstack([x.reshape(2 * m, -1), memory]))
    exact = np.sort(np.abs(exact))[::-1]
    assert (0.8 < exact[1 : 1 + n_not_excited]).all() and exact[2 + n_not_excited] < 0.5
    assert np.abs(cycle.multipliers()) == pytest.approx(exact[:6], abs=1e-6)


class Cubic:
    """A spring of force k x^3 parallel to the pairs, without memory.  Its cycle returns which pairs have it."""

    n_memory, order, elements_order = 0, 2, 0

    def __init__(self, k):
        self.k, self.n_pairs = k, len(k)
        self.stiffness = self.springs = np.zeros((self.n_pairs, 3))
        none = np.zeros(0)
        self.sliders = ElasticCoulomb(none, none, none, none, none.astype(bool)).sliders

    def take(self, indices):
        return Cubic(self.k[indices])

    def cycle(self, U, n_samples, tangents=True, harmonics=None):
        E, F = synthesis_matrix(harmonics, n_samples), analysis_matrix(harmonics, n_samples)
        p = np.zeros_like(U)
        p[:, 0] = self.k[:, None] * (U[:, 0] @ E.T) ** 3 @ F.T
        everything = np.arange(len(U))
        return ContactCycle(p, np.ones(len(U), np.uint8), everything, None, np.zeros(len(U), bool))

    def memoryless_rate(self, du):
        rate = np.zeros(du.shape)
        rate[..., 0] = 3.0 * self.k * du[..., 0] ** 2
        return rate


def test_multipliers_of_duffings_equation_to_1e_7():
    """x'' + 0.1 x' + x + 0.2 x^3 = 3 cos 0.8 t: 0.4642564, 0.9820826."""
    harmonics = Harmonics.up_to(25)
    system = one_mass(C=np.array([[0.1]])) | {"k_t": np.zeros(1)}
    problem = forced(reduced(system, COMM, harmonics)[0], Cubic(np.array([0.2])), 256, 3.0)
    at = problem.at((0.8,))
    n = np.repeat(np.arange(26), 2)[1:]
    E, F = synthesis_matrix(harmonics, 256), analysis_matrix(harmonics, 256)
    load = np.zeros(51)
    load[1] = 3.0

    def residual(x):
        turned = np.zeros(51)
        turned[1::2], turned[2::2] = x[2::2], -x[1::2]
        return (1.0 - (0.8 * n) ** 2) * x + 0.1 * 0.8 * n * turned + 0.2 * F @ (E @ x) ** 3 - load

    x = root(residual, load / 0.4, tol=1e-13).x
    U = np.zeros((1, 3, 51))
    U[0, 0] = x
    U = U[problem.equation.model.owned]
    coarse, fine, finest = (
        np.sort(multipliers_at(problem.equation, at, U, n_steps, 1).values[:2].real) for n_steps in (128, 256, 512)
    )
    once, twice = (4.0 * fine - coarse) / 3.0, (4.0 * finest - fine) / 3.0
    assert (16.0 * twice - once) / 15.0 == pytest.approx([0.4642564, 0.9820826], abs=1e-7)
    assert np.abs(finest - twice).max() < 0.26 * np.abs(fine - once).max()  # of second order


@pytest.mark.ranks(1)
@pytest.mark.parametrize("n_within", [7, 8])
def test_map_of_a_slider_that_sticks_after_contact(n_within):
    """The pair is open while 2 cos t > 1; at contact the slider is where the pair is, at an instant that shifts with du_z."""
    U = np.zeros((1, 3, 3))
    U[0, 0, 2], U[0, 2, 1] = 0.5, 2.0
    law = ElasticCoulomb(*np.ones((4, 1)), np.zeros(1, dtype=bool))
    contact = contact_variation(law, np.arange(1), U, Harmonics.up_to(1), 128, n_within)
    p_t = np.zeros((2, 3))  # for a constant change of each component of the motion
    for step in range(64):
        motion = contact.by_first[0, step, 0] + contact.by_last[0, step, 0]
        p_t = contact.by_memory[0, step, 0] @ p_t + motion
    v_x, v_z = 0.5 * np.cos(np.pi / 3.0), -2.0 * np.sin(np.pi / 3.0)
    assert p_t == pytest.approx(np.array([[-1.0, 0.0, v_x / v_z], [0.0, -1.0, 0.0]]), abs=1e-4)
