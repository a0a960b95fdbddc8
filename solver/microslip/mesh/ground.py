"""Contact of one surface with rigid ground: of the same shape, or a plane."""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from .. import elements
from ..messages.errors import MeshError
from ..messages.words import counted, place
from ..tables.joint import Joint
from .cells import cells_of
from .contact_points import ContactPoints
from .data import Mesh, on_nodes
from .overlap import FAR
from .surface import Surface

_MOST_TILT = 60.0  # degrees between a plane and the surface at the nearest point, which may be an edge


def grounded(mesh: Mesh, joint: Joint, first: Surface) -> ContactPoints:
    """Return the contact points of a surface on rigid ground: its nodes, or its cells for "points".  Local, rank 0.

    Raises
    ------
    MeshError : a plane behind the surface, or far from it
    """
    points = _cells(mesh, first) if joint.pairing == "points" else _nodes(mesh, first)
    return _on_plane(mesh, joint, first, points) if joint.plane_normal is not None else points


def _nodes(mesh: Mesh, first: Surface) -> ContactPoints:
    order = np.argsort(mesh.numbers[first.nodes], kind="stable")
    nodes = first.nodes[order]
    point_of = np.full(len(mesh.points), -1)
    point_of[nodes] = np.arange(len(nodes))
    faces = tuple(point_of[corners] for corners in first.faces.values())
    side1 = on_nodes(nodes, len(mesh.points))
    return _resting(mesh, side1, -first.normals[order], first.areas[order], faces=faces)


def _cells(mesh: Mesh, first: Surface) -> ContactPoints:
    """Return a point for each cell, with the mean motion of the surface in the cell."""
    parts, z, area, corners = [], [], [], []
    for kind, faces in first.faces.items():
        cells = cells_of(mesh, kind, faces)
        xi = elements.CELLS[kind]
        N = np.stack([elements.part_integrals(kind, mesh.points[faces], corner) for corner in xi], axis=1).reshape(
            len(cells.area), -1
        )
        rows = np.repeat(np.arange(len(N)), N.shape[1])
        weights = N / cells.area[:, None]
        parts.append(sp.csr_matrix((weights.ravel(), (rows, cells.faces.ravel())), (len(N), len(mesh.points))))
        z.append(-cells.axes[:, 2])
        area.append(cells.area)
        corners.append(cells.corners)
    side1 = sp.vstack(parts).tocsr()
    return _resting(mesh, side1, np.concatenate(z), np.concatenate(area), cells=np.concatenate(corners))


def _resting(mesh: Mesh, side1: sp.csr_matrix, z: np.ndarray, area: np.ndarray, **shown) -> ContactPoints:
    """Return points in contact with ground at their positions."""
    nothing = sp.csr_matrix(side1.shape)
    return ContactPoints(side1, nothing, z, area, side1 @ mesh.points, np.zeros(len(area)), **shown)


def _on_plane(mesh: Mesh, joint: Joint, first: Surface, points: ContactPoints) -> ContactPoints:
    """Return the points with the normal of the plane and their distance from it."""
    normal = np.array(joint.plane_normal) / np.linalg.norm(joint.plane_normal or ())
    distance = (points.position - np.array(joint.plane_point)) @ normal
    nearest = int(np.argmin(distance))
    where, at = f"{mesh.path}: joint {joint.name!r}: the surface {first.group!r}", f"{place(points.position[nearest])} m"
    tilt = np.degrees(np.arccos(np.clip(points.z[nearest] @ normal, -1.0, 1.0)))
    if tilt >= 90.0:
        raise MeshError(f"{where} faces away from the plane at {at}; plane_normal points from the rigid ground into the body")
    if tilt > _MOST_TILT:
        raise MeshError(
            f"{where} is at {tilt:.0f} degrees to the plane at its nearest point, {at} (bound {_MOST_TILT:.0f}): it does not "
            "face it; check plane_normal"
        )
    reach = FAR * mesh.diagonal if joint.tolerance is None else joint.tolerance
    if abs(distance[nearest]) > reach:
        raise MeshError(
            f"{where} is {distance[nearest]:.3g} m from the plane at its nearest point, {at}, and at most {reach:.3g} m "
            "are expected; check plane_point, or state a larger tolerance in the joint"
        )
    number = counted(points.n_points, "contact point")
    note = f"joint {joint.name!r}: {number}, {distance.min():.3g} to {distance.max():.3g} m off"
    return replace(points, z=np.tile(normal, (points.n_points, 1)), distance=distance, note=note)
