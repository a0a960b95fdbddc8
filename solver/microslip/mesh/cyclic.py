"""The faces at which the sectors of a disc meet: nodes of the high face are those of the low one, turned by one sector.

docs/theory.md, section 14.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from ..messages.errors import MeshError
from ..messages.words import place
from ..parallel.ownership import rows_of
from ..tables.cyclic import Cyclic
from .data import Mesh
from .surface import outward_faces

TOLERANCE = 1e-5  # of the mesh's diagonal, where the scene states none
_DIRECTION = 1e-9  # component of a held direction of one face along one that the other leaves free


@dataclass(frozen=True, eq=False)
class CyclicFaces:
    """Nodes of the two faces, one to one: positions high = turn (low - axis_point) + axis_point."""

    low: np.ndarray  # (n,) nodes of Mesh.points
    high: np.ndarray  # (n,)
    turn: np.ndarray  # (3, 3) Q, by one sector in the positive sense about the axis
    note: str  # for the log


def cyclic_faces(mesh: Mesh, cyclic: Cyclic) -> CyclicFaces:
    """Return the nodes of the faces at which sectors meet.  Local, rank 0.

    Raises
    ------
    MeshError : a node on the axis, nodes without a partner under the turn, faces swapped, or a wrong number of sectors
    """
    turn = rotation(cyclic.axis, cyclic.angle)
    if cyclic.faces is None:
        nothing = np.zeros(0, dtype=np.int64)
        return CyclicFaces(nothing, nothing, turn, f"cyclic: sector 0 of {cyclic.sectors}, which meet in joints alone")
    low, high = (mesh.node_groups[group] for group in cyclic.faces)
    where = f"{mesh.path}: [cyclic] faces"
    tolerance = TOLERANCE * mesh.diagonal if cyclic.tolerance is None else cyclic.tolerance
    _refuse_shared(mesh, cyclic, low, high, where)
    turned = turned_about(mesh.points[low], turn, cyclic.axis_point)
    distance, partner = cKDTree(mesh.points[high]).query(turned)
    back, _ = cKDTree(turned).query(mesh.points[high])
    lonely = int(np.count_nonzero(distance > tolerance)), int(np.count_nonzero(back > tolerance))
    if any(lonely):
        side, at, worst = ((low, cyclic.faces[0]), int(np.argmax(distance)), float(distance.max()))
        if back.max() > distance.max():
            side, at, worst = ((high, cyclic.faces[1]), int(np.argmax(back)), float(back.max()))
        node = side[0][at]
        raise MeshError(
            f"{where}: turned by 360/{cyclic.sectors} degrees about the axis, {lonely[0]} of {len(low)} nodes of "
            f"{cyclic.faces[0]!r} and {lonely[1]} of {len(high)} nodes of {cyclic.faces[1]!r} have no partner within "
            f"{tolerance:.3g} m; the worst is node {mesh.numbers[node]} of {side[1]!r} at {place(mesh.points[node])} m, "
            f"{worst:.3g} m from the nearest one{_why(mesh, cyclic, low, high, tolerance)}"
        )
    if len(np.unique(partner)) < len(low):
        counts = np.bincount(partner)
        node = high[int(np.argmax(counts))]
        raise MeshError(
            f"{where}: {counts.max()} nodes of {cyclic.faces[0]!r} come to lie within {tolerance:.3g} m of node "
            f"{mesh.numbers[node]} of {cyclic.faces[1]!r}; state a smaller tolerance, or merge the double nodes"
        )
    note = (
        f"cyclic: sector 0 of {cyclic.sectors}; {len(low)} nodes of {cyclic.faces[1]!r} follow those of {cyclic.faces[0]!r}, "
        f"up to {distance.max():.2g} m from their turned places"
    )
    return CyclicFaces(low, high[partner], turn, note)


def rotation(axis, angle: float) -> np.ndarray:
    """Return the matrix (3, 3) of a turn about an axis through the origin in its positive sense, angle in rad.  Local."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def turned_about(points: np.ndarray, turn: np.ndarray, axis_point) -> np.ndarray:
    """Return points (n, 3) turned about a point of the axis.  Local."""
    return (points - axis_point) @ turn.T + axis_point


def in_next_sector(mesh: Mesh, group: str, cyclic: Cyclic) -> Mesh:
    """Return the mesh with the nodes of one surface where they are in the next sector.  Local, rank 0.

    Raises
    ------
    MeshError : no such faces
    """
    faces = outward_faces(mesh, group)
    nodes = np.unique(np.concatenate([of_kind.ravel() for of_kind in faces.values()]))
    points = mesh.points.copy()
    points[nodes] = turned_about(points[nodes], rotation(cyclic.axis, cyclic.angle), cyclic.axis_point)
    return replace(mesh, points=points)


def _refuse_shared(mesh: Mesh, cyclic: Cyclic, low: np.ndarray, high: np.ndarray, where: str) -> None:
    """Raise MeshError for nodes that both faces have: on the axis they are one node of all sectors."""
    shared = np.intersect1d(low, high)
    if len(shared) == 0:
        return
    assert cyclic.faces is not None, "groups of nodes"
    node = shared[np.argmin(mesh.numbers[shared])]
    assert cyclic.faces is not None, "with two faces"
    raise MeshError(
        f"{where}: {cyclic.faces[0]!r} and {cyclic.faces[1]!r} share {len(shared)} nodes, the first is node "
        f"{mesh.numbers[node]} at {place(mesh.points[node])} m; a node on the axis belongs to all sectors at once and cannot "
        "follow: leave a small bore about the axis, or take other nodes out of one group"
    )


