"""The faces between the sectors of a disc: the high face is the low face turned by one sector, and follows it.

docs/theory.md, section 14.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from ..messages.errors import MeshError
from ..messages.words import counted, place, verb
from ..parallel.ownership import rows_of
from ..tables.cyclic import Cyclic
from ..tables.joint import Joint
from .components import parts_of
from .data import Mesh
from .projection import Projection, project_on_surface
from .surface import nodes_of, outward_faces, surface_of
from .ties import TOUCHING, facet_size, on_facets, resolved

TOLERANCE = 1e-5  # of the mesh's diagonal: default tolerance
OF_FACETS = 0.05  # of the size of the facets: default tolerance of non-matching faces
_WEIGHT = 1e-9  # weight of fixed directions in the motion of a node, below which it is 0
_PARTLY = 0.1  # the same for nodes on facets: share that may be free below a fixed node, and must be below a free one


@dataclass(frozen=True, eq=False)
class CyclicFaces:
    """The nodes of the high face and their dependence: u_high = ``weights`` u for nodal diameter 0."""

    high: np.ndarray  # (n,) nodes of Mesh.points
    weights: sp.csr_matrix  # (3 n, 3 n_nodes), only nodes of the low face, including the rotation by one sector
    joined: np.ndarray  # (2, m) corresponding nodes of the low and the high face
    turn: np.ndarray  # (3, 3) Q, rotation by one sector in the positive sense about the axis
    is_matched: bool  # node to node; otherwise nodes on facets
    note: str  # for the log


def cyclic_faces(mesh: Mesh, cyclic: Cyclic) -> CyclicFaces:
    """Return the nodes of the faces between sectors: node to node, or the high face on the facets of the low face.

    Local, rank 0.

    Raises
    ------
    MeshError : a node on the axis, faces that do not meet after the rotation, swapped faces, or a wrong number of sectors
    """
    turn = rotation(cyclic.axis, cyclic.angle)
    if cyclic.faces is None:
        none: np.ndarray = np.zeros((2, 0), dtype=np.int64)
        weights = sp.csr_matrix((0, mesh.points.size))
        note = f"cyclic: sector 0 of {cyclic.sectors}, which meet only in joints"
        return CyclicFaces(none[0], weights, none, turn, True, note)
    low, high = (mesh.node_groups[group] for group in cyclic.faces)
    _refuse_shared(mesh, cyclic, low, high)
    tolerance = TOLERANCE * mesh.diagonal if cyclic.tolerance is None else cyclic.tolerance
    turned = turned_about(mesh.points[low], turn, cyclic.axis_point)
    distance, partner = cKDTree(mesh.points[high]).query(turned)
    back, _ = cKDTree(turned).query(mesh.points[high])
    if max(distance.max(), back.max()) > tolerance:
        return _tied(mesh, cyclic)
    if len(np.unique(partner)) < len(low):  # as where a joint reaches the faces, with a node of each of its bodies
        _, part = parts_of([block.nodes for block in mesh.elements], len(mesh.points))
        aside = 2.0 * mesh.diagonal * part[:, None]  # a fourth coordinate, in which only parts of the mesh are apart
        by_part = cKDTree(np.hstack([mesh.points[high], aside[high]])).query(np.hstack([turned, aside[low]]))
        distance, partner = by_part if by_part[0].max() <= tolerance else (distance, partner)
    if len(np.unique(partner)) < len(low):
        counts = np.bincount(partner)
        node = high[int(np.argmax(counts))]
        raise MeshError(
            f"{_where(mesh)}: {counts.max()} nodes of {cyclic.faces[0]!r} come to lie within {tolerance:.3g} m of node "
            f"{mesh.numbers[node]} of {cyclic.faces[1]!r}; state a smaller tolerance, or merge the double nodes"
        )
    note = (
        f"cyclic: sector 0 of {cyclic.sectors}; {counted(len(low), 'node')} of {cyclic.faces[1]!r} "
        f"follow those of {cyclic.faces[0]!r}, up to {distance.max():.2g} m from their turned places"
    )
    high = high[partner]
    unit = sp.csr_matrix((np.ones(len(low)), (np.arange(len(low)), low)), (len(low), len(mesh.points)))
    return CyclicFaces(high, sp.kron(unit, turn, format="csr"), np.stack([low, high]), turn, True, note)


def faces_fit(mesh: Mesh, cyclic: Cyclic) -> bool:
    """Return whether the high face is the low face turned by one sector; both are groups of faces.  Local, rank 0."""
    return _Meeting.of(mesh, cyclic, cyclic.angle).is_close(cyclic)


def _tied(mesh: Mesh, cyclic: Cyclic) -> CyclicFaces:
    """Return the nodes of a non-matching high face: they follow the turned facets of the low face as in a tie (2.6).

    Raises
    ------
    MeshError : nodes of either face far from the facets of the other after the rotation
    """
    assert cyclic.faces is not None, "with two faces"
    meeting = _Meeting.of(mesh, cyclic, cyclic.angle)
    _refuse_distant(mesh, cyclic, meeting)
    high, projection = meeting.nodes[1], meeting.projections[1]
    placed, size = in_next_sector(mesh, cyclic.faces[0], cyclic), meeting.size
    weights = on_facets(placed, projection, mesh.points[high], TOUCHING * size, len(mesh.points))
    turn = rotation(cyclic.axis, cyclic.angle)
    of_nodes = sp.kron(sp.eye(len(mesh.points)), turn, format="csr")
    note = (
        f"cyclic: sector 0 of {cyclic.sectors}; the faces are not meshed alike: {counted(len(high), 'node')} of "
        f"{cyclic.faces[1]!r} follow the facets of {cyclic.faces[0]!r}, "
        f"up to {projection.distance.max():.2g} m from their turned places"
    )
    lead = weights.tocoo()
    joined = np.unique(np.stack([lead.col // 3, high[lead.row // 3]]), axis=1)
    return CyclicFaces(high, (weights @ of_nodes).tocsr(), joined, turn, False, note)


@dataclass(frozen=True)
class _Meeting:
    """The distances of the two faces with the low face turned by an angle."""

    nodes: tuple[np.ndarray, np.ndarray]  # nodes of the low and of the high face
    projections: tuple[Projection, Projection]  # of the nodes of each on the facets of the other
    size: float  # size of the larger facets [m]

    @classmethod
    def of(cls, mesh: Mesh, cyclic: Cyclic, angle: float) -> _Meeting:
        """Return the distances for one angle.  Local, rank 0.  Raises MeshError: a group of nodes without a face."""
        assert cyclic.faces is not None, "with two faces"
        faces = tuple(outward_faces(mesh, group) for group in cyclic.faces)
        low, high = map(nodes_of, faces)
        points = mesh.points.copy()
        points[low] = turned_about(points[low], rotation(cyclic.axis, angle), cyclic.axis_point)
        on_high, on_low = (project_on_surface(points, faces[i], points[(low, high)[1 - i]]) for i in (1, 0))
        return cls((low, high), (on_high, on_low), max(facet_size(mesh, each) for each in faces))

    @property
    def distances(self) -> tuple[np.ndarray, np.ndarray]:
        """Distances of the nodes of the low and of the high face from the other face [m]."""
        return self.projections[0].distance, self.projections[1].distance

    def tolerance(self, cyclic: Cyclic) -> float:
        """Return the accepted distance of a node from the facets of the other face [m]."""
        return OF_FACETS * self.size if cyclic.tolerance is None else cyclic.tolerance

    def is_close(self, cyclic: Cyclic) -> bool:
        """Return whether the faces coincide.  Local."""
        return max(float(each.max()) for each in self.distances) <= self.tolerance(cyclic)


def _refuse_distant(mesh: Mesh, cyclic: Cyclic, meeting: _Meeting) -> None:
    """Raise MeshError if the faces do not coincide after the rotation, with the worst node and a possible cause."""
    if meeting.is_close(cyclic):
        return
    assert cyclic.faces is not None, "with two faces"
    tolerance, worst = meeting.tolerance(cyclic), [float(each.max()) for each in meeting.distances]
    n_far = [int(np.count_nonzero(each > tolerance)) for each in meeting.distances]
    side = int(worst[1] > worst[0])
    node = meeting.nodes[side][int(np.argmax(meeting.distances[side]))]
    raise MeshError(
        f"{_where(mesh)}: turned by 360/{cyclic.sectors} degrees about the axis, {n_far[0]} of "
        f"{counted(len(meeting.nodes[0]), 'node')} of "
        f"{cyclic.faces[0]!r} and {n_far[1]} of {counted(len(meeting.nodes[1]), 'node')} of {cyclic.faces[1]!r} lie farther than "
        f"{tolerance:.3g} m from the other face; the worst is node {mesh.numbers[node]} of {cyclic.faces[side]!r} at "
        f"{place(mesh.points[node])} m, {worst[side]:.3g} m from it{_why(mesh, cyclic)}"
    )


def _where(mesh: Mesh) -> str:
    return f"{mesh.path}: [cyclic] faces"


def rotation(axis, angle: float) -> np.ndarray:
    """Return the matrix (3, 3) of a rotation about an axis through the origin in its positive sense, angle in rad.  Local."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def turned_about(points: np.ndarray, turn: np.ndarray, axis_point) -> np.ndarray:
    """Return points (n, 3) turned about a point of the axis.  Local."""
    return (points - axis_point) @ turn.T + axis_point


