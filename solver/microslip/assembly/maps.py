"""The sparse maps between DOFs and contact pairs, loads and outputs."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from ..mesh.data import ContactPairs
from ..messages.errors import CaseError
from ..tables.vibration import Load, Output
from .nodal_forces import NodalForces
from .output_rows import OutputRow


def pair_map(pairs: ContactPairs, dof: np.ndarray, n_dof: int) -> sp.csr_matrix:
    """Return R, (3 n_pairs, n_dof): du = frame (u1 - u2) of every pair, u1 and u2 averages of nodes; fixed DOFs drop out.  Local.

    ``dof`` is (n_nodes, 3), the row of each node of ``Mesh.points``.  docs/theory.md, eq. (1.1).  Second sides in the next sector
    of a disc are not among it: :func:`next_pair_map`.
    """
    first, second = pairs.sides(len(dof))
    here = sp.diags((~pairs.next_sector).astype(float)) @ second
    return _tidy(_side_map(first, pairs.frame, dof, n_dof) - _side_map(here.tocsr(), pairs.frame, dof, n_dof))


def next_pair_map(pairs: ContactPairs, turn: np.ndarray, dof: np.ndarray, n_dof: int) -> sp.csr_matrix:
    """Return Q R_2, (3 n_pairs, n_dof): frame Q u2 of the pairs whose second side lies in the next sector, turned by Q.  Local.

    docs/theory.md, eq. (14.3).
    """
    _, second = pairs.sides(len(dof))
    there = (sp.diags(pairs.next_sector.astype(float)) @ second).tocsr()
    return _tidy(_side_map(there, pairs.frame @ turn, dof, n_dof))


def _side_map(weights: sp.csr_matrix, axes: np.ndarray, dof: np.ndarray, n_dof: int) -> sp.csr_matrix:
    """Return the motion of one side along the axes (n_pairs, 3, 3) of each pair, (3 n_pairs, n_dof)."""
    n = len(axes)
    pair, node = np.repeat(np.arange(n), np.diff(weights.indptr)), weights.indices
    row = np.broadcast_to(3 * pair[:, None, None] + np.arange(3)[:, None], (len(pair), 3, 3))
    column = np.broadcast_to(dof[node][:, None, :], row.shape)
    value = weights.data[:, None, None] * axes[pair]
    free = column >= 0
    return sp.csr_matrix((value[free], (row[free], column[free])), (3 * n, n_dof))


def _tidy(R: sp.csr_matrix) -> sp.csr_matrix:
    """Return a map without stored zeros, columns rising."""
    R.eliminate_zeros()
    R.sort_indices()
    return R


def load_map(loads: Sequence[NodalForces], dof: np.ndarray, n_dof: int) -> sp.csc_matrix:
    """Return one column per real shape of the loads, (n_dof, n_loads): the forces at unit level [N/N].  Local.

    Raises
    ------
    CaseError : a load acts on fixed DOFs only; the same on every rank
    """
    columns = []
    for i, load in enumerate(loads, 1):
        rows = [_row(shape, load.nodes, dof, n_dof) for shape in load.shapes]
        if not any(column.count_nonzero() for column in rows):
            raise CaseError(f"[[loads]] {i} acts only on degrees of freedom that a support fixes; it moves nothing")
        columns += rows
    return sp.vstack(columns).T.tocsc() if columns else sp.csc_matrix((n_dof, 0))


def output_map(outputs: Sequence[OutputRow], dof: np.ndarray, n_dof: int) -> sp.csr_matrix:
    """Return one row per output, (n_outputs, n_dof); a fixed DOF gives zero.  Local."""
    rows = [_row(output.values, output.nodes, dof, n_dof) for output in outputs]
    return sp.vstack(rows).tocsr() if rows else sp.csr_matrix((0, n_dof))


def orders_of(outputs: Sequence[Output]) -> np.ndarray | None:
    """Return how often each output is differentiated, (n_outputs,); None where none is.  Local."""
    orders = np.array([output.order for output in outputs], dtype=int)
    return orders if orders.any() else None


def base_map(outputs: Sequence[Output], loads: Sequence[Load]) -> np.ndarray:
    """Return the acceleration of the base along each absolute output under each shape of the loads, (n_outputs, n_loads) [m/s2].

    Local.  docs/theory.md, eq. (13.5).
    """
    shapes = [load.base_acceleration or (0.0, 0.0, 0.0) for load in loads for _ in load.phases]
    directions = [(output.absolute and output.direction) or (0.0, 0.0, 0.0) for output in outputs]
    return np.array(directions, dtype=float) @ np.array(shapes, dtype=float).T


def _row(values: np.ndarray, nodes: np.ndarray, dof: np.ndarray, n_dof: int) -> sp.csr_matrix:
    """Return the values (n, 3) of the DOFs of ``nodes`` (n,) as a row, (1, n_dof); those of a node named twice add up."""
    column, value = dof[nodes].ravel(), np.asarray(values, dtype=float).ravel()
    free = column >= 0
    row = sp.csr_matrix((value[free], (np.zeros(np.count_nonzero(free), dtype=int), column[free])), (1, n_dof))
    row.eliminate_zeros()
    return row
