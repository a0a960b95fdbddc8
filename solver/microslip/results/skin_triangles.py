"""The outer surface of a mesh as triangles on corner nodes, made coarser where it has too many.  NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..elements import KINDS
from ..mesh.data import Mesh


@dataclass(frozen=True, eq=False)
class Skin:
    """Triangles of the outer surface; corners turn left seen from outside."""

    nodes: np.ndarray  # (n,) index into Mesh.points
    triangles: np.ndarray  # (m, 3) index into nodes
    body: np.ndarray  # (m,) index into names
    names: tuple[str, ...]  # groups of elements
    edges: np.ndarray  # (k, 2) sides of element faces, index into nodes; none of a coarser surface
    n_outer: int  # nodes of the surface before it was made coarser


def skin(mesh: Mesh, most: int) -> Skin:
    """Return the outer surface of a mesh with at most ``most`` nodes.  Local.

    Middles of sides are left out.  A surface of more nodes is made coarser: the nodes in each cube of a grid become the one
    nearest to their middle, and triangles within a cube go.
    """
    names = tuple(dict.fromkeys(block.group for block in mesh.elements))
    triangles, edges, body = _outer(mesh, names)
    nodes, triangles = _renumbered(triangles)
    edges = np.searchsorted(nodes, edges)
    n_outer = len(nodes)
    if n_outer > most:
        kept = _clustered(mesh.points[nodes], most)
        triangles = kept[triangles]
        whole = (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)
        triangles, body = triangles[whole], body[whole]
        _, first = np.unique(np.column_stack([np.sort(triangles, axis=1), body]), axis=0, return_index=True)
        triangles, body, edges = triangles[np.sort(first)], body[np.sort(first)], np.zeros((0, 2), dtype=int)
        used, triangles = _renumbered(triangles)
        nodes = nodes[used]
    return Skin(nodes, triangles, body, names, edges, n_outer)


def _outer(mesh: Mesh, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return triangles, sides and bodies of the faces that one element alone has; nodes are those of the mesh."""
    found: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {3: [], 4: []}
    for block in mesh.elements:
        for face, local in KINDS[block.kind].faces:
            n = 3 if face.startswith("tri") else 4
            found[n].append((block.nodes[:, list(local[:n])], np.full(len(block.nodes), names.index(block.group))))
    triangles, edges, body = [np.zeros((0, 3), dtype=int)], [np.zeros((0, 2), dtype=int)], [np.zeros(0, dtype=int)]
    for n, parts in found.items():
        if not parts:
            continue
        faces, own = (np.concatenate(column) for column in zip(*parts))
        _, index, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
        is_outer = count[index.ravel()] == 1
        faces, own = faces[is_outer], own[is_outer]
        for k in range(1, n - 1):
            triangles.append(faces[:, [0, k, k + 1]])
            body.append(own)
        edges += [np.sort(faces[:, [k, (k + 1) % n]], axis=1) for k in range(n)]
    return np.concatenate(triangles), np.unique(np.concatenate(edges), axis=0), np.concatenate(body)


def _renumbered(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes of triangles, and the triangles on them."""
    nodes, index = np.unique(triangles, return_inverse=True)
    return nodes, index.reshape(triangles.shape)


def _clustered(points: np.ndarray, most: int) -> np.ndarray:
    """Return for each point the one that stands for its cube of a grid, (n,); the grid has at most ``most`` cubes with points."""
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
