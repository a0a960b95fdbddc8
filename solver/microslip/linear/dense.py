"""Owned rows as NumPy blocks on one side, PETSc dense matrices on the other, without copies where the order allows."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..assembly.real_form import complex_columns, real_columns
from ..parallel.ownership import summed


def wrap(block_owned: np.ndarray, comm: MPI.Comm) -> PETSc.Mat:
    """Return a PETSc dense matrix whose local rows are ``block_owned`` (n_owned, m), in the same memory.

    Collective on ``comm``.  The block must be column-major (``order="F"``) and outlive the matrix, which the caller
    destroys.
    """
    assert block_owned.flags.f_contiguous and block_owned.dtype == PETSc.ScalarType
    n_owned, m = block_owned.shape
    matrix = PETSc.Mat().createDense(((n_owned, None), (None, m)), array=block_owned, comm=comm)
    matrix.assemble()
    return matrix


def multiply(A: PETSc.Mat, X_owned: np.ndarray) -> np.ndarray:
    """Return this rank's rows of A X, (n_owned, m); of complex X, A is Hermitian in real form.

    Collective on A's communicator: one matrix product.
    """
    if np.iscomplexobj(X_owned):
        return complex_columns(multiply(A, real_columns(X_owned)))
    if X_owned.shape[1] == 0:
        return np.zeros((A.getLocalSize()[0], 0), order="F")
    X = wrap(np.asfortranarray(X_owned), A.comm)
    AX = A.matMult(X)
    AX_owned = np.array(AX.getDenseArray(), order="F")
    AX.destroy()
    X.destroy()
    return AX_owned


def gram(comm: MPI.Comm, X_owned: np.ndarray, Y_owned: np.ndarray) -> np.ndarray:
    """Return X^H Y, (m_x, m_y), on every rank.  Collective on ``comm``: one sum."""
    return summed(comm, X_owned.conj().T @ Y_owned)


def column_norms(comm: MPI.Comm, X_owned: np.ndarray) -> np.ndarray:
    """Return the Euclidean norm of each column, (m,), on every rank.  Collective on ``comm``: one sum."""
    return np.sqrt(summed(comm, np.einsum("ij,ij->j", X_owned, X_owned)))


def diagonal_owned(A: PETSc.Mat) -> np.ndarray:
    """Return this rank's part of diag(A), (n_owned,).  Collective."""
    vector = A.getDiagonal()
    diagonal = vector.getArray().copy()
    vector.destroy()
    return diagonal
