"""The nearest point of a face, straight or curved, to a point in space."""

import numpy as np

from .kinds import FACE_KINDS, Kind

_MOST_STEPS = 50  # of Newton's method; few take more than six
_CONVERGED = 1e-13  # a step in reference coordinates
_SMALL = 1e-6  # a step whose effect on the distance may be lost in rounding
_BEYOND = 0.3  # distance outside the face that Newton's method may reach, in reference coordinates
_ROUNDING = 1e-12  # outside the face by less is inside


def nearest_on_faces(kind: str, points: np.ndarray, queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest point of each face to its query point.

    Local.

    Parameters
    ----------
    kind : a key of ``FACE_KINDS``
    points : (n_faces, n, 3) nodes of each face [m]
    queries : (n_faces, 3) query points, one a face [m]

    Returns
    -------
    xi : (n_faces, 2) reference coordinates of the foot, in the face or on its edge
    distance : (n_faces,) m

    Notes
    -----
    docs/theory.md, eq. (2.4), by Newton's method from the nearest of a few points of the face: inside the face and, where
    that ends outside, along each of its edges between their ends.  Faces so curved that they come near a point twice may give
    the second nearest foot.
    """
    face = FACE_KINDS[kind]
    starts = _starts(face)
    xi = _descend(face, points, queries, starts, np.eye(2), _box(face))
    outside = np.flatnonzero(~_is_inside(face, xi))
    xi = _clipped(face, xi)
    distance = _distance(face, points, queries, xi)
    if len(outside):
        xi[outside], distance[outside] = _on_edges(face, points[outside], queries[outside], xi[outside], distance[outside])
    return xi, distance


def _on_edges(face: Kind, points, queries, best, least) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest of ``best`` and the feet on the edges, (n, 2), and its distance, (n,)."""
    corners = face.nodes[: face.n_corners]
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        starts = begin + np.array([[0.0], [0.5], [1.0]]) * (end - begin)
        box = np.minimum(begin, end), np.maximum(begin, end)
        along = np.clip(_descend(face, points, queries, starts, (end - begin)[:, None], box), *box)
        distance = _distance(face, points, queries, along)
        nearer = distance < least
        best, least = np.where(nearer[:, None], along, best), np.where(nearer, distance, least)
    return best, least


def _descend(face: Kind, points, queries, starts, directions, box) -> np.ndarray:
    """Return the xi (n, 2) of least |x(xi) - query|^2 / 2 along ``directions`` (2, m), from the best of ``starts``.

    Newton's method, or Gauss-Newton where the second derivative is not positive definite; steps that increase the distance are
    halved. xi stays within ``box``.
    """
    away = np.einsum("sa,fai->fsi", face.values(starts), points) - queries[:, None]
    xi = starts[np.argmin(np.einsum("fsi,fsi->fs", away, away), axis=1)].copy()
    live = np.arange(len(xi))
    for _ in range(_MOST_STEPS):
        if not len(live):
            break
        before, nodes, targets = xi[live], points[live], queries[live]
        step = _newton_step(face, nodes, targets, before, directions)
        after = _downhill(face, nodes, targets, before, step, box)
        xi[live] = after
        live = live[np.abs(after - before).max(axis=1) > _CONVERGED]
    return xi


def _newton_step(face: Kind, points, queries, xi, directions) -> np.ndarray:
    """Return the step (n, 2) of Newton's method, in the span of ``directions``."""
    away = np.einsum("fa,fai->fi", face.values(xi), points) - queries
    tangents = np.einsum("fra,fai->fri", face.derivatives(xi), points)
    slope = np.einsum("fri,fi->fr", tangents, away) @ directions
    gauss = directions.T @ np.einsum("fri,fsi->frs", tangents, tangents) @ directions
    bend = np.einsum("frsa,fai,fi->frs", face.second_derivatives(xi), points, away, optimize=True)
    full = gauss + directions.T @ bend @ directions
    size = np.trace(gauss, axis1=1, axis2=2)
    size = np.where(size > 0.0, size, 1.0)[:, None, None] * np.eye(directions.shape[1])
    is_minimum = np.linalg.eigvalsh(full)[:, 0] > 1e-6 * size[:, 0, 0]
    matrix = np.where(is_minimum[:, None, None], full, gauss + 1e-12 * size)
    return -np.linalg.solve(matrix, slope[:, :, None])[:, :, 0] @ directions.T


def _downhill(face: Kind, points, queries, xi, step, box) -> np.ndarray:
    """Return xi + step within ``box``, the step halved where the distance would grow; xi itself where no step helps."""
    moved = np.clip(xi + step, *box)
    large = np.flatnonzero(np.abs(moved - xi).max(axis=1) > _SMALL)
    now = _distance(face, points[large], queries[large], xi[large])
    for halvings in range(9):
        uphill = _distance(face, points[large], queries[large], moved[large]) > now
        large, now = large[uphill], now[uphill]
        if not len(large):
            break
        moved[large] = xi[large] if halvings == 8 else np.clip(xi[large] + 0.5 ** (halvings + 1) * step[large], *box)
    return moved


def _distance(face: Kind, points, queries, xi) -> np.ndarray:
    return np.linalg.norm(np.einsum("fa,fai->fi", face.values(xi), points) - queries, axis=1)


def _starts(face: Kind) -> np.ndarray:
    """Return points of the reference face from which a search starts: corners, middles of edges, the centre."""
    corners = face.nodes[: face.n_corners]
    return np.concatenate([corners, (corners + np.roll(corners, -1, axis=0)) / 2.0, corners.mean(axis=0)[None]])


def _box(face: Kind) -> tuple[np.ndarray, np.ndarray]:
    return face.nodes.min(axis=0) - _BEYOND, face.nodes.max(axis=0) + _BEYOND


def _is_inside(face: Kind, xi: np.ndarray) -> np.ndarray:
    if face.n_corners == 4:
        return np.abs(xi).max(axis=1) <= 1.0 + _ROUNDING
    return (xi.min(axis=1) >= -_ROUNDING) & (xi.sum(axis=1) <= 1.0 + _ROUNDING)


def _clipped(face: Kind, xi: np.ndarray) -> np.ndarray:
    """Return xi moved into the reference face."""
    if face.n_corners == 4:
        return np.clip(xi, -1.0, 1.0)
    xi = np.maximum(xi, 0.0)
    return xi / np.maximum(xi.sum(axis=1), 1.0)[:, None]
