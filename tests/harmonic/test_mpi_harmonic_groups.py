"""Harmonic groups with different stiffness and complex coupling, in all solvers: compared with dense harmonic balance in physical
coordinates, one matrix per harmonic, and with a full ring.  On any number of ranks, one without a pair."""

import numpy as np
import pytest
from dense_model import forced, reduced
from mpi4py import MPI
from petsc4py import PETSc
from ring import Sector, Wave, amplitude, whole_ring
from taylor import Place, assert_second_order

from microslip.continuation.follow import follow_branch
from microslip.continuation.grid import at_frequencies, solved_at, task_at
from microslip.continuation.problems import DampingHomotopy, ForcedResponse, LevelHomotopy
from microslip.continuation.steps import ArcLength
from microslip.continuation.task import BranchTask
from microslip.error_estimate.estimate import ErrorEstimator
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.adjoint_solver import AdjointSolver
from microslip.harmonic.balance import HarmonicBalance
from microslip.harmonic.linearisation import Linearisation
from microslip.harmonic.operating_point import OperatingPoint
from microslip.points.error_parts import total
from microslip.points.selection import AllPairs
from microslip.points.sweep import Sweep
from microslip.receptance.on_ranks import on_ranks
from microslip.receptance.truncated_modes import EnrichedModel

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM = MPI.COMM_WORLD
N, N_SAMPLES, OMEGA, LEVEL = 5, 160, 700.0, 150.0


def two_groups(n):
    """The even harmonics have nodal diameter 0 and are real; the odd harmonics have nodal diameter 1 and are complex."""
    return n % 2


def wave(n):
    """A wave of h = 1: each harmonic up to 4 has a different nodal diameter."""
    return n % N


H3 = Harmonics.up_to(3)


def equation_of(diameter=two_groups, harmonics=H3, n_modes=None):
    sector = Sector(COMM, N, diameter)
    model = sector.model(harmonics, n_modes)
    return sector, HarmonicBalance.of_all(model, sector.law, N_SAMPLES)


def whole(owned):
    return np.concatenate(COMM.allgather(owned))


def test_the_stiffness_of_the_groups_differs_and_one_is_complex():
    even, odd = (Wave.of(two_groups(n), N) for n in (0, 1))
    assert not np.iscomplexobj(even.K_L) and np.abs(odd.K_L.imag).max() > 0.05 * np.abs(odd.K_L).max()
    assert np.abs(odd.K_L - odd.K_L.conj().T).max() == pytest.approx(0.0, abs=1e-9)
    lowest = even.modes()[0][0], odd.modes()[0][0]
    assert abs(lowest[1] / lowest[0] - 1.0) > 0.05


@pytest.mark.parametrize("diameter", [two_groups, wave])
def test_the_residual_is_that_of_dense_harmonic_balance(diameter):
    sector, equation = equation_of(diameter)
    U = 1e-3 * np.random.default_rng(1).standard_normal((6, H3.n_coefficients))
    at = OperatingPoint(OMEGA, LEVEL)
    mine = U.reshape(2, 3, -1)[equation.model.owned]
    forces = equation.contact_forces(mine, equation.every_pair, tangents=False)
    assert len(forces.active) == 2
    du, _ = sector.physical(U, OMEGA, LEVEL, H3, N_SAMPLES)
    computed = whole(equation.residual(mine, at, forces)).reshape(6, -1)
    np.testing.assert_allclose(computed, U - du, atol=1e-12 * np.abs(du).max())


@pytest.mark.parametrize("problem", ["frequency", "level", "damping"])
def test_the_jacobian_is_the_derivative_of_the_residual(problem):
    _, equation = equation_of()
    continued, parameters = {
        "frequency": (ForcedResponse(equation, LEVEL), (OMEGA,)),
        "level": (LevelHomotopy(equation, OMEGA), (LEVEL,)),
        "damping": (DampingHomotopy(equation, OMEGA, LEVEL), (0.6,)),
    }[problem]
    place = Place(continued, parameters, 1.3)
    assert place.n_active == 2
    assert_second_order(place)


@pytest.mark.parametrize("direct", [100, 0], ids=["by a factor", "by GMRES"])
def test_the_transposed_system_of_two_groups_is_solved(direct, monkeypatch):
    monkeypatch.setattr("microslip.harmonic.adjoint_solver.DIRECT", direct)
    _, equation = equation_of(wave)
    at = OperatingPoint(OMEGA, LEVEL)
    forces = equation.contact_forces(1.2 * equation.linear_motion(at), equation.every_pair, tangents=True)
    linear = Linearisation.of(equation, at, forces)
    assert len(forces.active) == 2
    B = np.random.default_rng(3).standard_normal((2, 6, H3.n_coefficients))
    options, solver = PETSc.Options(), AdjointSolver(COMM)
    options["hb_ksp_rtol"] = "1e-7"  # its products are in single precision
    try:
        chi, tau, is_solved = linear.solve_transposed(B, solver)
    finally:
        options.delValue("hb_ksp_rtol")
        solver.destroy()
    P, size = np.concatenate(COMM.allgather(linear.P)), 3 * H3.n_coefficients
    P_all = np.zeros((2 * size, 2 * size))
    for i, block in enumerate(P):
        P_all[i * size : (i + 1) * size, i * size : (i + 1) * size] = block
    expected = np.linalg.solve(np.eye(2 * size) + linear.G.matrix().T @ P_all.T, B.reshape(2, -1).T).T
    shape = (2, -1, size)
    by_pair = np.concatenate(COMM.allgather(chi.reshape(shape)), axis=1).reshape(2, -1)
    assert is_solved
    np.testing.assert_allclose(by_pair, expected, atol=1e-5 * np.abs(expected).max())
    p_t = np.concatenate(COMM.allgather(tau.reshape(shape)), axis=1).reshape(2, -1)
    np.testing.assert_allclose(p_t, expected @ P_all, atol=1e-5 * np.abs(expected @ P_all).max())


