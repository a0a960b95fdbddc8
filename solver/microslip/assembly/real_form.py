"""Complex matrices and vectors as real ones of twice the size, for PETSc, SLEPc and MUMPS with real numbers.

Row j of a complex vector becomes the rows 2 j (real part) and 2 j + 1 (imaginary part), an entry a + i b of a matrix the block
[[a, -b], [b, a]].  A Hermitian matrix becomes a symmetric one, in which each eigenvalue appears twice: z and i z are two
vectors.  The rows of a part of the structure stay together, so that the graph is that of two sectors in a ring.
"""

import numpy as np
import scipy.sparse as sp


def real_matrix(A: sp.spmatrix) -> sp.csr_matrix:
    """Return a complex sparse matrix (m, n) in real form, (2 m, 2 n), docs/theory.md, eq. (14.4).  Local."""
    A = sp.coo_matrix(A)
    row, column = 2 * A.row.astype(np.int64), 2 * A.col.astype(np.int64)
    rows = np.concatenate([row, row + 1, row, row + 1])
    columns = np.concatenate([column, column + 1, column + 1, column])
    real = sp.csr_matrix(
        (np.concatenate([A.data.real, A.data.real, -A.data.imag, A.data.imag]), (rows, columns)), (2 * A.shape[0], 2 * A.shape[1])
    )
    real.eliminate_zeros()
    real.sort_indices()
    return real


def real_columns(z: np.ndarray) -> np.ndarray:
    """Return complex columns (n, m) in real form, (2 n, m), column-major; in the same memory if z is column-major.  Local."""
    return np.ascontiguousarray(z.T, dtype=complex).view(float).T


def complex_columns(x: np.ndarray) -> np.ndarray:
    """Return the complex columns (n, m) of a real form (2 n, m), column-major; in the same memory if x is.  Local."""
    return np.ascontiguousarray(x.T, dtype=float).view(complex).T


def real_rows(real: sp.csr_matrix, imaginary: sp.csr_matrix) -> sp.csr_matrix:
    """Return some rows of A + i B, (m, n) each by rows, in real form, (2 m, 2 n); B has few entries.  Local."""
    counts, indptr = np.diff(real.indptr), real.indptr[:-1].astype(np.int64)
    first = np.arange(real.nnz) + np.repeat(indptr, counts)  # of each entry in the row of the real part
    second = first + np.repeat(counts, counts)
    data, indices = np.empty(2 * real.nnz), np.empty(2 * real.nnz, dtype=np.int64)
    data[first], data[second] = real.data, real.data
    indices[first], indices[second] = 2 * real.indices, 2 * real.indices + 1
    ends = np.concatenate([[0], np.cumsum(np.repeat(counts, 2))])
    both = sp.csr_matrix((data, indices, ends), (2 * real.shape[0], 2 * real.shape[1]))
    if imaginary.nnz:
        both = (both + real_matrix(1j * imaginary)).tocsr()
    both.sort_indices()
    return both