def in_next_sector(mesh: Mesh, group: str, cyclic: Cyclic) -> Mesh:
    """Return the mesh with the nodes of one surface at their positions in the next sector.  Local, rank 0.

    Raises
    ------
    MeshError : the group has no faces
    """
    nodes = nodes_of(outward_faces(mesh, group))
    points = mesh.points.copy()
    points[nodes] = turned_about(points[nodes], rotation(cyclic.axis, cyclic.angle), cyclic.axis_point)
    return replace(mesh, points=points)


def _refuse_shared(mesh: Mesh, cyclic: Cyclic, low: np.ndarray, high: np.ndarray) -> None:
    """Raise MeshError for nodes in both faces: a node on the axis belongs to all sectors."""
    shared = np.intersect1d(low, high)
    if len(shared) == 0:
        return
    assert cyclic.faces is not None, "with two faces"
    node = shared[np.argmin(mesh.numbers[shared])]
    turned = turned_about(mesh.points[node], rotation(cyclic.axis, np.pi), cyclic.axis_point)
    is_on_axis = float(np.linalg.norm(turned - mesh.points[node])) <= TOLERANCE * mesh.diagonal
    remedy = (
        "a node on the axis belongs to all sectors at once and cannot follow: leave a small bore about the axis"
        if is_on_axis
        else "a node off the axis lies on one of the two faces: take these nodes out of the other group"
    )
    raise MeshError(
        f"{_where(mesh)}: {cyclic.faces[0]!r} and {cyclic.faces[1]!r} share {counted(len(shared), 'node')}, the first is node "
        f"{mesh.numbers[node]} at {place(mesh.points[node])} m; {remedy}"
    )


