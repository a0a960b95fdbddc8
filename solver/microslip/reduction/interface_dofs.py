"""The degrees of freedom of both bodies at every pair, from R."""

import numpy as np
import scipy.sparse as sp


def interface_dofs(R: sp.csr_matrix) -> np.ndarray:
    """Return the DOFs of the pairs' motion, ascending: 6 per pair, fewer if pairs share DOFs or some are fixed.  Local."""
    return np.unique(R.indices[R.data != 0.0])


def unit_columns(dofs: np.ndarray, n_dof: int) -> sp.csc_matrix:
    """Return a unit column for each of ``dofs``, (n_dof, m).  Local."""
    m = len(dofs)
    return sp.csc_matrix((np.ones(m), (dofs, np.arange(m))), shape=(n_dof, m))
