"""Tied surfaces: the nodes of the first follow the facets of the second, whatever their meshes.

Degrees of freedom are counted by places: the nodes of the mesh, and then two for each point, its displacement and its rotation;
place i has 3 i to 3 i + 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .. import elements
from ..messages.errors import MeshError
from ..messages.words import place
from ..parallel.ownership import rows_of
from ..tables.structure import Tie
from ..tables.structure_tables import StructureTables
from .data import Mesh
from .projection import Projection, project_on_surface
from .surface import face_keys, outward_faces

TOLERANCE = 0.05  # of the size of the facets, where a tie states none
COARSER = 1.2  # times as large as the facets of the other side
TOUCHING = 1e-9  # of the size of the facets: closer nodes lie on them


@dataclass(frozen=True, eq=False)
class Follower:
    """What one tie or point makes follow."""

    what: str  # for messages
    dependent: np.ndarray  # (m,) degrees of freedom
    weights: sp.csr_matrix  # (m, n_dof)
    joined: np.ndarray  # (2, n) nodes
    note: str


def of_tie(mesh: Mesh, tie: Tie, n_places: int) -> Follower:
    """Return how the nodes of the first surface follow the facets of the second."""
    first, second = (outward_faces(mesh, group) for group in tie.surfaces)
    nodes, others = (
        np.unique(np.concatenate([nodes_of_faces.ravel() for nodes_of_faces in faces.values()])) for faces in (first, second)
    )
    where = f"{mesh.path}: tie {tie.name!r}"
    shared = np.intersect1d(nodes, others)
    if len(shared):
        raise MeshError(
            f"{where}: {tie.surfaces[0]!r} and {tie.surfaces[1]!r} share {len(shared)} nodes (the first is node "
            f"{mesh.numbers[shared].min()}): they are one there already; leave the tie out, or tie the other faces alone"
        )
    projection = project_on_surface(mesh.points, second, mesh.points[nodes])
    size = _facet_size(mesh, second)
    _check_near(mesh, tie, nodes, projection, TOLERANCE * size if tie.tolerance is None else tie.tolerance, where)
    weights = _on_facets(mesh, projection, mesh.points[nodes], TOUCHING * size, n_places)
    joined = np.stack([np.repeat(nodes, projection.nodes.shape[1]), projection.nodes.ravel()])
    note = (
        f"tie {tie.name!r}: {len(nodes)} nodes of {tie.surfaces[0]!r} follow the facets of {tie.surfaces[1]!r}, up to "
        f"{projection.distance.max():.3g} m from them"
    )
    if _facet_size(mesh, first) > COARSER * size:
        note += "; the coarser surface follows the finer one: swapped, the stresses beside them are better"
    return Follower(f"tie {tie.name!r}", rows_of(nodes), weights, joined, note)


def _facet_size(mesh: Mesh, faces: dict[str, np.ndarray]) -> float:
    """Return the mean of the roots of the facets' areas [m]."""
    areas = [elements.face_nodal_areas(kind, mesh.points[nodes]).sum(axis=1) for kind, nodes in faces.items()]
    return float(np.sqrt(np.concatenate(areas)).mean())


def _on_facets(mesh: Mesh, projection: Projection, points: np.ndarray, touching: float, n_places: int) -> sp.csr_matrix:
    """Return the weights of the nodes of the facets, (3 n, 3 n_places): docs/theory.md, eq. (2.6).

    A point off its foot moves with it as if a rigid arm led there, so that turning both surfaces strains nothing.
    """
    n, k = projection.weights.shape
    blocks = projection.weights[:, :, None, None] * np.eye(3)
    away = points - projection.foot
    off = np.flatnonzero(projection.distance > touching)
    for kind in np.unique(projection.kind[off]):
        mine = off[projection.kind[off] == kind]
        face = elements.FACE_KINDS[str(kind)]
        slopes, m = face.derivatives(projection.xi[mine]), face.n_nodes
        tangents = np.einsum("fra,fai->fri", slopes, mesh.points[projection.nodes[mine, :m]])
        gradients = np.einsum("fra,fir->fai", slopes, np.linalg.pinv(tangents))
        along = away[mine] - projection.gap[mine, None] * projection.normals[mine]
        blocks[mine, :m] += np.einsum("fi,fai->fa", along, gradients)[:, :, None, None] * np.eye(3)
        blocks[mine, :m] -= np.einsum("f,fai,fj->faij", projection.gap[mine], gradients, projection.normals[mine])
    row = np.broadcast_to(np.arange(3 * n).reshape(n, 1, 3, 1), (n, k, 3, 3))
    column = np.broadcast_to(3 * projection.nodes[:, :, None, None] + np.arange(3), (n, k, 3, 3))
    weights = sp.csr_matrix((blocks.ravel(), (row.ravel(), column.ravel())), (3 * n, 3 * n_places))
    weights.eliminate_zeros()
    return weights


def _check_near(mesh: Mesh, tie: Tie, nodes: np.ndarray, projection: Projection, tolerance: float, where: str) -> None:
    """Raise MeshError where nodes lie beyond the tolerance: left loose they would open a crack that nobody asked for."""
    far = projection.distance > tolerance
    if far.any():
        worst = int(np.argmax(projection.distance))
        raise MeshError(
            f"{where}: {np.count_nonzero(far)} of {len(nodes)} nodes of {tie.surfaces[0]!r} lie farther than {tolerance:.3g} m "
            f"from the facets of {tie.surfaces[1]!r}; the worst is node {mesh.numbers[nodes[worst]]} at "
            f"{place(mesh.points[nodes[worst]])} m, {projection.distance[worst]:.3g} m from them; let the first surface be the "
            "smaller one, take faces that do not touch out of it, or state a larger tolerance"
        )


def check_joints(mesh: Mesh, tables: StructureTables) -> None:
    """Raise MeshError where a face belongs to a tie and to a joint."""
    if not tables.ties:
        return
    for joint in tables.joints:
        for group in joint.groups:
            keys = face_keys(outward_faces(mesh, group))
            for tie in tables.ties:
                for tied in tie.surfaces:
                    both = keys & face_keys(outward_faces(mesh, tied))
                    if both:
                        raise MeshError(
                            f"{mesh.path}: {len(both)} faces of {group!r} of joint {joint.name!r} are faces of {tied!r} of tie "
                            f"{tie.name!r}, too: what is glued cannot slip; take them out of one of the two groups"
                        )
