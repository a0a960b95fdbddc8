"""Partition of the mesh over the ranks: METIS parts of the elements, owners of the nodes, elements of each rank."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

from .. import elements
from ..parallel import metis
from ..parallel.agree import on_root
from ..tables.structure_tables import StructureTables
from .data import DistributedMesh, LocalBlock, Mesh
from .values import temperature_rises

if TYPE_CHECKING:
    from mpi4py import MPI

_FACE_CORNERS = 3  # elements that share this many corners share a face


def distribute(mesh: Mesh | None, tables: StructureTables, comm: MPI.Comm) -> DistributedMesh:
    """Give every rank a contiguous range of nodes and all elements that touch one of them.

    Collective on ``comm``: one broadcast (the node order) and one scatter (the elements).

    Parameters
    ----------
    mesh : the whole mesh on rank 0, None elsewhere

    Notes
    -----
    A node at the border of several parts is owned by the lowest of them, so that only this part assembles the
    elements of both sides.  A rank may own no node.
    """
    shares: list[tuple[LocalBlock, ...]] = []

    def plan():
        assert mesh is not None, "rank 0 has it"
        graph = _dual_graph(mesh)
        part, split_by = _parts(mesh, graph, comm.size)
        order, rank_order, node_ranges = _order(mesh, graph, part, comm.size)
        shares.extend(_shares(mesh, tables, order, rank_order, node_ranges))
        return node_ranges, rank_order, split_by

    node_ranges, rank_order, split_by = on_root(comm, plan)
    blocks = comm.scatter(shares)
    return DistributedMesh(comm, node_ranges, rank_order, blocks, split_by)


def _dual_graph(mesh: Mesh) -> sp.csr_matrix:
    """Return the graph of elements that share a face, (n_elements, n_elements)."""
    corners = [block.nodes[:, : elements.KINDS[block.kind].n_corners] for block in mesh.elements]
    counts = np.concatenate([np.full(len(nodes), nodes.shape[1]) for nodes in corners])
    indices = np.concatenate([nodes.ravel() for nodes in corners])
    indptr = np.concatenate([[0], np.cumsum(counts)])
    touches = sp.csr_matrix((np.ones(len(indices), dtype=np.int32), indices, indptr), (len(counts), len(mesh.points)))
    shared = (touches @ touches.T).tocoo()
    is_face = (shared.data >= _FACE_CORNERS) & (shared.row != shared.col)
    return sp.csr_matrix((shared.data[is_face], (shared.row[is_face], shared.col[is_face])), shared.shape)


def _order(mesh: Mesh, graph: sp.csr_matrix, part: np.ndarray, n_ranks: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return element order, rank-ordered number of every node, and the node ranges of the ranks.

    Elements are ordered by Cuthill-McKee; a rank's nodes are numbered in the order in which these elements first
    touch them, so that neighbours have similar numbers.
    """
    order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    node, element = _incidence(mesh)
    n_nodes = len(mesh.points)
    owner = _lowest(part[element], node, n_nodes)
    touched = _lowest(_inverse(order)[element], node, n_nodes)
    rank_order = np.empty(n_nodes, dtype=np.int64)
    rank_order[np.lexsort((np.arange(n_nodes), touched, owner))] = np.arange(n_nodes)
    node_ranges = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=n_ranks))])
    return order, rank_order, node_ranges


def _inverse(order: np.ndarray) -> np.ndarray:
    position = np.empty_like(order)
    position[order] = np.arange(len(order))
    return position


def _lowest(value: np.ndarray, node: np.ndarray, n_nodes: int) -> np.ndarray:
    """Return the lowest value at every node; each node occurs."""
    falling = np.argsort(value, kind="stable")[::-1]
    lowest = np.empty(n_nodes, dtype=value.dtype)
    lowest[node[falling]] = value[falling]  # the last assignment, of the lowest value, remains
    return lowest


def _parts(mesh: Mesh, graph: sp.csr_matrix, n_ranks: int) -> tuple[np.ndarray, str]:
    """Return the part of every element, balanced by number of nodes, and the method: METIS for more than one part."""
    n_elements = graph.shape[0]
    n_parts = min(n_ranks, n_elements)
    if n_parts == 1:
        return np.zeros(n_elements, dtype=np.int64), "one part"
    weights = np.concatenate([np.full(len(block.nodes), block.nodes.shape[1]) for block in mesh.elements])
    return metis.partition(graph, n_parts, weights), metis.NAME


def _incidence(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return node and element (counted over all blocks) of every corner and mid-side node."""
    node = np.concatenate([block.nodes.ravel() for block in mesh.elements])
    n_nodes = np.concatenate([np.full(len(block.nodes), block.nodes.shape[1]) for block in mesh.elements])
    return node, np.repeat(np.arange(len(n_nodes)), n_nodes)


def _shares(mesh: Mesh, tables: StructureTables, order, rank_order, node_ranges) -> list[tuple[LocalBlock, ...]]:
    """Return every rank's blocks: all elements that touch one of its nodes, along the element order."""
    n_ranks, body_of, rises = len(node_ranges) - 1, tables.body_of, temperature_rises(mesh, tables)
    position = _inverse(order)
    shares: list[list[LocalBlock]] = [[] for _ in range(n_ranks)]
    start = 0
    for block in mesh.elements:
        n_elements = len(block.nodes)
        nodes = rank_order[block.nodes]
        owner = np.searchsorted(node_ranges, nodes, side="right") - 1
        along = np.argsort(position[start : start + n_elements])
        start += n_elements
        for rank in range(n_ranks):
            rows = along[(owner[along] == rank).any(axis=1)]
            if len(rows):
                of_mesh, rise = block.nodes[rows], rises.get(body_of[block.group], 0.0)
                rise = rise[of_mesh] if isinstance(rise, np.ndarray) else rise
                body = body_of[block.group]
                shares[rank].append(LocalBlock(block.kind, body, nodes[rows], mesh.points[of_mesh], block.numbers[rows], rise))
    return [tuple(share) for share in shares]
