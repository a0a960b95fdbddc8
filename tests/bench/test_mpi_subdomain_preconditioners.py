"""The preconditioner of large joints: exact with one subdomain, accurate with many, and the curve is the same."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic
from mpi4py import MPI
from scipy.linalg import block_diag

from microslip.continuation.grid import at_frequencies
from microslip.fourier.amplitudes import to_complex
from microslip.harmonic import newton_solver, preconditioner, subdomain_preconditioners
from microslip.harmonic.gmres import Gmres
from microslip.harmonic.linearisation import Linearisation
from microslip.harmonic.preconditioner import REGULAR, HarmonicPreconditioner, Inverse, complex_linear
from microslip.harmonic.subdomain_preconditioners import SectorsPreconditioner, SubdomainPreconditioner, of_wide_slip
from microslip.points.selection import AllPairs
from microslip.receptance.subdomains import bisected, coupling

pytestmark = pytest.mark.ranks(1, 2, 3)
COMM, N_PAIRS, H = MPI.COMM_WORLD, 150, 2


@pytest.fixture
def problem(monkeypatch):
    """Return a joint of which all pairs slip far beyond their limits, so that GMRES needs many iterations."""
    monkeypatch.setattr(synthetic, "SLIPS", 0.03)
    return synthetic.joint_problem(synthetic.joint_model(COMM, N_PAIRS, H, n_modes=4), 1.0, n_samples=32)


def linearised(problem):
    """Return the linearisation at a solution."""
    (point,) = at_frequencies(problem, AllPairs(), synthetic.frequencies(1), tolerance=1e-8).points
    equation, at = problem.equation, problem.at((synthetic.OMEGA,))
    U = COMM.bcast(point.U).reshape(-1, *equation.shape[1:])[equation.model.owned]
    forces = equation.contact_forces(U, equation.every_pair, tangents=True)
    assert len(forces.active) == N_PAIRS
    return Linearisation.of(equation, at, forces)


def iterations(at, precondition, rtol=1e-3):
    """Return the number of GMRES iterations of I + G P."""
    rows = (-1, 3, at.equation.model.N_H)
    b = np.random.default_rng(0).standard_normal((N_PAIRS, *rows[1:]))[at.equation.model.owned]

    def multiply(x, out):
        dp = at.equation.gather(at.pair_forces(x).reshape(-1, rows[2]))
        out[:] = x + at.G.apply(dp).ravel()

    gmres = Gmres(COMM, b.size, multiply, lambda x, out: np.copyto(out, precondition(x.reshape(rows)).ravel()), rtol)
    outcome = gmres.solve(b.ravel(), is_preconditioned=True)[1]
    gmres.destroy()
    assert outcome.reason > 0
    return outcome.iterations


def test_one_subdomain_is_the_whole_preconditioner(problem, monkeypatch):
    monkeypatch.setattr(subdomain_preconditioners, "LOCAL", N_PAIRS)
    monkeypatch.setattr(preconditioner, "SINGLE_ERROR", 0.0)  # in double precision
    at = linearised(problem)
    b = np.random.default_rng(COMM.rank).standard_normal((len(at.forces.active_owned), 3, 2 * H + 1))
    exact = HarmonicPreconditioner(at).apply(b)
    assert SubdomainPreconditioner(at).apply(b) == pytest.approx(exact, abs=1e-9 * max(1.0, np.abs(exact).max(initial=0.0)))


def test_an_inverse_uses_single_precision_where_it_suffices():
    random = np.random.default_rng(1)
    parts = random.standard_normal((2, 30, 30))
    B, b = parts[0] + 1j * parts[1], random.standard_normal(30) + 0j
    stiff = np.diag(np.logspace(0.0, 9.0, 30)) @ B
    for matrix, kind, rtol in ((np.eye(30) + 0.1 * B, np.complex64, 1e-4), (stiff @ B, np.complex128, 1e-4)):
        inverse = Inverse(matrix)
        assert inverse.of_B.dtype == kind
        assert matrix @ inverse.times(b) == pytest.approx(b, abs=rtol * np.linalg.norm(b))
    assert np.array_equal(Inverse(np.zeros((3, 3), dtype=complex)).times(b[:3]), b[:3])
    assert Inverse(1e50 * np.eye(3, dtype=complex)).times(b[:3]) == pytest.approx(1e-50 * b[:3])


@pytest.mark.ranks(1, 2)
def test_subdomains_reduce_the_iterations_of_gmres(problem, monkeypatch):
    monkeypatch.setattr(subdomain_preconditioners, "LOCAL", 8)
    monkeypatch.setattr(subdomain_preconditioners, "REGIONS", 6)
    at = linearised(problem)
    made = SubdomainPreconditioner(at)
    assert len(made.subdomains) > len(made.regions.rows) >= 6 and max(map(len, made.subdomains)) <= 3 * 8
    none, whole = iterations(at, lambda x: x), iterations(at, HarmonicPreconditioner(at).apply)
    adjoint = at.transposed()
    assert iterations(at, made.apply) < min(0.5 * none, 3 * whole)
    assert iterations(adjoint, SubdomainPreconditioner(adjoint).apply) < 0.5 * iterations(adjoint, lambda x: x)


def test_subdomains_consist_of_neighbouring_pairs(problem):
    at = linearised(problem)
    computed = bisected(at.G, [np.arange(N_PAIRS)], 16)
    assert np.array_equal(np.sort(np.concatenate(computed)), np.arange(N_PAIRS)) and 9 <= min(map(len, computed))
    assert coupling(at.G, 5, np.arange(N_PAIRS))[5] == 1.0 == coupling(at.G, 5, np.arange(N_PAIRS)).max()
    every, shape = np.arange(N_PAIRS), synthetic.grid(N_PAIRS)
    steps = np.array(divmod(synthetic.offsets(every, every, shape), shape[1])).T
    distance = np.linalg.norm(np.minimum(steps, shape - steps) / shape, axis=2)
    within = np.mean([distance[np.ix_(subdomain, subdomain)].mean() for subdomain in computed])
    assert within < 0.75 * distance.mean()


def swept(G, P, b):
    """Return x_1, x_2, x_0 of eq. (17.8) by dense solves; harmonic 2 with the complex-linear part of its tangent."""
    x, N_H, complex_P = np.zeros_like(b), b.shape[-1], complex_linear(P, b.shape[-1])
    for n, columns in ((1, slice(1, 3)), (2, slice(3, 5)), (0, slice(0, 1))):
        x[..., columns] = b[..., columns]
        p = to_complex((P @ x.reshape(len(x), -1, 1)).reshape(-1, N_H))[:, n]
        P_nn = block_diag(
            *P.reshape(-1, 3, N_H, 3, N_H)[:, :, columns, :, columns].reshape(len(P), 3 * (columns.stop - columns.start), -1)
        )
        if n == 1:  # real maps of cos and sin
            p, real = (
                np.stack([p.real, -p.imag], axis=1).ravel(),
                np.kron(G[n].real, np.eye(2)) + np.kron(G[n].imag, [[0, 1], [-1, 0]]),
            )
            moved = np.linalg.solve(np.eye(len(real)) + real @ P_nn, real @ p).reshape(-1, 3, 2)
        else:
            P_nn = block_diag(*complex_P[:, n])
            moved = np.linalg.solve(np.eye(len(P_nn)) + G[n] @ P_nn, G[n] @ p)[:, None]
            moved = np.concatenate([moved.real, -moved.imag], axis=1)[:, : columns.stop - columns.start].reshape(len(x), 3, -1)
        x[..., columns] -= moved
    return x


@pytest.mark.parametrize("largest", [110, 12], ids=["whole", "bisected"])
def test_sectors_are_solved_for_in_a_sweep_over_the_harmonics(problem, monkeypatch, largest):
    """The sweep (17.8) within four sectors, whole or bisected; one has half of its pairs active, another none."""
    monkeypatch.setattr(preconditioner, "SINGLE_ERROR", 0.0)  # in double precision
    monkeypatch.setattr(subdomain_preconditioners, "LARGEST_SECTOR", largest)
    monkeypatch.setattr(subdomain_preconditioners, "LEAST", 0.0)  # every mode
    n, N_H = N_PAIRS // 5, 2 * H + 1
    at = linearised(problem)
    active = np.setdiff1d(np.arange(N_PAIRS), [*range(n, 2 * n), *range(2 * n, 3 * n, 2)])
    equation = at.equation.of(replace(at.equation.model, n_sectors=5))
    forces = equation.contact_forces(at.forces.U, np.isin(np.arange(N_PAIRS), active), tangents=True)
    assert np.array_equal(forces.active, active)
    at = Linearisation.of(equation, at.at, forces)
    b = np.random.default_rng(3).standard_normal((len(active), 3, N_H))
    owned = (active >= equation.model.owned.start) & (active < equation.model.owned.stop)
    made = of_wide_slip(at)
    assert isinstance(made, SectorsPreconditioner)
    blocks = set().union(*equation.comm.allgather({tuple(rows[::3] // 3) for rows in made.subdomains}))
    assert sorted(pair for block in blocks for pair in block) == list(range(len(active)))
    assert max(map(len, blocks)) <= min(n, largest) and all(len({*(active[[*block]] // n)}) == 1 for block in blocks)
    assert (len(blocks) == 4) == (largest > n)
    assert equation.comm.size == 1 or len(made.subdomains) < len(blocks)  # blocks with pairs of the rank
    within = np.zeros((len(active), len(active)), dtype=bool)
    for block in blocks:
        within[np.ix_(block, block)] = True
    G_n = [np.where(np.kron(within, np.ones((3, 3))), block, 0.0) for block in at.G.blocks()]
    exact = swept(G_n, REGULAR * equation.gather(at.P), b)
    assert made.apply(b[owned]) == pytest.approx(exact[owned], abs=1e-10 * np.abs(b).max())


@pytest.mark.ranks(2, 3)
def test_a_rank_without_active_pairs_takes_part_in_a_sweep(problem):
    """Only pairs of the first rank slip: the other ranks have no block, and no rows of the result."""
    equation, at = problem.equation.of(replace(problem.equation.model, n_sectors=5)), linearised(problem)
    active = np.isin(np.arange(N_PAIRS), np.arange(N_PAIRS // 5 // COMM.size))
    at = Linearisation.of(equation, at.at, equation.contact_forces(at.forces.U, active, tangents=True))
    b = np.random.default_rng(COMM.rank).standard_normal((len(at.forces.active_owned), 3, equation.model.N_H))
    x = SectorsPreconditioner(at).apply(b)
    assert x.shape == b.shape and np.isfinite(x).all() and (len(x) > 0) == (COMM.rank == 0)


@pytest.mark.ranks(1, 2)
def test_a_sweep_needs_fewer_iterations_than_separate_harmonics(problem, monkeypatch):
    monkeypatch.setattr(subdomain_preconditioners, "LARGEST_SECTOR", N_PAIRS)
    at = linearised(problem)
    one_by_one = iterations(at, HarmonicPreconditioner(at).apply, 1e-9)
    assert iterations(at, SectorsPreconditioner(at).apply, 1e-9) < one_by_one
    adjoint = at.transposed()
    assert iterations(adjoint, SectorsPreconditioner(adjoint).apply, 1e-9) < one_by_one


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize(("n_sectors", "kind"), [(1, SubdomainPreconditioner), (5, SectorsPreconditioner)])
def test_the_curve_with_the_preconditioner_is_the_same(problem, monkeypatch, n_sectors, kind):
    plain = at_frequencies(problem, AllPairs(), synthetic.frequencies(3), tolerance=1e-9)
    made = []
    monkeypatch.setattr(subdomain_preconditioners, "LARGE", 10)
    monkeypatch.setattr(newton_solver, "LARGE", 10)
    monkeypatch.setattr(newton_solver, "LARGEST", 0)
    monkeypatch.setattr(newton_solver, "MANY_IN_LARGE", 0)
    monkeypatch.setattr(subdomain_preconditioners, "LOCAL", 12)
    monkeypatch.setattr(newton_solver, "of_wide_slip", lambda at: made.append(of_wide_slip(at)) or made[-1])
    problem = replace(problem, equation=problem.equation.of(replace(problem.equation.model, n_sectors=n_sectors)))
    solution = at_frequencies(problem, AllPairs(), synthetic.frequencies(3), tolerance=1e-9)
    assert plain.failure is None and solution.failure is None and made and isinstance(made[0], kind)
    for reference, point in zip(plain.points, solution.points, strict=True):
        assert point.response == pytest.approx(reference.response, abs=1e-8 * np.abs(reference.response).max())
    assert sum(p.krylov for p in solution.points[1:]) < sum(p.krylov for p in plain.points[1:])
