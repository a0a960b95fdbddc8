"""Point masses, springs and rigid regions of an archive, with groups of their nodes."""

from dataclasses import dataclass

import numpy as np

from ...tables.structure import Spring
from .blocks import FIELDS, Blocks
from .content import Content


@dataclass(frozen=True)
class _Element:
    """A MASS21 or a COMBIN14."""

    where: str
    values: list[float]  # its real constants
    keys: dict[int, int]  # its KEYOPTs
    nodes: np.ndarray  # node numbers of the file


def take_attached(blocks: Blocks, content: Content) -> None:
    """Take point masses (MASS21), at leading nodes as part of the point, and springs (COMBIN14).  Local."""
    constants = {**blocks.constants, **content.constants}
    start, flat = blocks.start[:-1], blocks.flat
    is_attached = np.isin(flat[start + 1], [number for number, element in content.types.items() if element in (14, 21)])
    for row, number in zip(start[is_attached], blocks.elements[is_attached], strict=True):
        type_number = content.types[int(flat[row + 1])]
        values, keys = constants.get(int(flat[row + 2]), []), content.keys.get(int(flat[row + 1]), {})
        nodes = flat[row + FIELDS : row + FIELDS + (1 if type_number == 21 else 2)]
        (_take_mass if type_number == 21 else _take_spring)(content, _Element(f"element {number}", values, keys, nodes))


def _take_mass(content: Content, element: _Element) -> None:
    values, keys = element.values, element.keys
    inertia = [*values[3:6], 0.0, 0.0, 0.0][:3] if keys.get(3, 0) == 0 else [0.0, 0.0, 0.0]
    effect = ""
    if keys.get(1, 0) or (keys.get(2, 0) and len(set(inertia)) > 1):
        effect = "a point mass given by its volume (KEYOPT(1)), or with an inertia in the axes of its node (KEYOPT(2))"
    elif not values or not (keys.get(3, 0) == 2 or (keys.get(3, 0) == 0 and len(set(values[:3])) == 1)):
        effect = "a point mass with a KEYOPT(3) or real constants that differ by direction or are missing"
    if effect:
        content.findings.add("MASS21", element.where, effect, part="masses")
        return
    (node,) = content.find(element.nodes.tolist(), element.where).tolist()
    content.add_mass("MASS21", element.where, node, float(values[0]), inertia)


def _take_spring(content: Content, element: _Element) -> None:
    """Take a COMBIN14 along its line, or along x, y or z."""
    where, values, keys = element.where, element.values, element.keys
    nodes = content.find(element.nodes[element.nodes > 0].tolist(), where).tolist()
    kind = keys.get(2, 0)
    if any(node in content.leaders for node in nodes):
        content.findings.add("COMBIN14", where, "a spring at a node that leads a rigid region", part="springs")
        return
    if keys.get(1, 0) or kind > 3 or keys.get(3, 0) or not values:
        content.findings.add("COMBIN14", where, "a spring that is not linear, is torsional, or has no constants", part="springs")
        return
    if any(values[2:3]):
        content.findings.add("COMBIN14", where, "a damper that is not linear", part="springs")
    groups = tuple(content.group(f"COMBIN14 {where} node {content.numbers[node]}", [node]) for node in nodes)
    direction = None if kind == 0 else (float(kind == 1), float(kind == 2), float(kind == 3))
    stiffness, damping = map(float, [*values, 0.0][:2])
    content.springs.append(Spring.of_file(groups=groups, direction=direction, stiffness=stiffness, damping=damping))


def take_rigid_regions(content: Content) -> None:
    """Take the rigid regions of CERIG, and the surfaces that pilot nodes lead.  Local."""
    for where, leader, followers in content.constraints.rigid:
        (node,) = content.find([leader], f"{where}: CERIG").tolist()
        content.lead(f"CERIG node {leader}", node, content.known(np.array(followers)))
    for leader, nodes, connection in content.pilots:
        (node,) = content.find([leader], "TARGE170").tolist()
        content.lead(f"pilot node {leader}", node, nodes, connection)
    content.chain("CERIG")
