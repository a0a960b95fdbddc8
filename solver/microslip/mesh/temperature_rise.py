"""Temperature rises at the nodes of bodies, from a field of the mesh or a CSV file.  Local, rank 0."""

import numpy as np

from ..formats.csv_table import read_table
from ..messages.errors import CaseError, MeshError
from ..messages.words import counted
from ..tables.constant_loads import Temperature
from ..tables.structure_tables import StructureTables
from .data import Mesh
from .locate import nodes_numbered
from .values import field_at_nodes


def temperature_rises(mesh: Mesh, tables: StructureTables) -> dict[str, float | np.ndarray]:
    """Return the temperature of each body [K above the stress-free temperature], uniform or at all nodes, (n_nodes,).

    Raises
    ------
    CaseError : a faulty file
    MeshError : the field does not exist, or a node of the body has no value
    """
    if tables.statics is None:
        return {}
    return {tables.body_of[entry.group]: _of_body(mesh, entry) for entry in tables.statics.temperatures}


def _of_body(mesh: Mesh, stated: Temperature) -> float | np.ndarray:
    """Return the temperature rise of a body: uniform, or at all nodes if given by a field or a file."""
    if stated.temperature is not None:
        return stated.temperature
    group, path = stated.group, stated.file_of("file")
    nodes = np.unique(np.concatenate([block.nodes.ravel() for block in mesh.elements if block.group == group]))
    where = f'[[statics.temperatures]] group = "{group}"'
    if stated.field is not None:
        return field_at_nodes(mesh, stated.field, nodes, f"{mesh.path}: {where} field", "the body")
    if path is None:
        raise ValueError(f"{where} states no temperature")
    table, lines = read_table(path, ("node", "temperature"), (), "node")
    rise = np.full(len(mesh.points), np.nan)
    rise[nodes_numbered(mesh.numbers, table["node"], lines, path)] = table["temperature"]
    named, count = np.unique(table["node"], return_counts=True)
    if (count > 1).any():
        raise CaseError(f"{path}: node {named[np.argmax(count)]:g} has {count.max()} rows; each needs one")
    missing = nodes[np.isnan(rise[nodes])]
    if len(missing):
        raise MeshError(
            f"{path}: {where}: {len(missing)} of {counted(len(nodes), 'node')} of the body have no row, the first is node "
            f"{mesh.numbers[missing[0]]}"
        )
    return rise
