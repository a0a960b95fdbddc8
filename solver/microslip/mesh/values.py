"""Parameters of the contact points of a joint: uniform, from fields of the mesh, or from a CSV file."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ..contact.laws import LAWS
from ..formats.csv_table import read_table
from ..messages.errors import CaseError, MeshError
from ..messages.words import counted, hint, place
from ..tables.constant_loads import Temperature
from ..tables.joint import Joint, OfPoints
from ..tables.structure_tables import StructureTables
from .contact_points import ContactPoints
from .data import Mesh
from .locate import nodes_numbered

FAR = 0.1  # of the extent of a joint's points: largest accepted distance of a row from its nearest point
PLACES = ("node", "x", "y", "z")


def field_at_nodes(mesh: Mesh, field: str, nodes: np.ndarray, where: str, what: str) -> np.ndarray:
    """Return a field of the mesh, (n_nodes,), with values at all ``nodes`` (n,) of ``what``.

    Raises
    ------
    MeshError : the field does not exist, or has no value at one of these nodes
    """
    if field not in mesh.fields:
        fields_text = f"it has: {', '.join(mesh.fields)}" if mesh.fields else "it has no field of one number a node at all"
        raise MeshError(f"{where} = {field!r}: there is no such field in the mesh{hint(field, mesh.fields, repr)}; {fields_text}")
    missing = nodes[np.isnan(mesh.fields[field][nodes])]
    if len(missing):
        raise MeshError(
            f"{where} = {field!r} has no value at {counted(len(missing), 'node')} of {what}, the first is "
            f"{mesh.numbers[missing[0]]}"
        )
    return mesh.fields[field]


@dataclass(frozen=True)
class Values:
    """Per unit area and contact point, (n,) each."""

    friction: np.ndarray  # -
    tangential_stiffness: np.ndarray  # N/m3
    normal_stiffness: np.ndarray  # N/m3
    preload: np.ndarray  # Pa
    gap: np.ndarray  # m; 0 if taken from the mesh


COLUMNS = tuple(Values.__dataclass_fields__)


def values_of(mesh: Mesh, joint: Joint, points: ContactPoints) -> Values:
    """Return the values of a joint's points, from the joint, then fields of the mesh, then its file.  Local, rank 0.

    Nodal values, from a field or rows of the file, are interpolated by the shape functions of the first surface.

    Raises
    ------
    CaseError : the joint's file is faulty
    MeshError : the file names nodes or places without a contact point of the joint
    """
    stated, path = joint.stated_values, joint.file_of("parameters")
    table, lines = ({}, []) if path is None else _checked_table(joint, path)
    of_nodes: dict[str, np.ndarray] = {name: _of_field(mesh, joint, points, name) for name in joint.fields}
    if "node" in table:
        of_nodes |= _of_rows(mesh, table, _rows_of_nodes(mesh, joint, path, points, table, lines), {**stated, **of_nodes})
    if of_nodes:
        where = path or f"{mesh.path}: joint {joint.name!r} fields"
        gap, preload = (of_nodes.get(name, np.full(len(mesh.points), stated[name])) for name in ("gap", "preload"))
        _check_open(where, mesh.points, gap, preload, _nodes_of(points))
    everywhere = {name: np.full(points.n_points, value) for name, value in stated.items()}
    values = _closed_or_open(Values(**everywhere | {name: _interpolated(points, nodal) for name, nodal in of_nodes.items()}))
    if not table or "node" in table:
        return values
    rows = _nearest_rows(joint, path, points, table, lines)
    values = replace(values, **{name: table[name][rows] for name in COLUMNS if name in table})
    _check_open(path, points.position, values.gap, values.preload, np.arange(points.n_points))
    return values


def _of_rows(
    mesh: Mesh, table: Mapping[str, np.ndarray], rows: np.ndarray, defaults: Mapping[str, float | np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the values of all nodes, (n_nodes,) each: from the table for the nodes ``rows``, otherwise defaults."""
    nodal = {name: np.array(np.broadcast_to(defaults[name], len(mesh.points))) for name in COLUMNS if name in table}
    for name, values in nodal.items():
        values[rows] = table[name]
    return nodal


def _nodes_of(points: ContactPoints) -> np.ndarray:
    """Return the nodes of the first surface with weights at contact points, ascending."""
    return np.unique(points.side1.indices)


def _closed_or_open(values: Values) -> Values:
    """Return values with a preload or a gap at each point; with both, the net pressure remains as one of them."""
    both = (values.gap > 0.0) & (values.preload > 0.0)
    net = values.preload - values.normal_stiffness * values.gap
    preload = np.where(both, np.maximum(net, 0.0), values.preload)
    gap = np.divide(np.maximum(-net, 0.0), values.normal_stiffness, out=values.gap.copy(), where=both)
    return replace(values, preload=preload, gap=gap)


def _of_field(mesh: Mesh, joint: Joint, points: ContactPoints, name: OfPoints) -> np.ndarray:
    """Return the field of the mesh for a value, (n_nodes,)."""
    field, where = joint.fields[name], f"{mesh.path}: joint {joint.name!r} fields: {name}"
    if name not in LAWS[joint.law].per_point:
        raise CaseError(f'{where} is not a value of law = "{joint.law}", which takes {", ".join(LAWS[joint.law].per_point)}')
    if name == "gap" and joint.has_gap_of_mesh:
        raise CaseError(f'{where}: the joint takes its gap from the mesh, gap = "geometry"; state one of them')
    nodes = _nodes_of(points)
    nodal = field_at_nodes(mesh, field, nodes, where, "the joint")
    above = name.endswith("stiffness") or (name == "preload" and "n0" in LAWS[joint.law].above_0)
    least = nodes[np.argmin(nodal[nodes])]
    if nodal[least] < 0.0 or (above and nodal[least] == 0.0):
        raise MeshError(
            f"{where} = {field!r} is {nodal[least]:g} at {place(mesh.points[least])} m; it must be "
            f"{'above 0' if above else 'at least 0'}"
        )
    return nodal