def check_joints_beside(mesh: Mesh, cyclic: Cyclic, joints: Sequence[Joint]) -> None:
    """Raise MeshError if faces where sectors are one body belong to a joint.  Local, rank 0."""
    for group in cyclic.faces or ():
        is_member = np.zeros(len(mesh.points), dtype=bool)
        is_member[mesh.node_groups[group]] = True
        for joint in joints:
            for surface in joint.groups if joint.node_pairs is None else ():
                both = sum(int(is_member[nodes].all(axis=1).sum()) for nodes in outward_faces(mesh, surface).values())
                if both:
                    raise MeshError(
                        f"{_where(mesh)}: {counted(both, 'face')} of {group!r} {verb(both, 'are')} also of {surface!r} "
                        f"of joint {joint.name!r}: there "
                        "the sectors are one body, which cannot slip; take them out of one of the two groups (sectors that meet "
                        "in joints alone have no faces)"
                    )


def _why(mesh: Mesh, cyclic: Cyclic) -> str:
    """Return a text on the possible fault of the faces: swapped, another number of sectors, or not turned copies."""
    if _Meeting.of(mesh, cyclic, -cyclic.angle).is_close(cyclic):
        return (
            "; turned the other way they fit: swap the two faces (the high one lies in the positive sense about the axis, by "
            "the right-hand rule), or reverse the axis"
        )
    angle = _angle_between(mesh, cyclic)
    if abs(angle) > 1e-6 and _Meeting.of(mesh, cyclic, angle).is_close(cyclic):
        fitting = f"{abs(2.0 * np.pi / angle):.6g} sectors" + (", with the two faces swapped" if angle < 0.0 else "")
        return f"; they lie {np.degrees(abs(angle)):.6g} degrees apart, which is that of {fitting}"
    return "; make one face a turned copy of the other, check axis and axis_point, or state a larger tolerance"