def _why(mesh: Mesh, cyclic: Cyclic, low: np.ndarray, high: np.ndarray, tolerance: float) -> str:
    """Return a text on what the faces may be: swapped, of another number of sectors, or meshed differently."""

    def fits(angle: float) -> bool:
        turned = turned_about(mesh.points[low], rotation(cyclic.axis, angle), cyclic.axis_point)
        return len(low) == len(high) and float(cKDTree(mesh.points[high]).query(turned)[0].max()) <= tolerance

    if fits(-cyclic.angle):
        return (
            "; turned the other way they fit: swap the two faces (the high one lies in the positive sense about the axis, by "
            "the right-hand rule), or reverse the axis"
        )
    angle = _angle_between(mesh, cyclic, low, high)
    if abs(angle) > 1e-6 and fits(angle):
        fitting = f"{abs(2.0 * np.pi / angle):.6g} sectors" + (", with the two faces swapped" if angle < 0.0 else "")
        return f"; they lie {np.degrees(abs(angle)):.6g} degrees apart, which is that of {fitting}"
    return "; mesh the two faces alike (one a turned copy of the other), check axis and axis_point, or state a larger tolerance"


def _angle_between(mesh: Mesh, cyclic: Cyclic, low: np.ndarray, high: np.ndarray) -> float:
    """Return the angle from the centre of the low face to that of the high one about the axis, in -pi to pi."""
    axis = np.asarray(cyclic.axis, dtype=float) / np.linalg.norm(cyclic.axis)
    a, b = (mesh.points[nodes].mean(axis=0) - cyclic.axis_point for nodes in (low, high))
    a, b = a - (a @ axis) * axis, b - (b @ axis) * axis
    return float(np.arctan2(axis @ np.cross(a, b), a @ b))


def followers(
    mesh: Mesh, faces: CyclicFaces, is_fixed: np.ndarray, dependent: np.ndarray, weights: sp.csr_matrix
) -> tuple[np.ndarray, sp.csr_matrix]:
    """Return the degrees of freedom of the high face that follow, rising, and their weights, for nodal diameter 0.

    Local, rank 0.  ``is_fixed`` (n_places, 3); ``dependent`` with ``weights`` (m, n_dof) follow something else already.

    Raises
    ------
    MeshError : ties, points or equations at the high face, or supports of one face alone
    """
    _refuse_followers(mesh, faces, dependent, weights)
    _refuse_other_supports(mesh, faces, is_fixed)
    n, n_dof = len(faces.high), weights.shape[1]
    row = np.broadcast_to(rows_of(faces.high).reshape(n, 3, 1), (n, 3, 3))
    column = np.broadcast_to(rows_of(faces.low).reshape(n, 1, 3), (n, 3, 3))
    value = np.broadcast_to(faces.turn, (n, 3, 3))
    whole = sp.csr_matrix((value.ravel(), (row.ravel(), column.ravel())), (n_dof, n_dof))
    follow = np.sort(rows_of(faces.high)[~is_fixed[faces.high].ravel()])
    stays = np.ones(n_dof)
    stays[dependent] = 0.0
    onward = sp.csr_matrix((np.ones(len(dependent)), (dependent, np.arange(len(dependent)))), (n_dof, len(dependent))) @ weights
    return follow, (whole[follow] @ (sp.diags(stays) + onward)).tocsr()


def _refuse_followers(mesh: Mesh, faces: CyclicFaces, dependent: np.ndarray, weights: sp.csr_matrix) -> None:
    """Raise MeshError where nodes of the high face follow or lead something within the sector: at the low face they may."""
    of_high = np.zeros(weights.shape[1], dtype=bool)
    of_high[rows_of(faces.high)] = True
    touched = np.concatenate([dependent[of_high[dependent]], np.unique(weights.indices[of_high[weights.indices]])])
    if len(touched):
        node = int(touched[0]) // 3
        raise MeshError(
            f"{mesh.path}: {len(np.unique(touched // 3))} nodes of the high face of [cyclic] belong to a tie, a point or an "
            f"equation, the first is node {mesh.numbers[node]} at {place(mesh.points[node])} m; they follow the low face "
            "already: take them out of that group, or merge the nodes there"
        )


def _refuse_other_supports(mesh: Mesh, faces: CyclicFaces, is_fixed: np.ndarray) -> None:
    """Raise MeshError where supports hold a node of one face in other directions than its partner, turned."""
    across = abs(faces.turn) > _DIRECTION
    at_low, at_high = is_fixed[faces.low], is_fixed[faces.high]
    unlike = (at_low[:, None, :] != at_high[:, :, None]) & across
    wrong = np.flatnonzero(unlike.any(axis=(1, 2)))
    if len(wrong) == 0:
        return
    low, high = faces.low[wrong[0]], faces.high[wrong[0]]
    held = ["".join(np.array(list("xyz"))[is_fixed[node]]) or "nothing" for node in (low, high)]
    raise MeshError(
        f"{mesh.path}: [[supports]] break the symmetry of [cyclic] at {len(wrong)} pairs of nodes of the two faces: node "
        f"{mesh.numbers[low]} at {place(mesh.points[low])} m is held along {held[0]}, its partner {mesh.numbers[high]} along "
        f"{held[1]}; hold both, all around or along the axis (a direction that turns with the sectors cannot be held alone)"
    )
