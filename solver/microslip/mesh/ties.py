"""Tied surfaces: the nodes of the first follow the facets of the second, for any meshes.

Degrees of freedom are numbered by places: the nodes of the mesh, then two per point (displacement and rotation); place i has the
degrees of freedom 3 i to 3 i + 2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .. import elements
from ..messages.errors import Faults, MeshError
from ..messages.words import counted, place
from ..parallel.ownership import rows_of
from ..tables.structure import Tie
from ..tables.structure_tables import StructureTables
from .data import Mesh
from .projection import Projection, project_on_surface
from .surface import face_keys, nodes_of, outward_faces

Faces = Mapping[str, np.ndarray]  # by kind, (n_faces, n_face_nodes) index into Mesh.points
TOLERANCE = 0.05  # of the size of the facets: default tolerance
COARSER = 1.2  # ratio of facet sizes above which a side is coarser
LEAST = 0.01  # fraction of the nodes of the first surface that must lie near the second
MANY = 0.5  # fraction of nodes beyond the tolerance that causes a warning
TOUCHING = 1e-9  # of the size of the facets: distance below which nodes lie on them


@dataclass(frozen=True, eq=False)
class Follower:
    """Dependent degrees of freedom of one tie or point."""

    what: str  # name for messages
    dependent: np.ndarray  # (m,) degrees of freedom
    weights: sp.csr_matrix  # (m, n_dof)
    joined: np.ndarray  # (2, n) nodes
    note: str
    faces: tuple[Faces, ...] = ()  # glued faces of each side of a tie, by kind


def of_tie(mesh: Mesh, tie: Tie, n_places: int, taken: np.ndarray) -> Follower:
    """Return the dependence of the nodes of the first surface on the facets of the second within the tolerance.

    Nodes beyond the tolerance remain free, as in Abaqus; so do nodes of both surfaces, which are merged there, and nodes of
    another tie, ``taken`` (n_nodes,) bool.  The note counts them.

    Raises
    ------
    MeshError : fewer than ``LEAST`` of the nodes lie near the facets
    """
    first, second = (outward_faces(mesh, group) for group in tie.surfaces)
    nodes = nodes_of(first)
    is_shared, is_taken = np.isin(nodes, nodes_of(second)), taken[nodes]
    projection = project_on_surface(mesh.points, second, mesh.points[nodes])
    size = facet_size(mesh, second)
    tolerance = TOLERANCE * size if tie.tolerance is None else tie.tolerance
    is_near = projection.distance <= tolerance
    _check_near(mesh, tie, nodes, projection, is_near, tolerance)
    follows = is_near & ~is_shared & ~is_taken
    n_beyond, tied = int(np.count_nonzero(~is_near)), projection.of(np.flatnonzero(follows))
    weights = on_facets(mesh, tied, mesh.points[nodes[follows]], TOUCHING * size, n_places)
    joined = np.stack([np.repeat(nodes[follows], tied.nodes.shape[1]), tied.nodes.ravel()])
    counts = f"{len(tied.nodes)} of {len(nodes)}" if len(tied.nodes) < len(nodes) else f"{len(nodes)}"
    note = (
        f"{'WARNING: ' if n_beyond > MANY * len(nodes) else ''}tie {tie.label!r}: {counts} nodes of {tie.surfaces[0]!r} follow "
        f"the facets of {tie.surfaces[1]!r}, up to {tied.distance.max(initial=0.0):.3g} m from them"
    )
    for n, why in (
        (n_beyond, f"lie farther than {tolerance:.3g} m from them and stay free"),
        (np.count_nonzero(is_near & is_shared), "are nodes of both surfaces"),
        (np.count_nonzero(is_near & is_taken & ~is_shared), "follow another tie"),
    ):
        note += f"; {n} {why}" if n else ""
    if facet_size(mesh, first) > COARSER * size:
        note += "; the coarser surface follows the finer one: swapped, the stresses next to the tie are more accurate"
    glued = (
        (first, second)
        if not n_beyond
        else (_whole(first, nodes[is_near]), _under(second, projection.of(np.flatnonzero(is_near))))
    )
    return Follower(f"tie {tie.label!r}", rows_of(nodes[follows]), weights, joined, note, glued)


def _whole(faces: Faces, nodes: np.ndarray) -> Faces:
    """Return the faces with all nodes in ``nodes``."""
    return {kind: corners[np.isin(corners, nodes).all(axis=1)] for kind, corners in faces.items()}


def _under(faces: Faces, projection: Projection) -> Faces:
    """Return the faces with feet of points."""
    return {kind: corners[np.unique(projection.face[projection.kind == kind])] for kind, corners in faces.items()}


def facet_size(mesh: Mesh, faces: Faces) -> float:
    """Return the mean of the square roots of the facets' areas [m]."""
    areas = [elements.face_nodal_areas(kind, mesh.points[nodes]).sum(axis=1) for kind, nodes in faces.items()]
    return float(np.sqrt(np.concatenate(areas)).mean())


