"""Number the free degrees of freedom: contiguous per rank, node after node."""

import numpy as np

from ..mesh.data import DistributedMesh


def number_dofs(dmesh: DistributedMesh, is_fixed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the row of every DOF and the row ranges of the ranks.  Local; the same on every rank.

    Parameters
    ----------
    is_fixed : (n_nodes, 3) bool, by rank-ordered node

    Returns
    -------
    dof : (n_nodes, 3) row of each rank-ordered node, -1 where fixed
    row_ranges : (size + 1,) rank r owns rows row_ranges[r]:row_ranges[r + 1]
    """
    rows_before = np.concatenate([[0], np.cumsum(~is_fixed.ravel())])
    dof = np.where(is_fixed, -1, rows_before[:-1].reshape(is_fixed.shape))
    return dof, rows_before[3 * dmesh.node_ranges]
