"""Zeros that couple a joint, for the sake of the ordering, change nothing but the pattern."""

import lattices
import numpy as np
import pytest
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc

from microslip.linear import joint_springs
from microslip.linear.joint_springs import joint_stiffness, linearise, with_ties
from microslip.modes import constraint
from microslip.modes.constraint import static_columns

comm = MPI.COMM_WORLD
SHAPE = (6, 3, 2)


@pytest.fixture(params=[None, 1], ids=["all", "rank 1 empty"])
def structure(request):
    return lattices.lattice(comm, SHAPE, empty_rank=request.param, k_t=3.0e5)


def entries(A):
    return A.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"]


def n_by_springs(system, monkeypatch, pairs):
    """Return the entries of K_L without ties."""
    with monkeypatch.context() as patched:
        patched.setattr(joint_springs, "_FEW", 1000)
        linearised = linearise(system, pairs)
        found = entries(linearised.K_L)
        linearised.destroy()
    return found


@pytest.mark.parametrize("by_entries", [False, True])
def test_columns_are_those_of_the_springs_alone(structure, monkeypatch, by_entries):
    system, pairs = structure
    without = n_by_springs(system, monkeypatch, pairs)
    monkeypatch.setattr(joint_springs, "_FEW", 0)
    monkeypatch.setattr(joint_springs, "_MOST_TIES", 10.0)
    if by_entries:
        monkeypatch.setattr(constraint, "_FEW", 0)
        monkeypatch.setattr(constraint, "_MOST_ROWS", 1.0)
    linearised, R = linearise(system, pairs), system.R
    assert entries(linearised.K_L) > 1.2 * without
    assert linearised.K_L.isSymmetric(0.0) if comm.size == 1 else True
    exact = np.linalg.inv((lattices.lattice_stiffness(SHAPE, 3) + R.T @ sp.diags(joint_stiffness(pairs)) @ R).toarray())
    found = static_columns(linearised, R, R.T.tocsc())
    np.testing.assert_allclose(found, R @ exact @ R.T, rtol=0, atol=1e-13 * abs(exact).max())
    linearised.destroy()


def test_no_more_of_them_than_a_share_of_the_matrix(structure, monkeypatch):
    system, pairs = structure
    without = n_by_springs(system, monkeypatch, pairs)
    monkeypatch.setattr(joint_springs, "_FEW", 0)
    linearised = linearise(system, pairs)
    assert 0 <= entries(linearised.K_L) - without <= joint_springs._MOST_TIES * entries(system.K)
    linearised.destroy()


def test_ties_are_symmetric_and_of_the_joint_alone(monkeypatch):
    monkeypatch.setattr(joint_springs, "_FEW", 0)
    joint, n = np.array([1, 2, 4, 7, 8, 9, 11, 12]), 14
    springs = sp.csr_matrix((np.ones(8), (joint, joint)), (n, n))
    parts = [with_ties(springs[a:b], (a, b), joint, 1e6) for a, b in ((0, 5), (5, 5), (5, n))]
    tied = sp.vstack(parts, format="csr")
    pattern = sp.csr_matrix((np.ones(tied.nnz), tied.indices, tied.indptr), (n, n)).toarray()
    assert np.array_equal(tied.toarray(), springs.toarray()) and np.array_equal(pattern, pattern.T)
    assert set(np.flatnonzero(pattern.any(axis=0))) == set(joint)
    assert np.count_nonzero(pattern[joint].sum(axis=1) == len(joint)) == 2  # a quarter of eight
    monkeypatch.setattr(joint_springs, "_FEW", 9)
    assert with_ties(springs, (0, n), joint, 1e6) is springs
