"""Faces inside a body that follow a plane: the cut of a bolt whose mesh has no group for it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from .. import elements
from ..messages.errors import MeshError
from ..messages.words import place
from ..tables.structure import Surface
from .data import Mesh

_ON = 1e-9  # of the mesh's diagonal: centres of elements as near to a plane lie on it


def faces_through(mesh: Mesh, group: str, surface: Surface) -> dict[str, np.ndarray]:
    """Return the faces between elements of a group whose centres lie on different sides of a surface's plane.

    Local, rank 0.  Of several pieces, as of several shanks, the one nearest to the point of the plane counts.
    (n_faces, n_face_nodes) index into Mesh.points, by kind, as the elements below list them.

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
    assert surface.through is not None and surface.normal is not None, "a surface by a plane"
    normal = np.array(surface.normal, dtype=float)
    return np.stack([np.array(surface.through, dtype=float), normal / np.linalg.norm(normal)])


def is_below(mesh: Mesh, centre: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Return which elements, by their centres (n, 3) [m], lie below a plane (2, 3), (n,) bool; those on it do not.  Local."""
    return (centre - plane[0]) @ plane[1] < -_ON * mesh.diagonal


def _faces(mesh: Mesh, group: str, plane: np.ndarray):
    """Return kind, nodes, three lowest corners, (n, 3), and whether its element lies below, (n,), of all faces of elements.

    Of those alone that reach to both sides of the plane or touch it, by an element's size.
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
    """Return which of some faces, (n, 3) corners, belong to the connected piece nearest to a point, (n,) bool."""
    used, index = np.unique(corners, return_inverse=True)
    index = index.reshape(corners.shape)
    pattern = sp.coo_matrix((np.ones(2 * len(index)), (np.repeat(index[:, 0], 2), index[:, 1:].ravel())), (len(used),) * 2)
    piece = connected_components(pattern, directed=False)[1][index[:, 0]]
    centres = [np.linalg.norm(mesh.points[corners[piece == i]].mean(axis=(0, 1)) - point) for i in range(piece.max() + 1)]
    return piece == int(np.argmin(centres)) if len(centres) > 1 else np.ones(len(corners), dtype=bool)
