"""Connected parts of nodes: by the cells that share them, or by links."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components


def parts_of(cells: Sequence[np.ndarray], n: int) -> tuple[int, np.ndarray]:
    """Return the number of connected parts of n nodes and the part of each, (n,); a node without cells is a part.  Local.

    ``cells`` are arrays (n_cells, n_nodes); the nodes of a cell belong to one part.
    """
    first = np.concatenate([np.repeat(of_kind[:, 0], of_kind.shape[1] - 1) for of_kind in cells])
    other = np.concatenate([of_kind[:, 1:].ravel() for of_kind in cells])
    return components(first, other, n)


def components(first: np.ndarray, second: np.ndarray, n: int) -> tuple[int, np.ndarray]:
    """Return the number of connected parts of n nodes linked in pairs, and the part of each, (n,).  Local."""
    graph = sp.coo_matrix((np.ones(len(first), dtype=np.int8), (first, second)), (n, n))
    return connected_components(graph, directed=False)
