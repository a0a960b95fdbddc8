"""The cells of a surface, each in its plane: contact points of non-matching meshes, or on rigid ground."""

from dataclasses import dataclass

import numpy as np

from .. import elements
from .data import Mesh

_ARCS = 6  # pieces of a curved edge of a cell


@dataclass(frozen=True, eq=False)
class Cells:
    """The n cells of faces of one kind, each in its plane."""

    kind: str
    faces: np.ndarray  # (n, n_face_nodes) nodes of the face of each cell
    corners: np.ndarray  # (n, 4, 3) m
    outline: np.ndarray  # (n, k, 3) m, curved edges in pieces
    centre: np.ndarray  # (n, 3) m
    axes: np.ndarray  # (n, 3, 3) rows x, y in the plane, z out of the body
    area: np.ndarray  # (n,) m2, of the curved surface

    @property
    def radius(self) -> np.ndarray:
        """The largest distance of a corner of each cell from its centre, (n,) [m]."""
        return np.linalg.norm(self.corners - self.centre[:, None], axis=2).max(axis=1)

    def in_plane(self, i: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return points (m, k, 3) in the axes of cells ``i`` (m,), the same shape [m]."""
        return (points - self.centre[i][:, None]) @ self.axes[i].transpose(0, 2, 1)


def cells_of(mesh: Mesh, kind: str, faces: np.ndarray) -> Cells:
    """Return the cells of some faces, face by face.  Local."""
    xi = elements.CELLS[kind]
    points = mesh.points[faces]
    N = elements.FACE_KINDS[kind].values(xi.reshape(-1, 2)).reshape(*xi.shape[:2], -1)
    corners = np.einsum("cka,fai->fcki", N, points).reshape(-1, 4, 3)
    area = np.stack([elements.part_integrals(kind, points, corner).sum(axis=1) for corner in xi], axis=1).ravel()
    x, z = corners[:, 1] - corners[:, 3], np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x -= np.einsum("pi,pi->p", x, z)[:, None] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    axes = np.stack([x, np.cross(z, x), z], axis=1)
    outline = np.stack([outlines(kind, points, corner, _ARCS) for corner in xi], axis=1).reshape(len(corners), -1, 3)
    return Cells(kind, np.repeat(faces, len(xi), axis=0), corners, outline, corners.mean(axis=1), axes, area)


def outlines(kind: str, points: np.ndarray, corners: np.ndarray, n_pieces: int) -> np.ndarray:
    """Return the outline of a polygon in the coordinates of faces, (n_faces, k, 3) [m], curved edges in pieces.  Local.

    ``points`` (n_faces, n_face_nodes, 3) m; ``corners`` (n_corners, 2) in order.
    """
    shape = elements.FACE_KINDS[kind]
    pieces = n_pieces if len(shape.nodes) > shape.n_corners else 1
    share = np.arange(pieces)[:, None] / pieces
    edges = np.roll(corners, -1, axis=0) - corners
    return shape.values((corners[:, None] + share * edges[:, None]).reshape(-1, 2)) @ points


def face_of(cells: list[Cells]) -> np.ndarray:
    """Return the number of the face of each cell, (n,).  Local."""
    n_cells = [np.full(len(of_kind.area) // n, n) for of_kind in cells for n in [len(elements.CELLS[of_kind.kind])]]
    return np.repeat(np.arange(sum(map(len, n_cells))), np.concatenate(n_cells))
