"""Supports, load and output of a first scene."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...formats.model import FileModel
from ...mesh.components import parts_of
from ...mesh.connected import connected_parts
from ...mesh.data import Mesh
from ...messages.words import listed
from ...tables.structure import Support
from ...tables.structure_tables import StructureTables
from .candidate import Candidate

# beginnings of names, or of parts of names, of supported groups
_HELD = ("clamp", "fix", "support", "held", "encastre", "encast", "ground", "wall", "spc", "base", "built", "mount", "root")


_BOTH_SIDES = 0.5  # fraction of fixed nodes on both sides of a joint from which supports are not meant for vibration
_A_PART = 0.1  # fraction of the nodes of a side from which a support is one of them


@dataclass(frozen=True)
class Place:
    """A node or point with the direction of load and output."""

    node: int | None  # number in the file
    point: str | None
    position: tuple[float, ...]  # m
    direction: tuple[float, float, float]


def supports_of_joints(mesh: Mesh, file: FileModel, joints: Sequence[Candidate]) -> list[Support]:
    """Return the supports of the file that fix both sides of a joint, so that its pairs cannot move.  Local, rank 0."""
    nodes_of = [_fixed_nodes(mesh, file, support) for support in file.supports]
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    for support, nodes in zip(file.supports, nodes_of, strict=True):
        for axis in {*support.fix} & {*"xyz"}:
            fixed[nodes, "xyz".index(axis)] = True
    is_fixed, wrong = fixed.all(axis=1), set()
    for joint in joints:
        if min(is_fixed[side].mean() for side in joint.nodes) < _BOTH_SIDES:
            continue
        for i, nodes in enumerate(nodes_of):
            if any(np.isin(side, nodes).mean() >= _A_PART for side in joint.nodes):
                wrong.add(i)
    return [file.supports[i] for i in sorted(wrong)]


def _fixed_nodes(mesh: Mesh, file: FileModel, support: Support) -> np.ndarray:
    """Return the nodes held by a support, including nodes that follow its point."""
    if support.point is None:
        return mesh.node_groups.get(support.group or "", np.zeros(0, dtype=np.int64))
    groups = [point.group for point in file.connected if point.name == support.point and point.connection == "rigid"]
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(mesh.node_groups[name] for name in groups)]))


def disconnected(
    mesh: Mesh, file: FileModel, settings: StructureTables, joints: Sequence[Candidate], fixed: Iterable[str]
) -> list[str]:
    """Return a line for each part of the structure that nothing connects to a support or to the largest part.  Local, rank 0.

    None where the file has equations or springs, which also connect parts.
    """
    if file.equations is not None or file.springs:
        return []
    part, names = connected_parts(mesh, settings.body_of)
    connected = [np.concatenate(joint.nodes) for joint in joints]
    connected += [np.concatenate([mesh.node_groups[name] for name in tie.surfaces]) for tie in file.ties]
    connected += [mesh.node_groups[point.group] for point in file.connected]
    component = parts_of([np.arange(len(names))[:, None], *(np.unique(part[nodes])[None] for nodes in connected)], len(names))[1]
    held = [mesh.node_groups[name] for name in fixed] + [_fixed_nodes(mesh, file, support) for support in file.supports]
    is_held = np.isin(component, component[part[np.concatenate([np.zeros(0, dtype=np.int64), *held])]])
    if not is_held.any():
        is_held = component == np.bincount(component[part]).argmax()
    rest = cKDTree(mesh.points[is_held[part]])
    lines = []
    for number in np.unique(component[~is_held]):
        distance = rest.query(mesh.points[component[part] == number])[0].min()
        who = listed([names[i] for i in np.flatnonzero(component == number)])
        lines.append(
            f"{who}: {distance:.3g} m from the rest, and nothing connects it: add a joint, a tie or supports, or move it"
        )
    return lines


def fixed_groups(mesh: Mesh, file: FileModel, settings: StructureTables, used: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the groups whose names indicate supports, and other possible groups.  Local.

    Both are empty if the file has supports.  ``used``: groups with another purpose.  A possible group neither contains a whole
    body nor a part of a surface in use.
    """
    if file.supports or any(point.stiffness or point.rotational_stiffness for point in file.connected):
        return [], []
    surfaces = {*used, *(name for tie in file.ties for name in tie.surfaces)}
    others = {*settings.body_of, *surfaces}
    others |= {bolt.group for bolt in file.bolts} | {mass.group for mass in file.masses if mass.group is not None}
    free = [name for name, nodes in mesh.node_groups.items() if name not in others and len(nodes) >= 3]
    free.sort(key=lambda name: name.startswith("_"))  # internal sets of programs come last
    sure = [name for name in free if any(word in name.lower() for word in _HELD)]
    of_bodies = [[block.nodes.ravel() for block in mesh.elements if block.group == name] for name in settings.body_of]
    bodies = [np.unique(np.concatenate(nodes)) for nodes in of_bodies if nodes]
    sides = [mesh.node_groups[name] for name in surfaces if name in mesh.node_groups]

    def may_hold(name: str) -> bool:
        held = np.zeros(len(mesh.points), dtype=bool)
        held[mesh.node_groups[name]] = True
        return not any(held[body].all() for body in bodies) and all(held[side].mean() < _A_PART for side in sides)

    return sure, [name for name in free if name not in sure and may_hold(name)]


def farthest(mesh: Mesh, file: FileModel, fixed: Iterable[str]) -> Place:
    """Return the node farthest from the supports, or the point that leads it, and a direction across the mesh's longest side.

    Local.  Without supports, the node farthest from the middle.  The direction includes both bending axes, because the direction
    of the first mode is unknown.
    """
    groups = [mesh.node_groups[name] for name in fixed if name in mesh.node_groups]
    groups += [mesh.node_groups[support.group] for support in file.supports if support.group in mesh.node_groups]
    held = {support.point for support in file.supports}
    groups += [
        mesh.node_groups[point.group] for point in file.connected if point.name in held and point.group in mesh.node_groups
    ]
    nodes = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *groups]))
    supported = mesh.points[nodes] if len(nodes) else mesh.points.mean(axis=0)[None]
    distance = cKDTree(supported).query(mesh.points)[0]
    node = int(np.argmax(np.round(distance / mesh.diagonal, 6)))  # the first of equally distant nodes
    across = np.ones(3)
    across[int(np.argmax(np.ptp(mesh.points, axis=0)))] = 0.0
    direction = (float(across[0]), float(across[1]), float(across[2]))
    leading = [
        point.name for point in file.connected if point.group in mesh.node_groups and node in mesh.node_groups[point.group]
    ]
    position = tuple(float(x) + 0.0 for x in np.round(mesh.points[node] / mesh.diagonal, 9) * mesh.diagonal)
    return Place(None if leading else int(mesh.numbers[node]), leading[0] if leading else None, position, direction)