def _angle_between(mesh: Mesh, cyclic: Cyclic) -> float:
    """Return the angle about the axis from the centre of the low face to the centre of the high face, in -pi to pi."""
    assert cyclic.faces is not None, "with two faces"
    axis = np.asarray(cyclic.axis, dtype=float) / np.linalg.norm(cyclic.axis)
    a, b = (_centre(mesh, group) - cyclic.axis_point for group in cyclic.faces)
    a, b = a - (a @ axis) * axis, b - (b @ axis) * axis
    return float(np.arctan2(axis @ np.cross(a, b), a @ b))


def _centre(mesh: Mesh, group: str) -> np.ndarray:
    """Return the centroid of the area of a face."""
    side = surface_of(mesh, group)
    return side.areas @ mesh.points[side.nodes] / side.areas.sum()


def followers(
    mesh: Mesh, faces: CyclicFaces, is_fixed: np.ndarray, dependent: np.ndarray, weights: sp.csr_matrix
) -> tuple[np.ndarray, sp.csr_matrix]:
    """Return the dependent degrees of freedom of the high face, ascending, and their weights, for nodal diameter 0.

    Local, rank 0.  ``is_fixed`` (n_places, 3); ``dependent`` with ``weights`` (m, n_dof): the other dependent ones.

    Raises
    ------
    MeshError : ties, points or equations at the high face, or supports of only one face
    """
    _refuse_followers(mesh, faces, dependent, weights)
    _refuse_other_supports(mesh, faces, is_fixed)
    n_dof, rows, of_high = weights.shape[1], rows_of(faces.high), faces.weights.tocoo()
    whole = sp.csr_matrix((of_high.data, (rows[of_high.row], of_high.col)), (n_dof, n_dof))
    follow = np.sort(rows[~is_fixed[faces.high].ravel()])
    return follow, resolved(dependent, weights, whole[follow])


def _refuse_followers(mesh: Mesh, faces: CyclicFaces, dependent: np.ndarray, weights: sp.csr_matrix) -> None:
    """Raise MeshError if nodes of the high face follow or lead others within the sector; nodes of the low face may."""
    of_high = np.zeros(weights.shape[1], dtype=bool)
    of_high[rows_of(faces.high)] = True
    touched = np.concatenate([dependent[of_high[dependent]], np.unique(weights.indices[of_high[weights.indices]])])
    if len(touched):
        node = int(touched[0]) // 3
        raise MeshError(
            f"{mesh.path}: {counted(len(np.unique(touched // 3)), 'node')} of the high face of [cyclic] belong to a "
            "tie, a point or an "
            f"equation, the first is node {mesh.numbers[node]} at {place(mesh.points[node])} m; they follow the low face "
            "already: take them out of that group, or merge the nodes there"
        )


def _refuse_other_supports(mesh: Mesh, faces: CyclicFaces, is_fixed: np.ndarray) -> None:
    """Raise MeshError if supports hold a node of one face in other directions than its turned partner."""
    size, of_high = abs(faces.weights), is_fixed[faces.high].ravel()
    of_low = np.asarray(size @ is_fixed.ravel()[: size.shape[1]]).ravel() / np.asarray(size.sum(axis=1)).ravel()
    # a free node next to the end of a support lies on facets some of whose nodes are fixed
    allowed = _WEIGHT if faces.is_matched else np.where(of_high, _PARTLY, 1.0 - _PARTLY)
    wrong = np.flatnonzero(abs(of_low - of_high) > allowed)
    if len(wrong) == 0:
        return
    high, n_wrong = faces.high[wrong[0] // 3], len(np.unique(wrong // 3))
    of_node = size[wrong[0]]
    low = int(of_node.indices[np.argmax(of_node.data * (is_fixed.ravel()[of_node.indices] != of_high[wrong[0]]))]) // 3
    partner = "its partner" if faces.is_matched else "and, on a facet with it,"
    words = ["".join(np.array(list("xyz"))[is_fixed[node]]) or "nothing" for node in (low, high)]
    raise MeshError(
        f"{mesh.path}: [[supports]] break the symmetry of [cyclic] at {counted(n_wrong, 'pair')} of nodes of the two faces: node "
        f"{mesh.numbers[low]} at {place(mesh.points[low])} m is fixed along {words[0]}, {partner} {mesh.numbers[high]} along "
        f"{words[1]}; fix both, all around or along the axis (a direction that turns with the sectors cannot be fixed alone)"
    )
