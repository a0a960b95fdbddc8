"""Projection of points onto the facets of a surface: nearest facet, foot, and weights of its nodes there.

All kinds of faces, straight or curved.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial import cKDTree

from ..elements import FACE_KINDS, nearest_on_faces
from .near import pairs_within, trees_by_size

SNAP = 1e-10  # weights this close to 0 or 1 are 0 or 1
_CHUNK = 20_000  # points per search
_ROUNDING = 1e-12  # of the surface's size: distance below which feet are equal


@dataclass(frozen=True)
class Projection:
    """The nearest point (foot) of a surface to each of n points, and the interpolation of its face there."""

    kind: np.ndarray  # (n,) str, kind of the face
    face: np.ndarray  # (n,) row of the face among those of its kind
    xi: np.ndarray  # (n, 2) reference coordinates of the foot in its face
    nodes: np.ndarray  # (n, k) nodes of the face, k for the largest kind; padded with the first node
    weights: np.ndarray  # (n, k) shape functions at the foot, with sum 1; 0 for padding
    foot: np.ndarray  # (n, 3) m
    normals: np.ndarray  # (n, 3) of the face at the foot, unit, outward if the faces are; 0 without a tangent plane
    distance: np.ndarray  # (n,) m, from the point to its foot
    gap: np.ndarray  # (n,) m, its component along the normal, positive on the side of the normal
    beyond: np.ndarray  # (n,) m, its component across the normal: distance of the point beyond an edge

    def of(self, rows: np.ndarray) -> Projection:
        """Return the projection of chunk of the points.  Local."""
        return Projection(*(getattr(self, column.name)[rows] for column in fields(self)))


@dataclass(frozen=True)
class _Facets:
    """All faces of a surface with consecutive numbers, kind after kind, and their bounding boxes."""

    points: np.ndarray  # (n_points, 3) m
    kinds: tuple[str, ...]
    faces: tuple[np.ndarray, ...]  # by kind, (n_faces, n_face_nodes)
    first: np.ndarray  # (n_kinds + 1,) number of the first face of each kind
    low: np.ndarray  # (n_facets, 3) m, corners of bounding boxes
    high: np.ndarray
    size: float  # m, of the whole surface

    @property
    def n(self) -> int:
        return int(self.first[-1])

    def feet(self, facet: np.ndarray, queries: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return xi (m, 2), foot (m, 3) and distance (m,) of each point on its facet."""
        xi, foot = np.zeros((len(facet), 2)), np.zeros((len(facet), 3))
        for kind, faces, start, end in zip(self.kinds, self.faces, self.first[:-1], self.first[1:], strict=True):
            rows = np.flatnonzero((facet >= start) & (facet < end))
            if len(rows):
                corners = self.points[faces[facet[rows] - start]]
                xi[rows] = nearest_on_faces(kind, corners, queries[rows])[0]
                foot[rows] = np.einsum("fa,fai->fi", FACE_KINDS[kind].values(xi[rows]), corners)
        return xi, foot, np.linalg.norm(foot - queries, axis=1)


def project_on_surface(points: np.ndarray, faces: Mapping[str, np.ndarray], queries: np.ndarray) -> Projection:
    """Return the nearest point of a surface to each of ``queries``, at any distance.

    Local.

    Parameters
    ----------
    points : (n_points, 3) nodes of the mesh [m]
    faces : by kind of face, (n_faces, n_face_nodes) index into ``points``, as from ``surface.outward_faces``; at least one
    queries : (n, 3) m

    Notes
    -----
    docs/theory.md, eq. (2.4).  Of equally near faces, as at a common edge, the first of the first kind is taken.
    """
    queries = np.asarray(queries, dtype=float).reshape(-1, 3)
    facets = _facets_of(points, faces)
    trees = trees_by_size((facets.low + facets.high) / 2.0, np.linalg.norm(facets.high - facets.low, axis=1) / 2.0)
    of_nodes = cKDTree(points[np.unique(np.concatenate([nodes.ravel() for nodes in facets.faces]))])
    facet, xi = np.zeros(len(queries), dtype=np.int64), np.zeros((len(queries), 2))
    for start in range(0, len(queries), _CHUNK):
        chunk = slice(start, start + _CHUNK)
        near = _candidates(trees, queries[chunk], of_nodes.query(queries[chunk])[0], facets)
        facet[chunk], xi[chunk] = _nearest(facets, queries[chunk], *near)
    return _described(facets, facet, xi, queries)


