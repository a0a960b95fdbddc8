"""Several solutions at a frequency: deflation against the roots of Duffing's amplitude equation, and a mass with a stop."""

from types import SimpleNamespace

import numpy as np
import pytest
from dense_model import amplitude, branch, forced, reduced
from mpi4py import MPI
from oracles import scenes

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.law import ContactCycle
from microslip.continuation.branch_points import iterate_of
from microslip.continuation.follow import follow_branch
from microslip.continuation.other_solutions import _Search, continued, over_level
from microslip.continuation.point_solver import PointSolver, Workspace
from microslip.continuation.steps import ArcLength
from microslip.continuation.task import BranchTask
from microslip.fourier.coefficients import analysis_matrix, synthesis_matrix
from microslip.fourier.harmonics import Harmonics
from microslip.points.selection import AllPairs
from microslip.points.sweep import Sweep

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD


class OddPowers:
    """A spring of force k x^3 + k_5 x^5 parallel to the pairs, smooth and without memory."""

    n_memory, order, elements_order = 0, 2, 0

    def __init__(self, k, k_5):
        self.k, self.k_5, self.n_pairs = k, k_5, len(k)
        self.stiffness = self.springs = np.zeros((self.n_pairs, 3))
        none = np.zeros(0)
        self.sliders = ElasticCoulomb(none, none, none, none, none.astype(bool)).sliders

    def take(self, indices):
        return OddPowers(self.k[indices], self.k_5[indices])

    def utilisation(self, amplitudes):
        return np.full(amplitudes.shape[:-1], np.inf)

    def slip_safety(self, amplitudes):
        return np.zeros(amplitudes.shape[:-1])

    def cycle(self, U, n_samples, tangents=True, harmonics=None):
        E, F = synthesis_matrix(harmonics, n_samples), analysis_matrix(harmonics, n_samples)
        n, _, N_H = U.shape
        u = U[:, 0] @ E.T
        p, P = np.zeros_like(U), np.zeros((n, 3, N_H, 3, N_H))
        p[:, 0] = (self.k[:, None] * u**3 + self.k_5[:, None] * u**5) @ F.T
        slope = 3.0 * self.k[:, None] * u**2 + 5.0 * self.k_5[:, None] * u**4
        P[:, 0, :, 0] = np.einsum("ht,it,tk->ihk", F, slope, E)
        P = P.reshape(n, 3 * N_H, 3 * N_H) if tangents else None
        return ContactCycle(p, np.ones(n, np.uint8), np.arange(n), P, np.zeros(n, bool))

    def memoryless_rate(self, du):
        rate = np.zeros(du.shape)
        rate[..., 0] = 3.0 * self.k * du[..., 0] ** 2 + 5.0 * self.k_5 * du[..., 0] ** 4
        return rate


def search(problem, omega, known=(), starts=0, seed=1):
    """Return the search that begins with known solutions, after a number of starts."""
    workspace = Workspace(problem.equation)
    try:
        solver = PointSolver(problem, AllPairs(), Sweep(omega, omega + 1.0), 1e-10, workspace)
        result = _Search(solver, omega, has_stability=False)
        for solution in known:
            result.add(solution, "curve")
        result.deflate(starts, np.random.default_rng(seed))
        return result
    finally:
        workspace.destroy()


def amplitudes(result):
    return np.sort([COMM.bcast(float(np.hypot(*solution.point.response[0, 1:3]))) for solution in result.solutions])


