"""Rigid and distributing elements, point masses, springs and dampers of bulk data."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...tables.structure import Mass, Point, Spring
from .content import Content, mass_factor
from .supports import axes_of


def connections(content: Content) -> tuple[tuple[Point, ...], tuple[Mass, ...], tuple[Spring, ...], dict[int, str]]:
    """Return connected points, masses, springs, and the name of the point of each grid point that is one.  Local."""
    points: dict[int, Point] = {}
    for number, element in content.cards.rigid_elements.items():
        if element.type == "RBE2":
            _rigid(content, number, element, points)
        elif element.type == "RBE3":
            _distributing(content, number, element, points)
    masses = _masses(content, points)
    springs = [one for number, element in content.cards.elements.items() for one in _spring(content, number, element, points)]
    names = {node: point.name for node, point in points.items()}
    return tuple(points.values()), tuple(masses), tuple(springs), names


def _rigid(content: Content, number: int, element: Any, points: dict[int, Point]) -> None:
    """Take an RBE2 whose grid points follow in all three displacements; rotations of solids' nodes are none."""
    if not {"1", "2", "3"} <= set(str(element.cm)):
        content.left_out("RBE2", number, f"a rigid element in {element.cm} alone", "points")
    elif int(element.gn) in points and points[int(element.gn)].connection == "rigid":
        own = content.nodes_of(map(int, element.Gmi), f"RBE2 {number}")
        content.group(points[int(element.gn)].group, own)  # one rigid body with that of the element before
    elif int(element.gn) in points:
        content.left_out("RBE2", number, f"grid point {element.gn} leads an RBE3 already", "points")
    else:
        _add_point(content, f"RBE2 {number}", int(element.gn), element.Gmi, "rigid", points)


def _distributing(content: Content, number: int, element: Any, points: dict[int, Point]) -> None:
    """Take an RBE3 whose grid points all count alike in their displacements."""
    is_plain = len(set(element.weights)) == 1 and all(str(components) == "123" for components in element.comps)
    if not is_plain or int(element.refgrid) in points:
        content.left_out("RBE3", number, "a mean with weights or components that differ", "points")
        return
    if content.of_solids[content.nodes_of([int(element.refgrid)], "RBE3")[0]]:
        content.left_out("RBE3", number, "a mean that leads a node of a solid", "points")
        return
    nodes = [node for own in element.Gijs for node in own]
    _add_point(content, f"RBE3 {number}", int(element.refgrid), nodes, "distributing", points)
    leader = int(element.refgrid)
    points[leader] = points[leader].with_keys(weights="equal")


def _add_point(content: Content, name: str, leader: int, nodes: list, connection: str, points: dict[int, Point]) -> None:
    at = content.nodes_of([leader], name)[0]
    own = np.setdiff1d(content.nodes_of(map(int, nodes), name), [at])
    follows = connection == "rigid" and content.of_solids[at]  # a leading node of a solid follows, too
    group = content.group(name, np.union1d(own, [at]) if follows else own)
    x, y, z = map(float, content.points[at])
    points[leader] = Point.of_file(name=name, position=(x, y, z), group=group, connection=connection)


def _masses(content: Content, points: dict[int, Point]) -> list[Mass]:
    """Return the CONM2 on nodes of elements; those on connected points become theirs, with their inertia."""
    factor, found = mass_factor(content), []
    for number, one in content.cards.masses.items():
        if one.type != "CONM2":
            continue
        node, is_central = int(one.nid), not np.any(one.X)
        inertia = np.asarray(one.I, dtype=float) * factor  # I11, I21, I22, I31, I32, I33
        if not is_central or one.cid > 0:
            content.left_out("CONM2", number, "a mass beside its grid point, or in axes of its own", "masses")
        elif node in points:
            point = points[node]
            xx, xy, yy, zx, yz, zz = inertia
            tensor = (xx, yy, zz, -xy, -yz, -zx) if inertia.any() else None
            points[node] = point.with_keys(mass=point.mass + float(one.mass) * factor, inertia=tensor or point.inertia)
        else:
            if inertia.any():
                content.left_out("CONM2", number, "the rotary inertia of a point mass at the node of a solid", "masses")
            group = content.group(f"CONM2 {number}", content.nodes_of([node], f"CONM2 {number}"))
            found.append(Mass.of_file(group=group, mass=float(one.mass) * factor))
    return found


_CONSTANT = {"CELAS1": ("stiffness", "k"), "CELAS2": ("stiffness", "k"), "CDAMP1": ("damping", "b"), "CDAMP2": ("damping", "b")}


def _spring(content: Content, number: int, element: Any, points: dict[int, Point]) -> list[Spring]:
    """Return a CELAS1, CELAS2, CDAMP1 or CDAMP2 between equal displacements of two grid points, or of one and ground.

    One between ground and a connected point becomes the point's own.
    """
    if element.type not in _CONSTANT:
        return []
    key, letter = _CONSTANT[element.type]
    holder = content.cards.properties.get(element.pid) if element.type.endswith("1") else element
    constant = getattr(holder, letter, None)
    ends = [(int(n), int(c)) for n, c in zip(element.nodes, (element.c1, element.c2), strict=True) if n]
    directions = {c for _, c in ends}
    if any(node in points for node, _ in ends):
        _of_point(content, number, element, ends, constant if key == "stiffness" else None, points)
        return []
    if constant is None or len(directions) != 1 or not directions <= {1, 2, 3}:
        content.left_out(element.type, number, "a spring between displacements that differ, or on rotations", "springs")
        return []
    axis, groups, rows = directions.pop() - 1, [], []
    for node, _ in ends:
        at = content.nodes_of([node], f"{element.type} {number}")
        groups.append(content.group(f"{element.type} {number} node {node}", at))
        axes = axes_of(content, node, content.points[at[0]])
        rows.append(np.eye(3)[axis] if axes is None else axes[axis])
    if len(rows) == 2 and not np.allclose(rows[0], rows[1]):
        content.left_out(element.type, number, "a spring between displacements in different axes", "springs")
        return []
    x, y, z = map(float, rows[0])
    return [Spring.of_file(groups=tuple(groups), direction=(x, y, z), **{key: float(constant)})]


def _of_point(content: Content, number: int, element: Any, ends: list, stiffness: float | None, points: dict[int, Point]) -> None:
    """Add a spring between a connected point and ground to the point."""
    node, component = ends[0]
    is_turned = node in points and axes_of(content, node, np.asarray(points[node].position)) is not None
    if len(ends) != 1 or stiffness is None or is_turned or not 1 <= component <= 6:
        content.left_out(element.type, number, "a spring at a grid point that leads a rigid element", "springs")
        return
    point = points[node]
    known = (point.stiffness if component <= 3 else point.rotational_stiffness) or (0.0, 0.0, 0.0)
    x, y, z = (value + float(stiffness) * (axis == (component - 1) % 3) for axis, value in enumerate(known))
    points[node] = point.with_keys(stiffness=(x, y, z)) if component <= 3 else point.with_keys(rotational_stiffness=(x, y, z))
