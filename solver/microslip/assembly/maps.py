"""The sparse maps between DOFs and contact pairs, loads and outputs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .. import elements
from ..mesh.data import ContactPairs, Mesh
from ..mesh.links import Links, places_of
from ..messages.errors import CaseError
from ..tables.structure_tables import StructureTables
from ..tables.vibration import Load, Output
from .nodal_forces import NodalForces


@dataclass(frozen=True)
class OutputRow:
    """One output as a sum over nodes."""

    at: int  # the node where it is, index into Mesh.points; -1 of one that has no node
    nodes: np.ndarray  # (n,) index into Mesh.points; a node may be there several times
    values: np.ndarray  # (n, 3) coefficients of the displacement of each node


def output_row(mesh: Mesh, output: Output, tables: StructureTables, links: Links | None = None) -> OutputRow:
    """Return the row of an output; an empty one of a contact force, which is known with the pairs.  Local, rank 0.

    Raises
    ------
    MeshError, CaseError : no such node, or a stress at a node where it jumps
    """
    where = f"[[outputs]] {output.name!r}"
    if output.joint is not None:
        return OutputRow(-1, np.zeros(0, dtype=int), np.zeros((0, 3)))
    (node,) = places_of(mesh, links, output, where)
    if output.quantity in ("stress", "strain"):
        return _recovered(mesh, int(node), output, tables, where)
    return OutputRow(int(node), np.array([node]), np.array([output.direction or output.rotation], dtype=float))


def _recovered(mesh: Mesh, node: int, output: Output, tables: StructureTables, where: str) -> OutputRow:
    """Return a component at a node, the mean over the elements around it, docs/theory.md, eq. (13.6)."""
    around = _elements_around(mesh, node, output, tables.sections, tables.body_of, where)
    i, j = ("xyz".index(axis) for axis in output.component or "")
    nodes, values = [], []
    for kind, elements_of_kind, body in around:
        recovered = elements.nodal_stress if output.quantity == "stress" else elements.nodal_strain
        rows = recovered(body.solids(kind, mesh.points[elements_of_kind][None]))
        nodes.append(elements_of_kind)
        values.append(rows[int(np.flatnonzero(elements_of_kind == node)[0]), i, j] / len(around))
    return OutputRow(node, np.concatenate(nodes), np.concatenate(values))


def _elements_around(
    mesh: Mesh, node: int, output: Output, bodies: Mapping[str, elements.SolidSection], body_of: Mapping[str, str], where: str
) -> list[tuple[str, np.ndarray, elements.SolidSection]]:
    """Return kind, nodes and body of the elements that share a node, of the body that the output names where it does."""
    around = []
    for block in mesh.elements:
        name = body_of[block.group]
        if output.body in (None, name):
            around += [(name, block.kind, nodes) for nodes in block.nodes[(block.nodes == node).any(axis=1)]]
    names = list(dict.fromkeys(name for name, _, _ in around))
    materials = {bodies[name].material.elastic for name in names}
    if not around:
        raise CaseError(f"{where} body = {output.body!r}: node {mesh.numbers[node]} is not one of its nodes")
    if len(materials) > 1:
        raise CaseError(
            f"{where}: node {mesh.numbers[node]} belongs to the bodies {', '.join(names)}, of different materials, between which "
            f"{output.quantity} jumps; name one of them, body = ..."
        )
    return [(kind, nodes, bodies[name]) for name, kind, nodes in around]


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