def _interpolated(points: ContactPoints, of_nodes: np.ndarray) -> np.ndarray:
    """Return nodal values (n_nodes,) interpolated at the points by the first surface, within the range of its nodes."""
    corners, first = of_nodes[points.side1.indices], points.side1.indptr[:-1]
    mean = points.side1 @ np.nan_to_num(of_nodes)
    return np.clip(mean, np.minimum.reduceat(corners, first), np.maximum.reduceat(corners, first))


def _checked_table(joint: Joint, path: Path) -> tuple[dict[str, np.ndarray], list[int]]:
    """Return the columns of the joint's file, and the line number of each row."""
    table, lines = read_table(path, (), (*PLACES, *COLUMNS), "contact point")
    given = [name for name in COLUMNS if name in table]
    if not given:
        raise CaseError(f"{path}: the header names no value: {', '.join(COLUMNS)}")
    _check_law(joint, path, table, given, lines)
    for name in given:
        if (table[name] < 0.0).any() or (name.endswith("stiffness") and (table[name] == 0.0).any()):
            bad = int(np.argmin(table[name]))
            least = "above 0" if name.endswith("stiffness") else "at least 0"
            raise CaseError(f"{path}, line {lines[bad]}: {name} = {table[name][bad]:g}; it must be {least}")
    if "gap" in given and joint.has_gap_of_mesh:
        raise CaseError(f'{path}: the joint takes its gap from the mesh, gap = "geometry"; leave the column gap out')
    return table, lines


def _check_open(where, places: np.ndarray, gap: np.ndarray, preload: np.ndarray, used: np.ndarray) -> None:
    """Raise CaseError for a node or point with both gap and preload; ``used`` (n,) indexes ``places`` (m, 3) [m]."""
    gap, preload = gap[used], preload[used]
    both = np.flatnonzero((gap > 0.0) & (preload > 0.0))
    if len(both):
        raise CaseError(
            f"{where}: the point at {place(places[used[both[0]]])} m has a gap of {gap[both[0]]:g} m and "
            f"a preload of {preload[both[0]]:g} Pa ({len(both)} in all): an open point has no preload; state only one of them"
        )


def _check_law(joint: Joint, path: Path, table: dict, given: list[str], lines: list[int]) -> None:
    """Raise CaseError for a column that the joint's law does not use, and for points without its required pressure."""
    takes = LAWS[joint.law].per_point
    for name in given:
        if name not in takes:
            raise CaseError(f'{path}: {name} is not a value of law = "{joint.law}", which takes {", ".join(takes)}')
    if "preload" in given and "n0" in LAWS[joint.law].above_0 and (table["preload"] <= 0.0).any():
        bad = int(np.argmin(table["preload"]))
        raise CaseError(
            f'{path}, line {lines[bad]}: preload = {table["preload"][bad]:g}; with law = "{joint.law}" it must be above 0'
        )


def _rows_of_nodes(
    mesh: Mesh, joint: Joint, path: Path | None, points: ContactPoints, table: dict, lines: list[int]
) -> np.ndarray:
    """Return the nodes of the rows of the table, (n_rows,), nodes of the first surface."""
    if {"x", "y", "z"} & table.keys():
        raise CaseError(f"{path}: the header names node and x, y, z; state only one of them")
    nodes = _nodes_of(points)
    unknown = np.flatnonzero(~np.isin(table["node"], mesh.numbers[nodes]))
    if len(unknown):
        raise MeshError(
            f"{path}, line {lines[unknown[0]]}: node {table['node'][unknown[0]]:g} is not a node of "
            f"{joint.groups[0]!r}, the first surface of joint {joint.name!r} ({len(unknown)} such rows)"
        )
    named, count = np.unique(table["node"], return_counts=True)
    if (count > 1).any():
        raise CaseError(f"{path}: node {named[np.argmax(count)]:g} has {count.max()} rows; each needs one")
    order = np.argsort(mesh.numbers[nodes])
    return nodes[order][np.searchsorted(mesh.numbers[nodes][order], table["node"])]


def _nearest_rows(joint: Joint, path: Path | None, points: ContactPoints, table: dict, lines: list[int]) -> np.ndarray:
    """Return the nearest row of the table to each point, (n_points,)."""
    missing = [name for name in "xyz" if name not in table]
    if missing:
        raise CaseError(f"{path}: the header must name node, or x, y and z in m; {', '.join(missing)} is missing")
    places = np.column_stack([table[name] for name in "xyz"])
    distance, _ = cKDTree(points.position).query(places)
    farthest = int(np.argmax(distance))
    extent = float(np.linalg.norm(np.ptp(points.position, axis=0)))
    if distance[farthest] > FAR * extent:
        raise MeshError(
            f"{path}, line {lines[farthest]}: {place(places[farthest])} m is {distance[farthest]:.3g} m from the "
            f"nearest contact point of joint {joint.name!r}, more than {FAR:.0%} of the joint's extent; places are in metres"
        )
    return cKDTree(places).query(points.position)[1]


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
