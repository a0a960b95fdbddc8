"""Static columns by the kept factor, many right-hand sides at a time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..linear.dense import summed

if TYPE_CHECKING:
    from ..linear.joint_springs import Linearised

_BATCH = 128  # right-hand sides at a time; more gain nothing (docs/validation.md)
_BATCH_BYTES = 2.5e8  # of a batch of solutions, over all ranks


def static_columns(
    linearised: Linearised, left: sp.csr_matrix, right: sp.csc_matrix, row_ranges=None, batch: int | None = None
) -> np.ndarray:
    """Return left @ K_L^-1 @ right.

    Collective on the system's communicator: one sum over the ranks a batch.

    Parameters
    ----------
    left : (m_l, n_dof), the same on every rank; for example R, or the output rows
    right : (n_dof, m_r), the same on every rank; for example R^T, or the loads
    row_ranges : (size + 1,); if given, rank r receives rows row_ranges[r]:row_ranges[r + 1] only
    batch : right-hand sides solved for together

    Returns
    -------
    product : (m_l, m_r), or this rank's rows of it [1/(N/m) times the units of left and right]

    Notes
    -----
    K_L is symmetric: whichever of ``left`` and ``right`` has fewer columns that are not zero is solved for.
    """
    left, right = sp.csr_matrix(left), sp.csc_matrix(right)
    rows = slice(None) if row_ranges is None else slice(*row_ranges[linearised.system.comm.rank :][:2])
    if np.count_nonzero(np.diff(left.indptr)) < np.count_nonzero(np.diff(right.indptr)):
        return np.ascontiguousarray(_solve_right(linearised, right.T.tocsr(), left.T.tocsc(), slice(None), batch).T[rows])
    return _solve_right(linearised, left, right, rows, batch)


def _solve_right(linearised: Linearised, left: sp.csr_matrix, right: sp.csc_matrix, rows: slice, batch: int | None) -> np.ndarray:
    """Return ``rows`` of left @ K_L^-1 @ right, solving for the columns of ``right`` that are not zero.  Collective."""
    comm, n_dof = linearised.system.comm, right.shape[0]
    row_start, row_end = linearised.K_L.getOwnershipRange()
    left_owned = left[:, row_start:row_end]
    loaded = np.flatnonzero(np.diff(right.indptr))
    batch = batch or int(np.clip(_BATCH_BYTES / (8 * n_dof), 16, _BATCH))
    product = np.zeros((len(range(*rows.indices(left.shape[0]))), right.shape[1]))
    for start in range(0, len(loaded), batch):
        columns = loaded[start : start + batch]
        X_owned = linearised.factor.solve_sparse(right[:, columns])
        product[:, columns] = summed(comm, left_owned @ X_owned)[rows]
    return product
