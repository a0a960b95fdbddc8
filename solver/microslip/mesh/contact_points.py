"""The contact points of two surfaces, with the weights of the nodes of each side."""

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from ..messages.errors import MeshError
from ..messages.words import counted, place
from ..tables.joint import Joint
from .data import Mesh

MOST_TILT = 20.0  # degrees between the normals of the two sides


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """The n contact points of a joint, before stiffness, friction and preload.

    Row i of ``side1`` and ``side2`` has the weights of the nodes of ``Mesh.points`` in the displacement of each body at point i;
    their sum is 1, and rigid ground has no weights.
    """

    side1: sp.csr_matrix  # (n, n_nodes)
    side2: sp.csr_matrix  # (n, n_nodes)
    z: np.ndarray  # (n, 3) unit normals, out of body 2 into body 1
    area: np.ndarray  # (n,) m2, positive
    position: np.ndarray  # (n, 3) m
    distance: np.ndarray  # (n,) m, of body 1 from body 2 along z in the mesh; negative: penetration
    faces: tuple[np.ndarray, ...] = ()  # contact faces for pictures: (n_faces, n_face_nodes) indices of points
    cells: np.ndarray = field(default_factory=lambda: np.zeros((0, 4, 3)))  # (n, 4, 3) m, for pictures without faces
    note: str = ""  # for the log

    def __post_init__(self):
        if len(self.cells) != self.n_points:
            object.__setattr__(self, "cells", np.full((self.n_points, 4, 3), np.nan))

    @property
    def n_points(self) -> int:
        """The number of contact points."""
        return len(self.area)


def heaviest(weights: sp.csr_matrix) -> np.ndarray:
    """Return the node of the largest weight of each point, (n,), the lowest for equal weights; -1: ground.  Local."""
    node = np.full(weights.shape[0], -1, dtype=np.int64)
    row = np.repeat(np.arange(weights.shape[0]), np.diff(weights.indptr))
    order = np.lexsort((weights.indices, -np.round(weights.data, 9), row))
    rows, first = np.unique(row[order], return_index=True)
    node[rows] = weights.indices[order][first]
    return node


def check_opposite(mesh: Mesh, joint: Joint, normals1: np.ndarray, normals2: np.ndarray, places: np.ndarray) -> None:
    """Raise MeshError if the outward normals (n, 3) of the two sides are not opposite."""
    cosine = -np.einsum("pi,pi->p", normals1, normals2)
    tilt = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    if len(tilt) and tilt.max() > MOST_TILT:
        where = places[np.argmax(tilt)]
        node = np.argmin(np.linalg.norm(mesh.points - where, axis=1))
        raise MeshError(
            f"{mesh.path}: joint {joint.name!r}: the sides do not face each other at "
            f"{np.count_nonzero(tilt > MOST_TILT)} of {counted(len(tilt), 'pair')}: at node {mesh.numbers[node]}, "
            f"{place(where)} m, the outward normals are {tilt.max():.0f} degrees from opposite "
            f"(bound {MOST_TILT:.0f}); do the bodies overlap, or do the two groups cover different faces?"
        )
