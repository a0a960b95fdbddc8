"""The outer surface of a mesh as triangles on corner nodes, coarsened if it has too many.  NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mesh.data import Mesh
from ..mesh.skin import groups_of_bodies, skin_of_mesh


@dataclass(frozen=True, eq=False)
class OuterTriangles:
    """Triangles of the outer surface; corners turn left seen from outside."""

    nodes: np.ndarray  # (n,) index into Mesh.points
    triangles: np.ndarray  # (m, 3) index into nodes
    body: np.ndarray  # (m,) index into names
    names: tuple[str, ...]  # groups of elements
    edges: np.ndarray  # (k, 2) sides of element faces, index into nodes; none of a coarser surface
    n_outer: int  # nodes of the surface before it was made coarser


def outer_triangles(mesh: Mesh, most: int) -> OuterTriangles:
    """Return the outer surface of a mesh with at most ``most`` nodes.  Local.

    Mid-side nodes are omitted.  A surface with more nodes is coarsened: the nodes in each cube of a grid are replaced by the one
    nearest to their middle, and triangles within a cube are removed.
    """
    outer = skin_of_mesh(mesh)
    corners, names = outer.corners, tuple(groups_of_bodies(mesh))
    is_quad = corners[:, 2] != corners[:, 3]
    triangles, body = np.concatenate([corners[:, :3], corners[is_quad][:, [0, 2, 3]]]), np.append(outer.body, outer.body[is_quad])
    sides = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    nodes, triangles = _renumbered(triangles)
    edges = np.searchsorted(nodes, np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0))
    n_outer = len(nodes)
    if n_outer > most:
        representative = _representatives(mesh.points[nodes], most)
        triangles = representative[triangles]
        is_triangle = (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)
        triangles, body = triangles[is_triangle], body[is_triangle]
        _, first = np.unique(np.column_stack([np.sort(triangles, axis=1), body]), axis=0, return_index=True)
        triangles, body, edges = triangles[np.sort(first)], body[np.sort(first)], np.zeros((0, 2), dtype=int)
        used, triangles = _renumbered(triangles)
        nodes = nodes[used]
    return OuterTriangles(nodes, triangles, body, names, edges, n_outer)


def _renumbered(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes of triangles, and the triangles on them."""
    nodes, index = np.unique(triangles, return_inverse=True)
    return nodes, index.reshape(triangles.shape)


def _representatives(points: np.ndarray, most: int) -> np.ndarray:
    """Return for each point the representative of its cube of a grid, (n,); the grid has at most ``most`` cubes with points."""
    low, size = points.min(axis=0), np.ptp(points, axis=0).max()
    fine, coarse = size / 1e4, size
    for _ in range(24):
        side = np.sqrt(fine * coarse)
        cube = np.floor((points - low) / side).astype(np.int64)
        n = len(np.unique(cube, axis=0))
        fine, coarse = (side, coarse) if n > most else (fine, side)
    cube = np.floor((points - low) / coarse).astype(np.int64)
    _, index, count = np.unique(cube, axis=0, return_inverse=True, return_counts=True)
    index = index.ravel()
    middle = np.stack([np.bincount(index, points[:, k]) for k in range(3)], axis=1) / count[:, None]
    distance = np.linalg.norm(points - middle[index], axis=1)
    order = np.lexsort((distance, index))
    first = order[np.searchsorted(index[order], np.arange(len(count)))]
    return first[index]
