"""Rigid and distributing elements, point masses, springs and dampers of bulk data."""

from typing import Any

import numpy as np

from ...tables.structure import Spring
from ..draft import grounded, vector
from .content import Content


def take_connections(content: Content) -> None:
    """Take points with six degrees of freedom, masses, springs and dampers.  Local."""
    for number, element in content.cards.rigid_elements.items():
        if element.type == "RBE2":
            _take_rigid(content, number, element)
        elif element.type == "RBE3":
            _take_distributing(content, number, element)
    _leave_out_means(content)
    content.chain("RBE2")
    for number, mass in content.cards.masses.items():
        if mass.type == "CONM2":
            _take_mass(content, number, mass)
    for number, element in content.cards.elements.items():
        if element.type in _CONSTANT:
            _take_spring(content, number, element)


def _take_rigid(content: Content, number: int, element: Any) -> None:
    """Take an RBE2 whose grid points follow in all three displacements; nodes of solids have no rotations."""
    name = f"RBE2 {number}"
    node, *nodes = content.find([int(element.gn), *map(int, element.Gmi)], name).tolist()
    if not {"1", "2", "3"} <= set(str(element.cm)):
        content.left_out("RBE2", number, f"a rigid element in {element.cm} alone", "points")
    elif node not in content.leaders:
        content.lead(name, node, np.array(nodes))
    elif content.leaders[node].connection == "rigid":
        content.group(content.leaders[node].group, nodes)  # one rigid body with the previous element
    else:
        content.left_out("RBE2", number, f"grid point {element.gn} leads an RBE3 already", "points")


def _take_distributing(content: Content, number: int, element: Any) -> None:
    """Take an RBE3 of the three displacements of all its grid points, with their weights."""
    name = f"RBE3 {number}"
    is_plain = all(str(components) == "123" for components in element.comps) and min(element.weights) > 0.0
    (node,) = content.find([int(element.refgrid)], name).tolist()
    if not is_plain or node in content.leaders:
        effect = "a mean of other components than 123, or with a weight that is not above 0"
        content.left_out("RBE3", number, effect, "points")
    elif content.of_solids[node]:
        content.left_out("RBE3", number, "a mean that leads a node of a solid", "points")
    else:
        members = [(int(n), float(w)) for part, w in zip(element.Gijs, element.weights, strict=True) for n in part]
        nodes = content.find([n for n, _ in members], name)
        content.lead(name, node, nodes, "distributing")
        content.weigh(node, nodes, [w for _, w in members])


def _leave_out_means(content: Content) -> None:
    """Add a finding for each mean of grid points that belong to no solid; without any of a solid it is no point."""
    for node, point in list(content.leaders.items()):
        nodes = content.groups[point.group].nodes
        loose = nodes[~content.of_solids[nodes]]
        if point.connection == "distributing" and len(loose):
            leads = " (which leads others)" if int(loose[0]) in content.leaders else ""
            effect = (
                f"a mean of {len(nodes)} grid points, {len(loose)} of them of no solid, as {content.numbers[loose[0]]}{leads}"
            )
            content.findings.add("RBE3", point.name or "", effect, part="points")
            if len(loose) == len(nodes):
                del content.leaders[node]


def _take_mass(content: Content, number: int, mass: Any) -> None:
    """Take a CONM2 on a node of elements, or on a connected point with its inertia I11, I21, I22, I31, I32, I33."""
    if np.any(mass.X) or mass.cid > 0:
        content.left_out("CONM2", number, "a mass away from its grid point, or in a local coordinate system", "masses")
        return
    where, factor = f"CONM2 {number}", content.mass_factor
    xx, xy, yy, zx, yz, zz = (np.asarray(mass.I, dtype=float) * factor).tolist()
    (node,) = content.find([int(mass.nid)], where).tolist()
    content.add_mass("CONM2", where, node, float(mass.mass) * factor, (xx, yy, zz, -xy, -yz, -zx))


_CONSTANT = {"CELAS1": ("stiffness", "k"), "CELAS2": ("stiffness", "k"), "CDAMP1": ("damping", "b"), "CDAMP2": ("damping", "b")}


def _take_spring(content: Content, number: int, element: Any) -> None:
    """Take a CELAS1, CELAS2, CDAMP1 or CDAMP2 along one axis between two grid points, or between a grid point and ground.

    A spring between ground and a connected point becomes part of the point.
    """
    key, letter = _CONSTANT[element.type]
    holder = content.cards.properties.get(element.pid) if element.type.endswith("1") else element
    constant, where = getattr(holder, letter, None), f"{element.type} {number}"
    ends = [(int(n), int(c)) for n, c in zip(element.nodes, (element.c1, element.c2), strict=True) if n]
    nodes, directions = content.find([n for n, _ in ends], where).tolist(), {c for _, c in ends}
    if any(node in content.leaders for node in nodes):
        is_plain = len(nodes) == 1 and content.axes(nodes[0]) is None and 1 <= ends[0][1] <= 6
        if not is_plain or constant is None or key != "stiffness":
            content.left_out(element.type, number, "a spring at a grid point that leads a rigid element", "springs")
        else:
            content.leaders[nodes[0]] = grounded(content.leaders[nodes[0]], ends[0][1], float(constant))
        return
    if constant is None or len(directions) != 1 or not directions <= {1, 2, 3}:
        content.left_out(element.type, number, "a spring between displacements that differ, or on rotations", "springs")
        return
    axis, rows = directions.pop() - 1, []
    for node in nodes:
        axes = content.axes(node)
        rows.append((np.eye(3) if axes is None else axes)[axis])
    if len(rows) == 2 and not np.allclose(rows[0], rows[1]):
        content.left_out(element.type, number, "a spring between displacements in different axes", "springs")
        return
    groups = tuple(content.group(f"{where} node {n}", [node]) for (n, _), node in zip(ends, nodes, strict=True))
    content.springs.append(Spring.of_file(groups=groups, direction=vector(rows[0]), **{key: float(constant)}))
