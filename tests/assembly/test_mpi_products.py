"""Products of sparse matrices with few and many columns against SciPy, on any partition of the rows."""

import numpy as np
import pytest
import scipy.sparse as sp
from petsc4py import PETSc

from microslip.assembly.products import times

COMM = PETSc.COMM_WORLD
N, COLUMNS = 37, 29


def _distributed(S: sp.csr_matrix, rows: np.ndarray, columns: np.ndarray) -> PETSc.Mat:
    """Return S as a PETSc matrix; ``rows`` and ``columns`` (size + 1,) are the ownership ranges."""
    r, owned = COMM.rank, S[rows[COMM.rank] : rows[COMM.rank + 1]]
    sizes = ((int(rows[r + 1] - rows[r]), S.shape[0]), (int(columns[r + 1] - columns[r]), S.shape[1]))
    csr = (owned.indptr.astype(PETSc.IntType), owned.indices.astype(PETSc.IntType), owned.data)
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=COMM)


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("m", [0, 1, 7, 8, 24, 30])
@pytest.mark.parametrize("has_empty_rank", [False, True])
def test_products_equal_those_of_scipy(m, has_empty_rank):
    """The matrix is rectangular, and a rank may have no rows; products are correct after its entries and its pattern change."""
    random = np.random.default_rng(3)
    S = sp.random(N, COLUMNS, 0.2, "csr", random_state=random)
    S.sort_indices()
    rows, columns = (np.linspace(0, n, COMM.size + 1).astype(int) for n in (N, COLUMNS))
    if has_empty_rank:
        rows[:-1], columns[:-1] = 0, 0
    A, X = _distributed(S, rows, columns), random.normal(size=(COLUMNS, m))
    here, X_owned = slice(*rows[COMM.rank : COMM.rank + 2]), X[slice(*columns[COMM.rank : COMM.rank + 2])]
    np.testing.assert_allclose(times(A, X_owned), (S @ X)[here], atol=1e-13)
    A.scale(2.0)
    np.testing.assert_allclose(times(A, X_owned), (2.0 * S @ X)[here], atol=1e-13)
    ones = _distributed(sp.csr_matrix(np.ones((N, COLUMNS))), rows, columns)
    A.axpy(1.0, ones, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    np.testing.assert_allclose(times(A, X_owned), ((2.0 * S + np.ones((N, COLUMNS))) @ X)[here], atol=1e-13)
    ones.destroy()
    A.destroy()