def on_facets(mesh: Mesh, projection: Projection, points: np.ndarray, touching: float, n_places: int) -> sp.csr_matrix:
    """Return the weights of the nodes of the facets, (3 n, 3 n_places): docs/theory.md, eq. (2.6).

    A point off its foot is connected to it by a rigid arm, so that a rotation of both surfaces causes no strain.
    """
    n, k = projection.weights.shape
    blocks = projection.weights[:, :, None, None] * np.eye(3)
    away = points - projection.foot
    off = np.flatnonzero(projection.distance > touching)
    for kind in np.unique(projection.kind[off]):
        rows = off[projection.kind[off] == kind]
        face = elements.FACE_KINDS[str(kind)]
        slopes, m = face.derivatives(projection.xi[rows]), face.n_nodes
        tangents = np.einsum("fra,fai->fri", slopes, mesh.points[projection.nodes[rows, :m]])
        gradients = np.einsum("fra,fir->fai", slopes, np.linalg.pinv(tangents))
        along = away[rows] - projection.gap[rows, None] * projection.normals[rows]
        blocks[rows, :m] += np.einsum("fi,fai->fa", along, gradients)[:, :, None, None] * np.eye(3)
        blocks[rows, :m] -= np.einsum("f,fai,fj->faij", projection.gap[rows], gradients, projection.normals[rows])
    row = np.broadcast_to(np.arange(3 * n).reshape(n, 1, 3, 1), (n, k, 3, 3))
    column = np.broadcast_to(3 * projection.nodes[:, :, None, None] + np.arange(3), (n, k, 3, 3))
    weights = sp.csr_matrix((blocks.ravel(), (row.ravel(), column.ravel())), (3 * n, 3 * n_places))
    weights.eliminate_zeros()
    return weights


def _check_near(mesh: Mesh, tie: Tie, nodes: np.ndarray, projection: Projection, is_near: np.ndarray, tolerance: float) -> None:
    """Raise MeshError if too few nodes lie within the tolerance."""
    if np.count_nonzero(is_near) >= max(1.0, LEAST * len(nodes)):
        return
    nearest_node = int(np.argmin(projection.distance))
    raise MeshError(
        f"{mesh.path}: tie {tie.label!r}: {np.count_nonzero(~is_near)} of {counted(len(nodes), 'node')} of "
        f"{tie.surfaces[0]!r} lie farther "
        f"than {tolerance:.3g} m from the facets of {tie.surfaces[1]!r}; the nearest is node {mesh.numbers[nodes[nearest_node]]} "
        f"at {place(mesh.points[nodes[nearest_node]])} m, {projection.distance[nearest_node]:.3g} m from them; name the surfaces "
        "that touch, or state a larger tolerance"
    )


def resolved(dependent: np.ndarray, weights: sp.csr_matrix, rows: sp.csr_matrix) -> sp.csr_matrix:
    """Return ``rows`` (k, n_dof) of weights with dependent degrees of freedom (m,) replaced by their ``weights`` (m, n_dof)."""
    n_dof, m = rows.shape[1], len(dependent)
    is_independent = np.ones(n_dof)
    is_independent[dependent] = 0.0
    of_dependent = sp.csr_matrix((np.ones(m), (dependent, np.arange(m))), (n_dof, m)) @ weights
    return (rows @ (sp.diags(is_independent) + of_dependent)).tocsr()


def check_joints(mesh: Mesh, tables: StructureTables, ties: Sequence[Follower]) -> None:
    """Raise MeshError if a face is tied and belongs to a joint.  ``ties`` are in the order of ``tables``."""
    if not ties:
        return
    faults = Faults()
    glued = [[face_keys(faces) for faces in tie.faces] for tie in ties] if tables.joints else []
    for joint in tables.joints:
        for group in joint.groups:
            keys = face_keys(outward_faces(mesh, group))
            for tie, sides in zip(tables.ties, glued):
                for name, side in zip(tie.surfaces, sides):
                    both = keys & side
                    if both:
                        text = (
                            f"{mesh.path}: {counted(len(both), 'face')} of {group!r} of joint {joint.name!r} are faces "
                            f"of {name!r} of tie "
                            f"{tie.label!r}: tied faces cannot slip; take them out of one of the two groups"
                        )
                        faults.add([MeshError(text)])
    faults.refuse()
