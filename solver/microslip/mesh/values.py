"""What a joint states of its contact points: one value for all, or values of their own from a CSV file."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ..contact.laws import LAWS
from ..parallel.csv_table import read_table
from ..parallel.errors import CaseError, MeshError
from ..parallel.words import place
from .contact_points import ContactPoints
from .data import Mesh
from .nodal_fields import field_at_nodes
from .settings import GEOMETRY, Joint

FAR = 0.1  # of the extent of a joint's points: a row this far from all of them is a mistake
PLACES = ("node", "x", "y", "z")


@dataclass(frozen=True)
class Values:
    """Per unit area and contact point, (n,) each."""

    friction: np.ndarray  # -
    tangential_stiffness: np.ndarray  # N/m3
    normal_stiffness: np.ndarray  # N/m3
    preload: np.ndarray  # Pa
    gap: np.ndarray  # m; 0 where the mesh gives it


COLUMNS = tuple(Values.__dataclass_fields__)


def values_of(mesh: Mesh, joint: Joint, points: ContactPoints, node1: np.ndarray) -> Values:
    """Return the values of a joint's points; ``node1`` is the node of the first surface that each belongs to.  Local, rank 0.

    Raises
    ------
    CaseError : the joint's file is at fault
    MeshError : it names nodes or places where the joint has no point
    """
    stated = {name: getattr(joint, name) for name in COLUMNS}
    stated["gap"] = 0.0 if joint.gap == GEOMETRY else joint.gap
    values = Values(**{name: np.full(points.n_points, float(value)) for name, value in stated.items()})
    if joint.fields:
        values = replace(values, **{name: _of_field(mesh, joint, points, name) for name in joint.fields})
        _check_open(f"{mesh.path}: joint {joint.name!r} fields", points, values)
    return values if joint.parameters is None else _from_file(mesh, joint, points, node1, values)


def _of_field(mesh: Mesh, joint: Joint, points: ContactPoints, name: str) -> np.ndarray:
    """Return a value that a field of the mesh has, as the first surface interpolates it, within those of the nodes it takes."""
    field, where = joint.fields[name], f"{mesh.path}: joint {joint.name!r} fields: {name}"
    if name not in LAWS[joint.law].per_point:
        raise CaseError(f'{where} is no value of law = "{joint.law}", which takes {", ".join(LAWS[joint.law].per_point)}')
    if name == "gap" and joint.gap == GEOMETRY:
        raise CaseError(f'{where}: the joint takes its gap from the mesh, gap = "geometry"; state one of them')
    of_nodes = field_at_nodes(mesh, field, np.unique(points.side1.indices), where, "the joint")
    found = _interpolated(points, of_nodes)
    above = name.endswith("stiffness") or (name == "preload" and "n0" in LAWS[joint.law].above_0)
    if found.min() < 0.0 or (above and found.min() == 0.0):
        at = place(points.position[np.argmin(found)])
        raise MeshError(f"{where} = {field!r} is {found.min():g} at {at} m; it must be {'above 0' if above else 'at least 0'}")
    return found


def _interpolated(points: ContactPoints, of_nodes: np.ndarray) -> np.ndarray:
    """Return values of nodes (n_nodes,) at the points, as the first surface interpolates, within those of the nodes it takes."""
    own, first = of_nodes[points.side1.indices], points.side1.indptr[:-1]
    found = points.side1 @ np.nan_to_num(of_nodes)
    return np.clip(found, np.minimum.reduceat(own, first), np.maximum.reduceat(own, first))


def _from_file(mesh: Mesh, joint: Joint, points: ContactPoints, node1: np.ndarray, values: Values) -> Values:
    assert joint.parameters is not None, "a joint with a file of values"
    table, lines = read_table(joint.parameters, (), (*PLACES, *COLUMNS), "contact point")
    given = [name for name in COLUMNS if name in table]
    if not given:
        raise CaseError(f"{joint.parameters}: the header names no value: {', '.join(COLUMNS)}")
    _check_law(joint, table, given, lines)
    for name in given:
        if (table[name] < 0.0).any() or (name.endswith("stiffness") and (table[name] == 0.0).any()):
            bad = int(np.argmin(table[name]))
            least = "above 0" if name.endswith("stiffness") else "at least 0"
            raise CaseError(f"{joint.parameters}, line {lines[bad]}: {name} = {table[name][bad]:g}; it must be {least}")
    if "gap" in given and joint.gap == GEOMETRY:
        raise CaseError(f'{joint.parameters}: the joint takes its gap from the mesh, gap = "geometry"; leave the column gap out')
    pairs, rows = (_by_node if "node" in table else _by_place)(mesh, joint, points, node1, table, lines)
    changed = {}
    for name in given:
        changed[name] = getattr(values, name).copy()
        changed[name][pairs] = table[name][rows]
    found = replace(values, **changed)
    _check_open(joint.parameters, points, found)
    return found


def _check_open(where, points: ContactPoints, found: Values) -> None:
    """Raise CaseError for a point with a gap and a preload."""
    both = np.flatnonzero((found.gap > 0.0) & (found.preload > 0.0))
    if len(both):
        raise CaseError(
            f"{where}: the point at {place(points.position[both[0]])} m has a gap of {found.gap[both[0]]:g} m and "
            f"a preload of {found.preload[both[0]]:g} Pa ({len(both)} in all): an open point carries none; keep one of them"
        )


def _check_law(joint: Joint, table: dict, given: list[str], lines: list[int]) -> None:
    """Raise CaseError for a column that the joint's law has no use for, and for points without the pressure that it needs."""
    takes = LAWS[joint.law].per_point
    for name in given:
        if name not in takes:
            raise CaseError(f'{joint.parameters}: {name} is no value of law = "{joint.law}", which takes {", ".join(takes)}')
    if "preload" in given and "n0" in LAWS[joint.law].above_0 and (table["preload"] <= 0.0).any():
        bad = int(np.argmin(table["preload"]))
        raise CaseError(
            f"{joint.parameters}, line {lines[bad]}: preload = {table['preload'][bad]:g}; "
            f'with law = "{joint.law}" it must be above 0'
        )


