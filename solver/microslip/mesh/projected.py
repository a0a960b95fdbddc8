"""Contact of two surfaces of any meshes at the nodes of the first, projected onto the facets of the second."""

import numpy as np
import scipy.sparse as sp

from ..messages.errors import MeshError
from ..messages.words import counted, place
from ..tables.joint import Joint
from .contact_points import ContactPoints, check_opposite
from .data import Mesh, on_nodes
from .overlap import COVERED, reach_of
from .penetration import check_sunk
from .projection import project_on_surface
from .surface import Surface, on_mesh


def projected_nodes(mesh: Mesh, joint: Joint, first: Surface, second: Surface) -> ContactPoints:
    """Return a point for each node of the first surface that lies on a facet of the second, with its tributary area.

    Local, rank 0.  For matching meshes the points are pairs of nodes.

    Raises
    ------
    MeshError : sides too far apart or facing away, or a part of the first surface without a partner
    """
    reach = reach_of(mesh, joint, first, second)
    foot = project_on_surface(mesh.points, second.faces, mesh.points[first.nodes])
    near = foot.distance <= reach
    if not near.any():
        check_sunk(mesh, joint, first, second, foot)
    _check_near(mesh, joint, first, second, foot.distance, reach)
    nodes_used = np.flatnonzero(near)
    nodes_used = nodes_used[np.argsort(mesh.numbers[first.nodes[nodes_used]], kind="stable")]
    nodes = first.nodes[nodes_used]
    rows = np.repeat(np.arange(len(nodes_used)), foot.nodes.shape[1])
    shape = (len(nodes_used), len(mesh.points))
    side2 = sp.csr_matrix((foot.weights[nodes_used].ravel(), (rows, foot.nodes[nodes_used].ravel())), shape)
    side2.eliminate_zeros()
    normal2 = side2 @ on_mesh(mesh, second)
    normal2 /= np.linalg.norm(normal2, axis=1, keepdims=True)
    check_opposite(mesh, joint, first.normals[nodes_used], normal2, mesh.points[nodes])
    z = normal2 - first.normals[nodes_used]
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    distance = np.einsum("pi,pi->p", z, mesh.points[nodes] - foot.foot[nodes_used])
    point_of = np.full(len(mesh.points), -1)
    point_of[nodes] = np.arange(len(nodes))
    faces = [point_of[corners] for corners in first.faces.values()]
    return ContactPoints(
        side1=on_nodes(nodes, len(mesh.points)),
        side2=side2,
        z=z,
        area=first.areas[nodes_used],
        position=(mesh.points[nodes] + foot.foot[nodes_used]) / 2,
        distance=distance,
        faces=tuple(corners[(corners >= 0).all(axis=1)] for corners in faces),
        note=f"joint {joint.name!r}: {counted(len(nodes_used), 'contact point')}, nodes of {first.group!r} on facets "
        f"of {second.group!r}, {distance.min():.3g} to {distance.max():.3g} m away (at most {reach:.3g} m)",
    )


def _check_near(mesh: Mesh, joint: Joint, first: Surface, second: Surface, distance: np.ndarray, reach: float) -> None:
    """Raise MeshError if too much of the first surface has no partner."""
    near = distance <= reach
    covered = first.areas[near].sum() / first.areas.sum()
    if covered >= COVERED or (near.any() and first.group in mesh.touching_faces):
        return
    worst = int(np.argmax(distance))
    part = f"{1.0 - covered:.1%} of the area of {first.group!r}" if near.any() else "no contact point found: all its nodes"
    raise MeshError(
        f"{mesh.path}: joint {joint.name!r}: {part} have no partner within {reach:.3g} m on {second.group!r}; the worst is node "
        f"{mesh.numbers[first.nodes[worst]]} of {first.group!r} at {place(mesh.points[first.nodes[worst]])} m, "
        f"{distance[worst]:.3g} m from the other side; name the smaller surface first, restrict the first group to what touches, "
        "or state a larger tolerance"
    )
