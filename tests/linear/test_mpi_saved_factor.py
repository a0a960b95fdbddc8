"""A factor saved by MUMPS and restored: same solutions and report; a new factor if the files do not fit the matrix."""

import lattices
import numpy as np
import pytest
import scipy.sparse as sp
from lattices import distributed, split_rows
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse.linalg import spsolve

from microslip.linear import factor as factors
from microslip.linear import mumps
from microslip.linear.factor import Factor
from microslip.messages.errors import ResourceError
from microslip.parallel.agree import on_root

comm = MPI.COMM_WORLD
K = lattices.lattice_stiffness((8, 5, 4))


class SavedFactor:
    """The cache of a factor in a folder."""

    def __init__(self, folder):
        self.folder, self.messages = str(folder), ()

    def restore(self, A, prefix):
        return mumps.restored(A, prefix, self.folder)

    def drop(self, why):
        self.messages = (why,)


@pytest.fixture(params=[None, 0, 1], ids=["all", "rank 0 empty", "rank 1 empty"])
def A(request):
    matrix = spd(K, split_rows(K.shape[0], comm.size, request.param))
    yield matrix
    matrix.destroy()


def spd(K, ranges):
    parts = distributed(comm, K, ranges)
    parts.setOption(PETSc.Mat.Option.SPD, True)
    return parts


@pytest.fixture
def factorised(monkeypatch):
    """Return the list of factored matrices."""
    matrices = []
    factorise = factors.factorise
    monkeypatch.setattr(factors, "factorise", lambda A, *rest, **keys: (matrices.append(A), factorise(A, *rest, **keys))[1])
    return matrices


def save(A, folder):
    """Save the factor of A; return its solutions and its report."""
    factor = Factor(A, last=np.arange(0, 60, 3))
    expected, info = solutions(factor), dict(factor.info)
    factor.solver.save(str(folder))
    factor.destroy()
    return expected, info


def solutions(factor):
    """Return solutions for dense and sparse forces, and entries of the inverse."""
    first, last = factor.A.getOwnershipRange()
    B = np.random.default_rng(3).standard_normal((K.shape[0], 5))
    rows = np.arange(0, 60, 3)
    sparse = sp.csc_matrix(np.where(np.arange(K.shape[0])[:, None] % 50 == 0, B, 0.0))
    return factor.solve(B[first:last]), factor.solve(sparse), factor.inverse_entries(rows, rows)


def assert_close(computed, expected):
    for a, other in zip(computed, expected, strict=True):
        np.testing.assert_allclose(a, other, rtol=0, atol=1e-12 * comm.allreduce(np.abs(other).max(initial=0.0), MPI.MAX))


def test_a_restored_factor_has_the_solutions_and_the_report_of_the_saved_one(A, shared_path, factorised):
    expected, info = save(A, shared_path)
    restored = Factor(A, cache=SavedFactor(shared_path))
    assert len(factorised) == 1 and restored.solver.order is None
    assert (restored.info["solves"], restored.info["refined"], restored.info["residual"]) == (0, 0, 0.0)
    assert_close(solutions(restored), expected)
    assert restored.info["residual"] < 1e-12
    of_run = {"seconds": 0.0, "solve_seconds": 0.0, "residual": 0.0}
    assert restored.info | of_run == info | of_run
    restored.destroy()


def test_a_factor_can_be_restored_twice(A, shared_path):
    expected, _ = save(A, shared_path)
    first, second = Factor(A, cache=SavedFactor(shared_path)), Factor(A, cache=SavedFactor(shared_path))
    assert_close(solutions(first), expected)
    first.destroy()
    assert_close(solutions(second), expected)
    second.destroy()


def test_the_factor_of_another_matrix_is_not_used(A, shared_path, factorised):
    stiffer = spd(1.5 * K, np.array(A.getOwnershipRanges()))
    save(stiffer, shared_path)
    stiffer.destroy()
    cache = SavedFactor(shared_path)
    factor = Factor(A, cache=cache)
    assert len(factorised) == 2 and factor.info["messages"] == cache.messages == ("it is not that of K_L",)
    X_owned = solutions(factor)[0]
    B = np.random.default_rng(3).standard_normal((K.shape[0], 5))
    X = spsolve(K.tocsc(), B)
    np.testing.assert_allclose(X_owned, X[slice(*A.getOwnershipRange())], rtol=0, atol=1e-10 * np.abs(X).max())
    factor.destroy()


def test_an_incomplete_factor_is_not_used(A, shared_path, factorised):
    save(A, shared_path)
    on_root(comm, lambda: (shared_path / mumps.saved_file(comm.size - 1)).unlink())
    assert mumps.restored(A, "static_", str(shared_path)) is None
    factor = Factor(A, cache=SavedFactor(shared_path))
    assert len(factorised) == 2
    factor.destroy()


@pytest.mark.ranks(2, 3)
def test_files_of_two_factors_are_not_combined(A, shared_path):
    """Another run may replace some of the files."""
    folders = shared_path / "one", shared_path / "two"
    for folder in folders:
        on_root(comm, folder.mkdir)
        save(A, folder)
    on_root(comm, lambda: [(folders[0] / mumps.saved_file(1)).replace(folders[1] / mumps.saved_file(1)), None][1])
    assert mumps.restored(A, "static_", str(folders[1])) is None


@pytest.mark.parametrize("name", ["nowhere", "long" * 100])
def test_a_path_that_mumps_cannot_write_is_an_error_and_the_factor_remains_usable(name, A, shared_path):
    factor = Factor(A, last=np.arange(0, 60, 3))
    before = solutions(factor)
    with pytest.raises(ResourceError, match=f"{name[:4]}.*(INFOG|MUMPS takes 255)"):
        factor.solver.save(str(shared_path / name))
    assert_close(solutions(factor), before)
    factor.destroy()
