"""Faces inside a body along a plane: the cut of a bolt without a group in the mesh."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from .. import elements
from ..messages.errors import MeshError
from ..messages.words import place
from ..tables.structure import Surface
from .data import Mesh

_ON = 1e-9  # of the mesh's diagonal: distance below which the centre of an element lies on the plane


def faces_through(mesh: Mesh, group: str, surface: Surface) -> dict[str, np.ndarray]:
    """Return the faces between elements of a group with centres on different sides of a surface's plane.

    Local, rank 0.  Of several pieces (several shanks) the one nearest to the point of the plane is taken.
    (n_faces, n_face_nodes) index into Mesh.points, by kind, in the order of the elements below the plane.

    Raises
    ------
    MeshError : the plane leaves all elements on one side
    """
    plane = plane_of(surface)
    point, normal = plane
    kinds, faces, keys, below = _faces(mesh, group, plane)
    _, label = np.unique(keys, axis=0, return_inverse=True)
    label = label.ravel()
    n_below = np.bincount(label, below, minlength=label.max(initial=-1) + 1)
    is_cut = (np.bincount(label)[label] == 2) & (n_below[label] == 1.0) & below
    if not is_cut.any():
        raise MeshError(
            f"[[surfaces]] {surface.name!r}: no face inside {group!r} follows the plane through {place(point)} m across "
            f"{place(normal)}: all elements lie on one side"
        )
    chosen = np.flatnonzero(is_cut)
    chosen = chosen[_nearest_piece(mesh, keys[chosen], point)]
    return {kind: np.array([faces[i] for i in chosen if kinds[i] == kind]) for kind in sorted({kinds[i] for i in chosen})}


def plane_of(surface: Surface) -> np.ndarray:
    """Return a point and the unit normal of a surface's plane, (2, 3) [m, -].  Local."""
    normal = np.array(surface.normal, dtype=float)
    return np.stack([np.array(surface.through, dtype=float), normal / np.linalg.norm(normal)])


def is_below(mesh: Mesh, centre: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Return which elements with centres (n, 3) [m] lie below a plane (2, 3), (n,) bool; False on the plane.  Local."""
    return (centre - plane[0]) @ plane[1] < -_ON * mesh.diagonal


def _faces(mesh: Mesh, group: str, plane: np.ndarray):
    """Return kind, nodes, three lowest corners (n, 3), and whether the element lies below the plane (n,), for element faces.

    Only elements within one element size of the plane are considered.
    """
    kinds: list[str] = []
    faces: list[np.ndarray] = []
    keys, below = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=bool)]
    for block in mesh.elements:
        if block.group != group:
            continue
        kind = elements.KINDS[block.kind]
        corners = mesh.points[block.nodes[:, : kind.n_corners]]
        height = (corners - plane[0]) @ plane[1]
        near = np.abs(height.mean(axis=1)) <= 2.0 * np.ptp(height, axis=1)
        nodes, lies_below = block.nodes[near], is_below(mesh, corners[near].mean(axis=1), plane)
        for face_kind, local in kind.faces:
            of_elements = nodes[:, list(local)]
            kinds += [face_kind] * len(nodes)
            faces += list(of_elements)
            keys.append(np.sort(of_elements[:, : elements.FACE_KINDS[face_kind].n_corners], axis=1)[:, :3])
            below.append(lies_below)
    return kinds, faces, np.concatenate(keys), np.concatenate(below)


def _nearest_piece(mesh: Mesh, corners: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return which faces, given by (n, 3) corners, belong to the connected piece nearest to a point, (n,) bool."""
    used, index = np.unique(corners, return_inverse=True)
    index = index.reshape(corners.shape)
    pattern = sp.coo_matrix((np.ones(2 * len(index)), (np.repeat(index[:, 0], 2), index[:, 1:].ravel())), (len(used),) * 2)
    piece = connected_components(pattern, directed=False)[1][index[:, 0]]
    centres = [np.linalg.norm(mesh.points[corners[piece == i]].mean(axis=(0, 1)) - point) for i in range(piece.max() + 1)]
    return piece == int(np.argmin(centres)) if len(centres) > 1 else np.ones(len(corners), dtype=bool)
