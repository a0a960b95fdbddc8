"""Outputs as rows over the nodes: a displacement along a direction, or a component of stress or strain at a node."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .. import elements
from ..mesh.data import Mesh
from ..mesh.links import Links, places_of
from ..messages.errors import CaseError
from ..tables.structure_tables import StructureTables
from ..tables.vibration import Output


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
