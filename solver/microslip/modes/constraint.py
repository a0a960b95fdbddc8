"""Static columns with the stored factor, many right-hand sides at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..parallel.ownership import summed

if TYPE_CHECKING:
    from ..linear.joint_springs import Linearised

_BATCH, _FEWEST = 128, 16  # largest and smallest batch of right-hand sides; larger ones are no faster (docs/validation.md)
_BATCH_BYTES = 2.5e8  # of a batch of solutions over all ranks, or of entries of the inverse
_FEW = 16  # right-hand sides up to which solves are as fast as entries of the inverse
_MOST_ENTRIES = 3  # columns of the inverse per right-hand side: each costs a sixth to a third of a solve
_MOST_ROWS = 0.1  # fraction of the rows of the inverse: with fewer rows, a smaller part of the factor is traversed
_AGREE = 1e-9  # difference of entries of the inverse from a solve, for columns of size 1


@dataclass(frozen=True, eq=False)
class RowSums:
    """Check sums of left @ K_L^-1 @ right from a checked solve: sums of the rows of each column with random weights.

    K_L is symmetric, so that the weighted sums of all columns are one solution, right^T K_L^-1 left^T w.
    """

    weights: np.ndarray  # (m_l,) w, of either sign
    sums: np.ndarray  # (m_r,) w^T left @ K_L^-1 @ right

    def of(self, columns: np.ndarray) -> RowSums:
        """Return the check sums of some columns.  Local."""
        return replace(self, sums=self.sums[columns])

    def agree(self, product: np.ndarray) -> bool:
        """Return whether a product (m_l, m_r) has these sums, with each column scaled to size 1.  Local.

        With random signs the expected square of the difference of a sum is the squared error of the column, so that a wrong
        column is detected.
        """
        with np.errstate(divide="ignore", invalid="ignore"):  # a column of zeros never agrees
            difference = (self.weights @ product - self.sums) / np.linalg.norm(product, axis=0)
        return bool(np.linalg.norm(difference) <= _AGREE * np.sqrt(len(difference)))


def static_columns(
    linearised: Linearised,
    left: sp.csr_matrix,
    right: sp.csc_matrix,
    row_ranges: np.ndarray | None = None,
    known: RowSums | None = None,
) -> np.ndarray:
    """Return left @ K_L^-1 @ right.

    Collective on the system's communicator: one sum over the ranks per batch.

    Parameters
    ----------
    left : (m_l, n_dof), the same on every rank; for example R, or the output rows
    right : (n_dof, m_r), the same on every rank; for example R^T, or the loads
    row_ranges : (size + 1,); if given, rank r receives rows row_ranges[r]:row_ranges[r + 1] only
    known : check sums of the product; without them an additional solve checks the product, where needed

    Returns
    -------
    product : (m_l, m_r), or this rank's rows of it [1/(N/m) times the units of left and right]

    Notes
    -----
    K_L is symmetric: the right-hand sides are ``left^T`` or ``right``, whichever has fewer non-zero columns.
    """
    left, right = sp.csr_matrix(left), sp.csc_matrix(right)
    rows = slice(None) if row_ranges is None else slice(*row_ranges[linearised.system.comm.rank :][:2])
    if np.count_nonzero(np.diff(left.indptr)) < np.count_nonzero(np.diff(right.indptr)):
        return np.ascontiguousarray(_solve_right(linearised, right.T.tocsr(), left.T.tocsc(), slice(None), None).T[rows])
    return _solve_right(linearised, left, right, rows, known)


def _solve_right(
    linearised: Linearised, left: sp.csr_matrix, right: sp.csc_matrix, rows: slice, known: RowSums | None
) -> np.ndarray:
    """Return ``rows`` of left @ K_L^-1 @ right by solves for the non-zero columns of ``right``.  Collective."""
    loaded = np.flatnonzero(np.diff(right.indptr))
    product = np.zeros((len(range(*rows.indices(left.shape[0]))), right.shape[1]))
    entries = _by_inverse(linearised, left, right[:, loaded], rows, known and known.of(loaded))
    product[:, loaded] = entries if entries is not None else _by_solves(linearised, left, right[:, loaded], rows)
    return product


def _by_solves(linearised: Linearised, left: sp.csr_matrix, right: sp.csc_matrix, rows: slice) -> np.ndarray:
    """Return ``rows`` of left @ K_L^-1 @ right by one solve per column.  Collective."""
    comm, (n_dof, m) = linearised.system.comm, right.shape
    left_owned = left[:, slice(*linearised.K_L.getOwnershipRange())]
    batch = int(np.clip(_BATCH_BYTES / (8 * n_dof), _FEWEST, _BATCH))
    product = np.empty((len(range(*rows.indices(left.shape[0]))), m))
    for start in range(0, m, batch):
        columns = slice(start, start + batch)
        X_owned = linearised.factor.solve(right[:, columns])
        product[:, columns] = summed(comm, left_owned @ X_owned)[rows]
    return product


def _by_inverse(
    linearised: Linearised, left: sp.csr_matrix, right: sp.csc_matrix, rows: slice, known: RowSums | None
) -> np.ndarray | None:
    """Return ``rows`` of left @ K_L^-1 @ right from the required entries of K_L^-1, checked by ``known`` or a solve.

    Collective.  None, on every rank, if solves are faster, or the entries are not available or not accurate.
    """
    comm, factor, (n_dof, m) = linearised.system.comm, linearised.factor, right.shape
    seen, forced = np.unique(left.indices), np.unique(right.indices)
    if m <= _FEW or len(forced) > _MOST_ENTRIES * m or len(seen) > _MOST_ROWS * n_dof:
        return None
    product = factor.flexibility(left, right)
    if product is None:
        product = _by_entries(linearised, left, right, seen, forced)
    if product is None:
        return None
    product = np.ascontiguousarray(product) if comm.rank == 0 else np.empty((left.shape[0], m))
    comm.Bcast(product)
    is_right = known is not None and comm.bcast(known.agree(product))
    return product[rows] if is_right or _agrees(linearised, left, right, product) else None


def _by_entries(
    linearised: Linearised, left: sp.csr_matrix, right: sp.csc_matrix, seen: np.ndarray, forced: np.ndarray
) -> np.ndarray | None:
    """Return left @ K_L^-1 @ right on rank 0 from entries of K_L^-1 in the rows ``seen`` and columns ``forced``.  Collective."""
    comm, of_seen, of_forced = linearised.system.comm, left[:, seen], right[forced]
    product = np.zeros((left.shape[0], right.shape[1]))
    batch = max(int(_BATCH_BYTES / (8 * len(seen))), 1)
    for start in range(0, len(forced), batch):
        columns = slice(start, start + batch)
        entries = linearised.factor.inverse_entries(seen, forced[columns])
        if entries is None:
            return None
        if comm.rank == 0:
            product += (of_forced[columns].T @ (of_seen @ entries).T).T
    return product


def _agrees(linearised: Linearised, left: sp.csr_matrix, right: sp.csc_matrix, product: np.ndarray) -> bool:
    """Return whether left @ K_L^-1 @ right is ``product``, by a random sum of its columns.  Collective: one checked solve.

    Columns are scaled to size 1 with random signs, so that the expected square of the difference is the sum of all squared
    errors, and a single wrong column is detected.
    """
    comm, owned = linearised.system.comm, slice(*linearised.K_L.getOwnershipRange())
    size = np.linalg.norm(product, axis=0)
    signs = np.random.default_rng(len(size)).choice([-1.0, 1.0], len(size))
    z = np.divide(signs, size, out=np.zeros_like(size), where=size > 0.0)
    x_owned = linearised.factor.solve((right.tocsr()[owned] @ z)[:, None])
    solved = summed(comm, left[:, owned] @ x_owned)[:, 0]
    return bool(comm.bcast(np.linalg.norm(product @ z - solved) <= _AGREE * np.sqrt(len(size))))
