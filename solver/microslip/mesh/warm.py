"""Temperatures at the nodes of bodies, from a field of the mesh or a CSV file.  Local, rank 0."""

from __future__ import annotations

import numpy as np

from ..formats.csv_table import read_table
from ..messages.errors import CaseError, MeshError
from .data import Mesh
from .locate import nodes_numbered
from .nodal_fields import field_at_nodes
from .settings import MeshSettings, Warm


def temperatures_of(mesh: Mesh, settings: MeshSettings) -> dict[str, float | np.ndarray]:
    """Return the temperature of each body [K above that without stress], one or those of all nodes, (n_nodes,).

    Raises
    ------
    CaseError : a file at fault
    MeshError : no such field, or a node of the body without a value
    """
    if settings.statics is None:
        return {}
    given = settings.statics.temperatures.items()
    return {name: _at_nodes(mesh, settings, name, warm) if isinstance(warm, Warm) else warm for name, warm in given}


def _at_nodes(mesh: Mesh, settings: MeshSettings, body: str, warm: Warm) -> np.ndarray:
    group = settings.bodies[body].group
    nodes = np.unique(np.concatenate([block.nodes.ravel() for block in mesh.elements if block.group == group]))
    where = f'[[statics.temperatures]] group = "{group}"'
    if warm.field is not None:
        return field_at_nodes(mesh, warm.field, nodes, f"{mesh.path}: {where} field", "the body")
    assert warm.file is not None, "a field or a file"
    table, lines = read_table(warm.file, ("node", "temperature"), (), "node")
    found = np.full(len(mesh.points), np.nan)
    found[nodes_numbered(mesh.numbers, table["node"], lines, warm.file)] = table["temperature"]
    named, count = np.unique(table["node"], return_counts=True)
    if (count > 1).any():
        raise CaseError(f"{warm.file}: node {named[np.argmax(count)]:g} has {count.max()} rows; each needs one")
    missing = nodes[np.isnan(found[nodes])]
    if len(missing):
        raise MeshError(
            f"{warm.file}: {where}: {len(missing)} of {len(nodes)} nodes of the body have no row, the first is node "
            f"{mesh.numbers[missing[0]]}"
        )
    return found