def _facets_of(points: np.ndarray, faces: Mapping[str, np.ndarray]) -> _Facets:
    """Return the facets with their boxes.

    A face lies in the box of its corners, widened for mid-side nodes: its surface is the surface of the corners plus the offsets
    of the mid-side nodes from the edge centres times shape functions that are positive with a sum of at most 2.
    """
    kinds = tuple(kind for kind in FACE_KINDS if len(faces.get(kind, ())))
    low, high = [], []
    for kind in kinds:
        n = FACE_KINDS[kind].n_corners
        corners, middles = points[faces[kind][:, :n]], points[faces[kind][:, n:]]
        bulge = np.zeros((len(corners), 3))
        if middles.shape[1]:
            bulge = 2.0 * np.abs(middles - (corners + np.roll(corners, -1, axis=1)) / 2.0).max(axis=1)
        low.append(corners.min(axis=1) - bulge)
        high.append(corners.max(axis=1) + bulge)
    first = np.cumsum([0] + [len(faces[kind]) for kind in kinds])
    low, high = np.concatenate(low), np.concatenate(high)
    size = float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    return _Facets(points, kinds, tuple(np.asarray(faces[kind]) for kind in kinds), first, low, high, size)


def _candidates(trees, queries: np.ndarray, reach: np.ndarray, facets: _Facets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return candidate pairs (point, facet) and their least possible distance, sorted by point and this distance.

    ``reach`` (n,): an upper bound of the distance to the surface, so that no nearest facet is missed.
    """
    at, on = pairs_within(trees, queries, reach + _ROUNDING * facets.size)
    outside = np.maximum(np.maximum(facets.low[on] - queries[at], queries[at] - facets.high[on]), 0.0)
    least = np.linalg.norm(outside, axis=1)
    candidates = least <= reach[at] + _ROUNDING * facets.size
    at, on, least = at[candidates], on[candidates], least[candidates]
    order = np.lexsort((on, least, at))
    return at[order], on[order], least[order]


def _nearest(facets: _Facets, queries: np.ndarray, at: np.ndarray, on: np.ndarray, least: np.ndarray):
    """Return the nearest facet of each point and xi of the foot, from the first candidate and all that may be nearer."""
    is_first = np.r_[True, at[1:] != at[:-1]]
    xi, foot, distance = np.zeros((len(at), 2)), np.zeros((len(at), 3)), np.full(len(at), np.inf)
    xi[is_first], foot[is_first], distance[is_first] = facets.feet(on[is_first], queries[at[is_first]])
    rest = ~is_first & (least <= distance[is_first][at] + _ROUNDING * facets.size)
    xi[rest], foot[rest], distance[rest] = facets.feet(on[rest], queries[at[rest]])
    best = np.lexsort((distance, at))[is_first]
    same = np.flatnonzero(np.linalg.norm(foot - foot[best][at], axis=1) <= _ROUNDING * facets.size)
    same = same[np.isfinite(distance[same])]
    chosen = same[np.lexsort((on[same], at[same]))]
    chosen = chosen[np.r_[True, at[chosen][1:] != at[chosen][:-1]]]
    return on[chosen], xi[chosen]


def _described(facets: _Facets, facet: np.ndarray, xi: np.ndarray, queries: np.ndarray) -> Projection:
    """Return the projection with the feet ``xi`` on the facets."""
    n, k = len(facet), max(corners.shape[1] for corners in facets.faces)
    facet_index = np.searchsorted(facets.first, facet, side="right") - 1
    face = facet - facets.first[facet_index]
    nodes, weights, normals = np.zeros((n, k), dtype=np.int64), np.zeros((n, k)), np.zeros((n, 3))
    for i, (kind, faces) in enumerate(zip(facets.kinds, facets.faces, strict=True)):
        rows, m = np.flatnonzero(facet_index == i), faces.shape[1]
        corners = faces[face[rows]]
        nodes[rows, :m], nodes[rows, m:] = corners, corners[:, :1]
        weights[rows, :m] = snapped(FACE_KINDS[kind].values(xi[rows]))
        t1, t2 = np.einsum("fra,fai->rfi", FACE_KINDS[kind].derivatives(xi[rows]), facets.points[corners])
        normals[rows] = np.cross(t1, t2)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0)
    foot = np.einsum("fa,fai->fi", weights, facets.points[nodes])
    away = queries - foot
    gap = np.einsum("fi,fi->f", away, normals)
    beyond = np.linalg.norm(away - gap[:, None] * normals, axis=1)
    kinds = np.array(facets.kinds)[facet_index]
    return Projection(kinds, face, xi, nodes, weights, foot, normals, np.linalg.norm(away, axis=1), gap, beyond)


def snapped(weights: np.ndarray) -> np.ndarray:
    """Return weights (n, k) rounded to 0 or 1 if close, with row sums of 1.  Local."""
    near = np.round(weights)
    weights = np.where(np.abs(weights - near) < SNAP, near, weights)
    largest = np.argmax(np.abs(weights), axis=1)
    weights[np.arange(len(weights)), largest] += 1.0 - weights.sum(axis=1)
    return weights