def _by_node(mesh: Mesh, joint: Joint, points: ContactPoints, node1: np.ndarray, table: dict, lines: list[int]):
    """Return pairs and the rows of the table that name their node."""
    if {"x", "y", "z"} & table.keys():
        raise CaseError(f"{joint.parameters}: the header names node and x, y, z; a point is found by one of them")
    numbers = mesh.numbers[node1]
    unknown = np.flatnonzero(~np.isin(table["node"], numbers))
    if len(unknown):
        raise MeshError(
            f"{joint.parameters}, line {lines[unknown[0]]}: node {table['node'][unknown[0]]:g} is no node of "
            f"{joint.surfaces[0]!r}, the first surface of joint {joint.name!r} ({len(unknown)} such rows)"
        )
    named, first, count = np.unique(table["node"], return_index=True, return_counts=True)
    if (count > 1).any():
        raise CaseError(f"{joint.parameters}: node {named[np.argmax(count)]:g} has {count.max()} rows; each needs one")
    at = np.minimum(np.searchsorted(named, numbers), len(named) - 1)
    has_row = named[at] == numbers
    return np.flatnonzero(has_row), first[at[has_row]]


def _by_place(mesh: Mesh, joint: Joint, points: ContactPoints, node1: np.ndarray, table: dict, lines: list[int]):
    """Return all pairs and the row of the table that is nearest to each."""
    missing = [name for name in "xyz" if name not in table]
    if missing:
        raise CaseError(f"{joint.parameters}: the header must name node, or x, y and z in m; {', '.join(missing)} is missing")
    places = np.column_stack([table[name] for name in "xyz"])
    distance, _ = cKDTree(points.position).query(places)
    farthest = int(np.argmax(distance))
    extent = float(np.linalg.norm(np.ptp(points.position, axis=0)))
    if distance[farthest] > FAR * extent:
        raise MeshError(
            f"{joint.parameters}, line {lines[farthest]}: {place(places[farthest])} m is {distance[farthest]:.3g} m from the "
            f"nearest contact point of joint {joint.name!r}, more than {FAR:.0%} of the joint's extent; places are in metres"
        )
    return np.arange(points.n_points), cKDTree(places).query(points.position)[1]
