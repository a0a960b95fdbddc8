"""Owned rows as NumPy blocks on one side, PETSc dense matrices on the other, without copies where the order allows."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc

from ..assembly.real_form import complex_columns, real_columns
from ..assembly.wave_matrix import WaveMatrix, times
from ..parallel.ownership import summed
from .lockstep import at_once


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
    wave = wave_matrix(A)
    if wave is not None and not (wave.is_complex or np.iscomplexobj(X_owned)):
        return wave.multiply(X_owned)
    if wave is not None and wave.is_complex:
        return wave.multiply(X_owned) if np.iscomplexobj(X_owned) else real_columns(wave.multiply(complex_columns(X_owned)))
    if np.iscomplexobj(X_owned):
        return complex_columns(multiply(A, real_columns(X_owned)))
    if X_owned.shape[1] == 0:
        return np.zeros((A.getLocalSize()[0], 0), order="F")
    return times(A, X_owned)


def wave_matrix(A: PETSc.Mat) -> WaveMatrix | None:
    """Return the factors of a matrix of one nodal diameter; None for a matrix with entries.  Local."""
    return A.getPythonContext() if A.getType() == "python" else None


def explicit(A: PETSc.Mat) -> PETSc.Mat:
    """Return a matrix with its entries, which the caller destroys if it is not A itself.  Collective."""
    wave = wave_matrix(A)
    return A if wave is None else wave.explicit()


def entries_owned(A: PETSc.Mat) -> float:
    """Return the number of entries of a matrix on this rank, in memory; none of products with another one.  Local."""
    return 0.0 if wave_matrix(A) is not None else A.getInfo(PETSc.Mat.InfoType.LOCAL)["nz_used"]


def frobenius_norm(A: PETSc.Mat) -> float:
    """Return the norm of a matrix, of one nodal diameter that of the sector: once for all in lockstep.  Collective."""
    wave = wave_matrix(A)
    return at_once(_norms, A if wave is None else wave.A, is_cheap=True)


def _norms(matrices: Sequence[PETSc.Mat]) -> list[float]:
    """Return the norms of matrices, many of them the same one.  Collective."""
    norms = {A.handle: A.norm(PETSc.NormType.FROBENIUS) for A in {A.handle: A for A in matrices}.values()}
    return [norms[A.handle] for A in matrices]


def gram(comm: MPI.Comm, X_owned: np.ndarray, Y_owned: np.ndarray) -> np.ndarray:
    """Return X^H Y, (m_x, m_y), on every rank.  Collective on ``comm``: one sum."""
    return summed(comm, X_owned.conj().T @ Y_owned)


def column_norms(comm: MPI.Comm, X_owned: np.ndarray) -> np.ndarray:
    """Return the Euclidean norm of each column, (m,), on every rank.  Collective on ``comm``: one sum."""
    X_owned = real_columns(X_owned) if np.iscomplexobj(X_owned) else X_owned
    return np.sqrt(summed(comm, np.einsum("ij,ij->j", X_owned, X_owned)))


def diagonal_owned(A: PETSc.Mat) -> np.ndarray:
    """Return this rank's part of diag(A), (n_owned,).  Collective."""
    vector = A.getDiagonal()
    diagonal = vector.getArray().copy()
    vector.destroy()
    return diagonal


def add_springs(K: PETSc.Mat, springs: sp.csr_matrix) -> PETSc.Mat:
    """Return K plus a small symmetric matrix known on every rank, as a new AIJ matrix flagged as SPD.

    Collective on K's communicator.
    """
    K_L = _on_rows_of(K, springs)
    K_L.axpy(1.0, K, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    K_L.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    K_L.setOption(PETSc.Mat.Option.SPD, True)
    return K_L


def add_to(K: PETSc.Mat, springs: sp.csr_matrix) -> None:
    """Add a small symmetric matrix known on every rank to K.  Collective on K's communicator."""
    S = _on_rows_of(K, springs)
    K.axpy(1.0, S, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    S.destroy()
    K.setOption(PETSc.Mat.Option.SYMMETRIC, True)


def _on_rows_of(K: PETSc.Mat, springs: sp.csr_matrix) -> PETSc.Mat:
    """Return a small matrix known on every rank as an AIJ matrix, its rows split as K's.  Collective on K's communicator."""
    owned = springs[slice(*K.getOwnershipRange())]
    owned.sort_indices()
    csr = (owned.indptr.astype(PETSc.IntType), owned.indices.astype(PETSc.IntType), owned.data)
    return PETSc.Mat().createAIJ(K.getSizes(), csr=csr, comm=K.comm)
