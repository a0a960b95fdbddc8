"""Entries of the inverse of a factored matrix, and solves after them."""

import lattices
import numpy as np
import pytest
from lattices import distributed, split_rows
from mpi4py import MPI
from petsc4py import PETSc

from microslip.linear import inverse_entries as module
from microslip.linear.factor import Factor

comm = MPI.COMM_WORLD
SHAPE = (5, 3, 2)
K = lattices.lattice_stiffness(SHAPE)
SOME = np.array([0, 3, 4, 17, 50, 51, 88, 89])
OTHERS = np.array([3, 5, 17, 51, 60])


@pytest.fixture(params=[None, 0, 1], ids=["all", "rank 0 empty", "rank 1 empty"])
def factor(request):
    A = distributed(comm, K, split_rows(K.shape[0], comm.size, request.param))
    A.setOption(PETSc.Mat.Option.SPD, True)
    factor = Factor(A)
    yield factor
    factor.destroy()
    A.destroy()


@pytest.mark.parametrize("rows, columns", [(SOME, SOME), (SOME, OTHERS), (OTHERS, SOME), (SOME[:3], SOME[5:]), (SOME, SOME[:1])])
def test_entries_equal_the_dense_inverse(factor, rows, columns):
    exact = np.linalg.inv(K.toarray())[np.ix_(rows, columns)]
    entries = factor.inverse_entries(rows, columns)
    if comm.rank == 0:
        np.testing.assert_allclose(entries, exact, rtol=0, atol=1e-14 * abs(exact).max())
    else:
        assert entries.shape == (0, 0)


def test_of_symmetric_entries_one_is_requested():
    assert np.count_nonzero(module._known_by_symmetry(SOME, SOME)) == 8 * 7 // 2
    assert np.count_nonzero(module._known_by_symmetry(SOME, OTHERS)) == 3  # pairs of 3, 17 and 51


def test_solves_of_every_kind_are_unaffected(factor):
    """Entries of the inverse need other settings of MUMPS, and the solution on one rank."""
    owned = slice(*factor.A.getOwnershipRange())
    B = np.random.default_rng(1).standard_normal((K.shape[0], 3))
    X = np.linalg.solve(K.toarray(), B)
    for _ in range(2):
        np.testing.assert_allclose(factor.solve(B[owned]), X[owned], atol=1e-12 * abs(X).max())
        np.testing.assert_allclose(factor.solve(lattices.sp.csc_matrix(B)), X[owned], atol=1e-12 * abs(X).max())
        np.testing.assert_allclose(factor.solver.solve(B[owned, :1]), X[owned, :1], atol=1e-12 * abs(X).max())
        factor.inverse_entries(SOME, OTHERS)


def test_entries_that_mumps_refuses_are_none(factor, monkeypatch):
    monkeypatch.setattr(module, "_SOLVE", 99)  # an invalid job of MUMPS
    assert factor.inverse_entries(SOME, SOME) is None
