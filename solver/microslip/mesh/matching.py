"""Contact of two surfaces with matching meshes: coincident nodes, one to one."""

import numpy as np
from scipy.spatial import cKDTree

from ..messages.errors import MeshError
from ..messages.words import counted, place
from ..tables.joint import Joint
from .contact_points import ContactPoints, check_opposite
from .data import Mesh, on_nodes
from .surface import Surface

TOLERANCE = 1e-6  # of the mesh's diagonal: default tolerance


class NotMatching(MeshError):
    """The nodes of two surfaces do not coincide one to one."""


def matching_nodes(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> ContactPoints:
    """Return a point for each node of the first surface and the coincident node of the second.  Local, rank 0.

    Areas are the means of both sides' tributary areas.

    Raises
    ------
    NotMatching : nodes without a partner or with several
    MeshError : sides that do not face each other
    """
    i1, i2 = _match(mesh, joint, first, second)
    order = np.argsort(mesh.numbers[first.nodes[i1]], kind="stable")
    i1, i2 = i1[order], i2[order]
    z = second.normals[i2] - first.normals[i1]  # out of body 2 into body 1, the mean of both sides
    node1, node2 = first.nodes[i1], second.nodes[i2]
    check_opposite(mesh, joint, first.normals[i1], second.normals[i2], mesh.points[node1])
    pair_of = np.full(len(mesh.points), -1)
    pair_of[node2] = np.arange(len(node2))
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    return ContactPoints(
        side1=on_nodes(node1, len(mesh.points)),
        side2=on_nodes(node2, len(mesh.points)),
        z=z,
        area=(first.areas[i1] + second.areas[i2]) / 2,
        position=(mesh.points[node1] + mesh.points[node2]) / 2,
        distance=np.einsum("pi,pi->p", z, mesh.points[node1] - mesh.points[node2]),
        faces=tuple(pair_of[nodes] for nodes in second.faces.values()),
    )


def _match(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Return positions in ``first.nodes`` and ``second.nodes`` of the coincident nodes, one to one."""
    tolerance = TOLERANCE * mesh.diagonal if joint.tolerance is None else joint.tolerance
    points1, points2 = mesh.points[first.nodes], mesh.points[second.nodes]
    distance1, partner = cKDTree(points2).query(points1)
    distance2, partner2 = cKDTree(points1).query(points2)
    lonely1, lonely2 = distance1 > tolerance, distance2 > tolerance
    if lonely1.any() or lonely2.any():
        side, distance = (first, distance1) if distance1.max() >= distance2.max() else (second, distance2)
        worst = side.nodes[np.argmax(distance)]
        raise NotMatching(
            f"{mesh.path}: joint {joint.name!r}: {np.count_nonzero(lonely1)} of {counted(len(points1), 'node')} of "
            f"{first.group!r} and {np.count_nonzero(lonely2)} of {counted(len(points2), 'node')} of {second.group!r} have no "
            f"partner within {tolerance:.3g} m; the worst is node {mesh.numbers[worst]} of {side.group!r} at "
            f"{place(mesh.points[worst])} m, {distance.max():.3g} m from the nearest node of the other side; "
            "mesh the two surfaces alike, or state a larger tolerance in the joint"
        )
    for side, other, chosen in ((first, second, partner), (second, first, partner2)):
        nodes, count = np.unique(chosen, return_counts=True)
        if (count > 1).any():
            node = nodes[np.argmax(count)]
            rivals = mesh.numbers[side.nodes[chosen == node]]
            raise NotMatching(
                f"{mesh.path}: joint {joint.name!r}: nodes {rivals[0]} and {rivals[1]} of {side.group!r} both lie "
                f"within {tolerance:.3g} m of node {mesh.numbers[other.nodes[node]]} of {other.group!r}; "
                "state a smaller tolerance, or remove the double node"
            )
    return np.arange(len(points1)), partner
