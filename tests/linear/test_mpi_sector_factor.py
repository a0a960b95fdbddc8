"""One factor of a sector for all nodal diameters against dense algebra with the matrix of each diameter."""

import mmap
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from discs import write_sector
from mpi4py import MPI

from microslip.library.build import assembled, factor_of
from microslip.linear.dense import diagonal_owned, multiply
from microslip.linear.joint_springs import joint_stiffness
from microslip.linear.mumps import MumpsFactor
from microslip.linear.sector_factor import SectorFactor, negative_eigenvalues, packed_cholesky, packed_gram, packed_solve
from microslip.modes.lapack import gathered
from microslip.observe.log import RunLog
from microslip.parallel.agree import on_root
from microslip.scene.read import read_scene

pytestmark = pytest.mark.ranks(1, 2)
COMM, N = MPI.COMM_WORLD, 5
END = "[damping]\nratio = 0.01\n[response]\nlevels = [1.0]\nfrequencies = [1400.0, 1410.0]\npoints = 3\n[solver]\nmodes = 4\n"


@pytest.mark.parametrize("how", [{}, {"shroud": True}, {"span": 12}, {"shroud": True, "span": 16}])
def test_solves_entries_and_counts_equal_dense_algebra(shared_path, how):
    log = RunLog(COMM, screen=False)
    parts = assembled(read_scene(on_root(COMM, lambda: write_sector(shared_path, N, END, how=how))), COMM, log)
    sectors = parts.rest.system.sectors
    for d, explicit in ((0, True), (0, False), (1, True), (2, True)):  # real matrices also with explicit entries
        system = sectors.system(d, explicit)
        linearised = factor_of(replace(parts, rest=replace(parts.rest, system=system)), log)
        K, M = (on_root(COMM, lambda A: A, gathered(A)) for A in (linearised.K_L, linearised.M))
        np.testing.assert_allclose(K, K.T, atol=1e-12 * np.abs(K).max())
        first, last = linearised.K_L.getOwnershipRange()
        B = np.random.default_rng(d).standard_normal((len(K), 3))
        X = np.linalg.solve(K, B)
        np.testing.assert_allclose(linearised.factor.solve(B[first:last]), X[first:last], atol=1e-10 * np.abs(X).max())
        sparse = linearised.factor.solve(sp.csc_matrix(B))
        np.testing.assert_allclose(sparse, X[first:last], atol=1e-10 * np.abs(X).max())
        product = multiply(linearised.M, np.asfortranarray(B[first:last]))
        np.testing.assert_allclose(product, (M @ B)[first:last], atol=1e-12 * np.abs(M @ B).max())
        assert (np.abs(diagonal_owned(linearised.K_L) / K.diagonal()[first:last] - 1.0) < 1.0).all()
        omega2 = scipy.linalg.eigvalsh(K, M)
        copies = 2 if system.is_complex else 1
        for n in (0, 4, 12):
            sigma = 0.5 * (omega2[n * copies] + (omega2[n * copies - 1] if n else 0.0))
            assert linearised.factor.solver.count_below(sigma) == n
        rows = np.unique(linearised.system.R.indices)
        entries, is_there = (
            linearised.factor.inverse_entries(rows, rows[::3]),
            "span" in how,
        )  # otherwise the joint has too many rows
        assert (entries is not None) is is_there
        R, some = linearised.system.R.tocsr(), sp.random(7, len(rows), 0.5, format="csr", random_state=d)
        others = (some @ sp.identity(len(K), format="csr")[rows]).tocsr()  # not the real form of a complex map
        inverse = np.linalg.inv(K)
        if COMM.rank == 0 and is_there:
            exact = inverse[np.ix_(rows, rows[::3])]
            np.testing.assert_allclose(entries, exact, atol=1e-10 * np.abs(exact).max())
        for left, right in ((R, R), (R, R[::2]), (others, R), (R, others), (others, others)):
            product = linearised.factor.flexibility(left, right.T.tocsc())
            assert (product is not None) is is_there
            if COMM.rank == 0 and is_there:
                exact = left @ (right @ inverse).T
                np.testing.assert_allclose(product, exact, atol=1e-10 * np.abs(exact).max())
        assert linearised.factor.flexibility(sp.identity(len(K), format="csr"), R.T.tocsc()) is None  # eliminated rows
        linearised.destroy()
    sectors.destroy()


@pytest.fixture
def parts(shared_path):
    """Return the assembled disc."""
    parts = assembled(read_scene(on_root(COMM, lambda: write_sector(shared_path, N, END))), COMM, RunLog(COMM, screen=False))
    yield parts
    parts.rest.system.sectors.destroy()


def test_memory_of_factoring_is_returned_to_the_system(parts):
    of_sector = SectorFactor(parts.rest.system.sectors, joint_stiffness(parts.rest.pairs))
    memory, n = np.frombuffer(of_sector.interior._workspace), of_sector.interior.mumps.info(9)
    beyond = memory[n + mmap.PAGESIZE // 8 :]
    assert np.count_nonzero(memory[:n]) > 0.5 * n
    assert len(beyond) > 0 and not beyond.any()  # returned pages are empty
    of_sector.destroy()


def test_too_little_memory_for_a_factor_is_left_to_mumps(parts, monkeypatch):
    def take_less(factor):
        n = factor.mumps.info(8) // 8
        factor._workspace = mmap.mmap(-1, 8 * n, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        factor.mumps.set_workspace(np.frombuffer(factor._workspace), n)

    monkeypatch.setattr(MumpsFactor, "take_workspace", take_less)
    linearised = factor_of(parts, RunLog(COMM, screen=False))
    assert "again with 60 %" in linearised.factor.info["messages"][0]
    assert linearised.factor.solver.of_sector.interior._workspace is None
    B = np.ones((linearised.K_L.getLocalSize()[0], 1))
    np.testing.assert_allclose(multiply(linearised.K_L, linearised.factor.solve(B)), B, atol=1e-9)
    linearised.destroy()


def test_pivots_count_negative_eigenvalues():
    rng = np.random.default_rng(1)
    A = rng.standard_normal((40, 40)) + 1j * rng.standard_normal((40, 40))
    for S in (A + A.conj().T, (A + A.conj().T).real):
        assert negative_eigenvalues(np.asfortranarray(S)) == np.count_nonzero(np.linalg.eigvalsh(S) < 0.0)
    assert negative_eigenvalues(np.zeros((0, 0))) == 0


@pytest.mark.parametrize("kind", [float, complex])
def test_packed_factors_solve_exactly(kind):
    rng = np.random.default_rng(1)
    for n in (1, 40, 41):
        A = rng.standard_normal((n, n)) + (1j * rng.standard_normal((n, n)) if kind is complex else 0.0)
        S, B = np.asfortranarray(A @ A.conj().T + n * np.eye(n)), rng.standard_normal((n, 3)).astype(kind)
        L = packed_cholesky(S.copy(order="F"))
        assert len(L) == n * (n + 1) // 2
        np.testing.assert_allclose(S @ packed_solve(L, B), B, atol=1e-12)
        np.testing.assert_allclose(packed_gram(L, B), B.conj().T @ packed_solve(L, B), atol=1e-14)
        assert packed_cholesky(np.asfortranarray(-S)) is None
    empty = np.zeros((0, 0), dtype=kind)
    assert packed_solve(packed_cholesky(empty), np.zeros((0, 2), dtype=kind)).shape == (0, 2)
    assert not packed_gram(packed_cholesky(empty), np.zeros((0, 2), dtype=kind)).any()
