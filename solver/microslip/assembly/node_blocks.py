"""Sum element matrices into sparse rows: 3 x 3 blocks between nodes first, single rows of the free DOFs at the end."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..mesh.data import DistributedMesh, LocalBlock
from ._expand import expand_blocks

_CHUNK_BYTES = 8e6  # of element stiffness matrices held at a time


def element_chunks(block: LocalBlock):
    """Yield slices of a block's elements whose matrices take a bounded memory.  Local."""
    n_chunk = max(1, int(_CHUNK_BYTES / (8 * (3 * block.nodes.shape[1]) ** 2)))
    for start in range(0, len(block.nodes), n_chunk):
        yield slice(start, start + n_chunk)


@dataclass(frozen=True)
class NodePattern:
    """Which nodes the owned nodes are coupled to; a compressed row per owned node, columns sorted."""

    row_start: int  # first owned node, rank-ordered
    indptr: np.ndarray  # (n_owned + 1,)
    indices: np.ndarray  # (n_blocks,) rank-ordered column nodes
    keys: np.ndarray  # (n_blocks,) row * n_nodes + column, rising; row counted from row_start
    n_nodes: int  # of the whole mesh

    def positions(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return which element rows are owned, (n_elements, n), and where their blocks lie, (n_rows, n)."""
        n_owned = len(self.indptr) - 1
        rows = nodes - self.row_start
        is_owned = (rows >= 0) & (rows < n_owned)
        element, local = np.nonzero(is_owned)
        wanted = rows[element, local][:, None] * self.n_nodes + nodes[element]
        # Elements come along the mesh, so a chunk's rows are near each other: search among them only.
        owned_rows = rows[is_owned]
        if len(owned_rows) == 0:
            return is_owned, np.zeros((0, nodes.shape[1]), dtype=np.int64)
        first, last = self.indptr[owned_rows.min()], self.indptr[owned_rows.max() + 1]
        return is_owned, first + np.searchsorted(self.keys[first:last], wanted)


def node_pattern(dmesh: DistributedMesh) -> NodePattern:
    """Return the coupling of this rank's nodes.  Local."""
    row_start, row_end = dmesh.node_ranges[dmesh.comm.rank : dmesh.comm.rank + 2]
    n_nodes, n_owned = int(dmesh.node_ranges[-1]), int(row_end - row_start)
    counts = [np.full(len(block.nodes), block.nodes.shape[1]) for block in dmesh.blocks]
    indices = [block.nodes.ravel() for block in dmesh.blocks]
    indptr = np.concatenate([[0], np.cumsum(np.concatenate(counts))]) if counts else np.zeros(1, dtype=np.int64)
    column = np.concatenate(indices) if indices else np.zeros(0, dtype=np.int64)
    touches = sp.csr_matrix((np.ones(len(column), dtype=np.int32), column, indptr), (len(indptr) - 1, n_nodes))
    coupling = (touches[:, row_start:row_end].T @ touches).tocsr()
    coupling.sort_indices()
    row = np.repeat(np.arange(n_owned), np.diff(coupling.indptr))
    keys = row * n_nodes + coupling.indices
    return NodePattern(int(row_start), coupling.indptr.astype(np.int64), coupling.indices, keys, n_nodes)


class BlockSum:
    """Sums of element matrices per pair of nodes, ``data[i, j]`` component i of the row, j of the column node."""

    def __init__(self, pattern: NodePattern, n_components: int):
        self.data = np.zeros((n_components, n_components, len(pattern.indices)))

    def add(self, is_owned: np.ndarray, positions: np.ndarray, matrices: np.ndarray) -> None:
        """Add element matrices (n_elements, n, n_components, n, n_components) at ``positions`` of their owned rows."""
        if positions.size == 0:
            return
        first = positions.min()
        shifted = (positions - first).ravel()
        n_components = len(self.data)
        for i in range(n_components):
            for j in range(n_components):
                total = np.bincount(shifted, weights=matrices[:, :, i, :, j][is_owned].ravel())
                self.data[i, j, first : first + len(total)] += total


def expand(pattern: NodePattern, total: BlockSum, dof: np.ndarray, integer) -> tuple[np.ndarray, ...]:
    """Return (indptr, columns, values) of the owned rows of free DOFs.  Local.

    Parameters
    ----------
    total : sums of 3 x 3 blocks, or of one component: multiples of the unit block, which couple equal directions only
    dof : (n_nodes, 3) row of each rank-ordered node, -1 where fixed
    integer : type of indptr and columns
    """
    n_owned, row_start = len(pattern.indptr) - 1, pattern.row_start
    n_rows, n_most = np.count_nonzero(dof[row_start : row_start + n_owned] >= 0), 3 * len(total.data) * len(pattern.indices)
    indptr, columns, values = (
        np.empty(n_rows + 1, integer),
        np.empty(n_most + 1, integer),
        np.empty(n_most + 1),
    )  # 1 to write beyond
    rows, nodes = np.ascontiguousarray(dof, dtype=integer), pattern.indices.astype(np.int64, copy=False)
    n = expand_blocks(pattern.indptr, nodes, total.data, rows, row_start, indptr, columns, values)
    return indptr, columns[:n], values[:n]