def duffing(omega, level, c=0.1, k_3=1.0, k_5=0.0):
    """Return the problem x'' + c x' + x + k_3 x^3 + k_5 x^5 = level cos(omega t) in harmonic 1, and its exact amplitudes."""
    load = {"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}
    system = scenes.make_system(
        "duffing", [[1.0]], [[1.0]], [[0, -1, -1, -1, -1, -1]], mu=1.0, N0=1.0, k_t=0.0, k_n=0.0, separate=True, loads=[load],
        output=[1.0], omega=(0.5, 2.0), levels={}, C=np.array([[c]]),
    )  # fmt: skip
    law = OddPowers(np.array([k_3]), np.array([k_5]))
    problem = forced(reduced(system, COMM, Harmonics.up_to(1))[0], law, 32, level)
    stiffness = np.array([0.625 * k_5, 0.75 * k_3, 1.0 - omega**2])  # over the square of the amplitude
    missing = np.polyadd(np.polymul(stiffness, stiffness), [(c * omega) ** 2])
    squares = np.roots(np.polysub(np.append(missing, 0.0), [level**2]))
    squares = squares.real[(np.abs(squares.imag) < 1e-9) & (squares.real > 0.0)]
    return problem, np.sort(np.sqrt(squares))


@pytest.mark.parametrize(
    "omega, n", [(1.5, 3), *(pytest.param(omega, n, marks=pytest.mark.ranks(1)) for omega, n in ((1.6, 3), (0.8, 1)))]
)
def test_deflation_finds_exactly_the_solutions_of_duffings_equation(omega, n):
    problem, exact = duffing(omega, 0.3)
    assert len(exact) == n
    result = search(problem, omega, starts=6)
    assert amplitudes(result) == pytest.approx(exact, rel=1e-8)
    assert all(solution.residual < 1e-10 for solution in result.solutions)


@pytest.mark.ranks(1)
def test_deflation_finds_the_solutions_of_a_folded_curve():
    """A mass with a stop, at a frequency between the folds; the lowest solution is known."""
    system = scenes.gap_mass()
    loads = [{"phase": 0.0} | load | {"vector": np.array(load["vector"])} for load in system["loads"]]
    system, omega, H = system | {"loads": loads}, 1.25, 5
    curve = branch(system, COMM, 0.2, low=1.05, high=1.4, H=H, n_samples=64, points=12, at=(omega,))
    problem = forced(*reduced(system, COMM, H), 64, 0.2)
    on_curve = [iterate_of(point, problem, Harmonics.up_to(H)) for point in curve.points if point.requested]
    exact = amplitudes(search(problem, omega, on_curve))
    assert len(exact) == 3
    assert amplitudes(search(problem, omega, on_curve[-1:], starts=20)) == pytest.approx(exact, rel=1e-7)


def test_continuation_over_the_level_passes_folds():
    problem, exact = duffing(1.5, 0.3)
    workspace = Workspace(problem.equation)
    try:
        solver = PointSolver(problem, AllPairs(), Sweep(1.5, 2.5), 1e-10, workspace)
        sizes = [solver.norm(solution.U) for solution in over_level(solver, 1.5)]
    finally:
        workspace.destroy()
    assert np.sort(sizes) == pytest.approx(exact, rel=1e-7)


ISOLA = dict(level=0.0172, c=0.05, k_3=-1.9 / 0.75, k_5=1.6)  # from 0.31 to 0.42 rad/s, with amplitudes of 0.82 to 1.03


@pytest.mark.ranks(1)
def test_an_isolated_branch_is_detected_and_its_loop_is_followed():
    """Three amplitudes at 0.37 rad/s: the main curve passes through one, the other two lie on a closed branch."""
    omega, low, high, all_pairs = 0.37, 0.05, 1.5, AllPairs()
    problem, exact = duffing(omega, **ISOLA)
    assert len(exact) == 3
    steps = ArcLength(ds=0.02, ds_min=1e-5, ds_max=0.04)
    main = follow_branch(BranchTask(problem, all_pairs, Sweep(low, high, (omega,)), steps, 1e-10), 1000)
    assert main.failure is None and max(map(amplitude, main.points)) < 0.7 < exact[1]
    of_curve = [iterate_of(point, problem, Harmonics.up_to(1)) for point in main.points if point.requested]
    result = search(problem, omega, of_curve, starts=10)
    assert amplitudes(result) == pytest.approx(exact, rel=1e-8)
    settings = SimpleNamespace(points=100, tolerance=1e-10)
    context = SimpleNamespace(at_level=lambda level: problem, sweep=Sweep(low, high), steps=steps, settings=settings)
    (begin,) = [solution for solution in result.solutions if amplitude(solution.point) == pytest.approx(exact[2])]
    loop = continued(context, ISOLA["level"], begin, has_stability=False)
    for segment in (0, 1):
        points = [point for point in loop.points if point.segment == segment]
        assert points[-1].omega == pytest.approx(omega) and amplitude(points[-1]) == pytest.approx(exact[1], rel=1e-6)
        for point in points[:: len(points) // 5]:
            assert min(abs(duffing(point.omega, **ISOLA)[1] - amplitude(point))) < 1e-6
    lowest, highest = min(point.omega for point in loop.points), max(point.omega for point in loop.points)
    assert [len(duffing(at, **ISOLA)[1]) for at in (lowest - 0.005, lowest, highest, highest + 0.005)] == [1, 3, 3, 1]