@pytest.mark.parametrize("diameter", [two_groups, wave])
def test_a_branch_solves_dense_harmonic_balance(diameter):
    sector, equation = equation_of(diameter)
    problem, steps = ForcedResponse(equation, LEVEL), ArcLength(ds=0.02, ds_min=1e-6, ds_max=0.1)
    branch = follow_branch(BranchTask(problem, AllPairs(), Sweep(550.0, 800.0, (700.0,)), steps, 1e-10), 400)
    assert branch.failure is None and len(branch.points) > 10
    slips = 0
    for point in branch.points:
        U, state = COMM.bcast((point.U, point.state))
        du, out = sector.physical(U.reshape(6, -1), point.omega, LEVEL, H3, N_SAMPLES)
        np.testing.assert_allclose(U.reshape(6, -1), du, atol=3e-9 * np.abs(U).max())
        if COMM.rank == 0:
            assert amplitude(point.response[0], H3) == pytest.approx(out[1], rel=1e-8)
        slips += int(np.count_nonzero(state) == 2)
    assert slips > 5


def points_with_bars(sector, model, omegas, enriched):
    estimator = ErrorEstimator(enriched)
    task = task_at(forced(model, sector.law, N_SAMPLES, LEVEL), AllPairs(), omegas, 1e-10, estimator)
    solution = solved_at(task, omegas)
    assert solution.failure is None
    return solution.points


def amplitudes(points):
    return np.array([amplitude(point.response[0], H3) for point in points])


def test_error_bars_build_further_groups_and_bound_the_effect_of_more_harmonics():
    omegas = list(np.linspace(620.0, 760.0, 8))
    sector, harmonics = Sector(COMM, N, wave), Harmonics((1, 5))
    model = sector.model(harmonics)
    at_frequencies(forced(model, sector.law, N_SAMPLES, LEVEL), AllPairs(), omegas[:1], tolerance=1e-8)
    assert sector.made == [1, 0]
    sector.made.clear()
    points = points_with_bars(sector, sector.model(H3), omegas, EnrichedModel.of_all_modes(sector.model(H3)))
    assert set(sector.made) == set(range(N))
    many = Sector(COMM, N, wave).model(Harmonics.up_to(21))
    finest = at_frequencies(forced(many, sector.law, 1280, LEVEL), AllPairs(), omegas, tolerance=1e-10).points
    true, bars = np.abs(amplitudes(points) - amplitudes(finest)), total(np.array([point.error[0] for point in points]))
    peak = np.abs(amplitudes(finest)).max()
    assert (true > 1e-6 * peak).all() and (true <= bars).all() and np.median(bars / true) < 12.0


def test_error_bars_bound_the_effect_of_truncated_modes_of_each_group():
    omegas = list(np.linspace(620.0, 760.0, 5))
    sector = Sector(COMM, N, wave)
    model = sector.model(H3, n_modes=4)
    points = points_with_bars(sector, model, omegas, sector.enriched(model))
    exact = at_frequencies(forced(sector.model(H3), sector.law, N_SAMPLES, LEVEL), AllPairs(), omegas, tolerance=1e-10).points
    parts = np.array([point.error[0] for point in points])[:, 0]
    true = np.abs(amplitudes(points) - amplitudes(exact))
    assert (true > 1e-6 * np.abs(amplitudes(exact)).max()).all()
    assert (true <= 3.0 * parts).all() and np.median(parts / true) < 30.0


def test_a_model_on_a_subset_of_the_ranks_has_every_group():
    _, equation = equation_of(wave)
    on_one_rank = on_ranks(equation.model, MPI.COMM_SELF)
    U = 1e-3 * np.random.default_rng(1).standard_normal((2, 3, H3.n_coefficients))
    at, whole_balance = OperatingPoint(OMEGA, LEVEL), HarmonicBalance.of_all(on_one_rank, Sector(COMM, N, wave).law, N_SAMPLES)
    expected = whole_balance.residual(U, at, whole_balance.contact_forces(U, whole_balance.every_pair, tangents=False))
    part = U[equation.model.owned]
    forces = equation.contact_forces(part, equation.every_pair, tangents=False)
    np.testing.assert_allclose(expected[equation.model.owned], equation.residual(part, at, forces), atol=1e-14)


@pytest.mark.parametrize("h", [1, 2, -1])
def test_the_response_of_a_sector_is_that_of_the_full_ring(h):
    """Where all pairs slip in each cycle the initial slider positions are forgotten, and the full ring vibrates as a wave."""
    omegas = [640.0, 700.0, 730.0]
    sector = Sector(COMM, N, lambda n: (n * h) % N)
    of_sector = at_frequencies(forced(sector.model(H3), sector.law, N_SAMPLES, 400.0), AllPairs(), omegas, tolerance=1e-11).points
    model, law = reduced(whole_ring(N, h), COMM, H3)
    full = at_frequencies(forced(model, law, N_SAMPLES, 400.0), AllPairs(), omegas, tolerance=1e-11).points
    assert len(of_sector) == len(full) == 3
    np.testing.assert_allclose(amplitudes(of_sector), amplitudes(full), rtol=1e-6)
