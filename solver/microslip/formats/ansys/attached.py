"""Point masses, springs and rigid regions of an archive, with groups for their nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...messages.errors import MeshError
from ...tables.structure import Mass, Point, Spring
from ..model import KINDS, Cells, Finding, Group, index_of
from .blocks import FIELDS, Blocks
from .content import Content


@dataclass(frozen=True)
class _Element:
    """A MASS21 or a COMBIN14."""

    where: str
    values: list[float]  # its real constants
    keys: dict[int, int]  # its KEYOPTs
    nodes: np.ndarray


def attached(blocks: Blocks, content: Content, groups: dict[str, Group], leading: dict[int, Point]):
    """Return point masses (MASS21) and springs (COMBIN14), with groups for their nodes.  Local.

    A mass on a node that leads a rigid region becomes that of the point, in ``leading``.
    """
    constants = {**blocks.constants, **content.constants}
    start, flat, numbers = blocks.start[:-1], blocks.flat, blocks.numbers
    masses, springs = [], []
    is_attached = np.isin(flat[start + 1], [number for number, own_type in content.types.items() if own_type in (14, 21)])
    for row, number in zip(start[is_attached], blocks.elements[is_attached], strict=True):
        own_type = content.types[int(flat[row + 1])]
        values, keys = constants.get(int(flat[row + 2]), []), content.keys.get(int(flat[row + 1]), {})
        where = f"element {number}"
        element = _Element(where, values, keys, flat[row + FIELDS : row + FIELDS + (1 if own_type == 21 else 2)])
        if own_type == 21:
            masses += _mass(content, element, numbers, groups, leading)
        elif any(int(node) in leading for node in element.nodes):
            effect = "a spring at a node that leads a rigid region"
            content.findings.append(Finding(word="COMBIN14", where=where, effect=effect, changes=True, part="springs"))
        else:
            springs += _spring(content, element, numbers, groups)
    return tuple(masses), tuple(springs)


def _mass(
    content: Content, element: _Element, numbers: np.ndarray, groups: dict[str, Group], leading: dict[int, Point]
) -> list[Mass]:
    """Return the mass of a MASS21; its rotary inertia has nothing to act on at the node of a solid."""
    where, values, keys, node = element.where, element.values, element.keys, int(element.nodes[0])
    inertia = tuple(map(float, [*values[3:6], 0.0, 0.0, 0.0][:3])) if keys.get(3, 0) == 0 else (0.0, 0.0, 0.0)
    if keys.get(1, 0) or (keys.get(2, 0) and len(set(inertia)) > 1):
        effect = "a point mass given by its volume (KEYOPT(1)), or with an inertia in axes of its node (KEYOPT(2))"
        content.findings.append(Finding(word="MASS21", where=where, effect=effect, changes=True, part="masses"))
        return []
    if keys.get(3, 0) in (0, 2) and len(values) >= 1 and len(set(values[:3])) == 1 or (keys.get(3, 0) == 2 and values):
        if node in leading:
            leading[node] = _heavier(leading[node], float(values[0]), inertia)
            return []
        name = f"MASS21 {where}"
        groups.setdefault(name, Group()).add_nodes(known_nodes(numbers, np.array([node])))
        if any(inertia):
            effect = "the rotary inertia of a point mass"
            content.findings.append(Finding(word="MASS21", where=where, effect=effect, changes=True, part="masses"))
        return [Mass.of_file(group=name, mass=float(values[0]))]
    effect = "a point mass whose KEYOPT(3) or real constants differ by direction, or lack"
    content.findings.append(Finding(word="MASS21", where=where, effect=effect, changes=True, part="masses"))
    return []


def _heavier(point: Point, mass: float, inertia: tuple[float, ...]) -> Point:
    """Return a point with a mass and an inertia more."""
    total = tuple(a + b for a, b in zip(point.inertia or (0.0, 0.0, 0.0), inertia, strict=True))
    return point.with_keys(mass=point.mass + mass, inertia=total if any(total) else None)


def _spring(content: Content, element: _Element, numbers: np.ndarray, groups: dict[str, Group]) -> list[Spring]:
    """Return a COMBIN14 along its line, or along x, y or z."""
    where, values, keys = element.where, element.values, element.keys
    kind = keys.get(2, 0)
    if keys.get(1, 0) or kind > 3 or keys.get(3, 0) or not values:
        effect = "a spring that is not linear, or turns, or has no constants"
        content.findings.append(Finding(word="COMBIN14", where=where, effect=effect, changes=True, part="springs"))
        return []
    if any(values[2:3]):
        effect = "a damper that is not linear"
        content.findings.append(Finding(word="COMBIN14", where=where, effect=effect, changes=True, part="springs"))
    names = []
    for node in element.nodes:
        if node > 0:
            names.append(f"COMBIN14 {where} node {node}")
            groups.setdefault(names[-1], Group()).add_nodes(known_nodes(numbers, np.array([node])))
    direction = None if kind == 0 else (float(kind == 1), float(kind == 2), float(kind == 3))
    return [
        Spring.of_file(groups=tuple(names), direction=direction, stiffness=float(values[0]), damping=float([*values, 0.0][1]))
    ]


def nodes_of_solids(cells: list[Cells], n_nodes: int) -> np.ndarray:
    """Return which nodes solids have, (n_nodes,) bool.  Local."""
    found = np.zeros(n_nodes, dtype=bool)
    for own in cells:
        found[own.nodes] |= KINDS[own.kind][0] == 3
    return found


def rigid_regions(
    content: Content, numbers: np.ndarray, points: np.ndarray, groups: dict[str, Group], of_solids: np.ndarray
) -> dict[int, Point]:
    """Return the rigid regions of CERIG by the nodes that lead them, which are of the region where a solid has them.  Local."""
    made: dict[int, Point] = {}
    for where, leader, followers in content.constraints.rigid:
        name = f"CERIG node {leader}"
        index, missing = index_of(numbers, np.array([leader]))
        if len(missing):
            raise MeshError(f"{where}: CERIG: there is no node {leader}")
        nodes = np.setdiff1d(known_nodes(numbers, np.array(followers)), index)
        groups.setdefault(name, Group()).add_nodes(np.union1d(nodes, index[of_solids[index]]))
        x, y, z = map(float, points[index[0]])
        made[leader] = Point.of_file(name=name, position=(x, y, z), group=name)
    return made


def known_nodes(numbers: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the positions of the nodes that are there.  Local."""
    index, missing = index_of(numbers, wanted)
    return index[~np.isin(wanted, missing)]
