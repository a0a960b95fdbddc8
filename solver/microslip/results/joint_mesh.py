"""The joint as a separate mesh in space: a polygon for each pair and face, or a point for each pair.  NumPy and SciPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..elements import RINGS
from .record import Joint
from .unroll import has_cell, parts_of


@dataclass(frozen=True, eq=False)
class JointMesh:
    """Polygons in model axes, with the pair that each belongs to."""

    points: np.ndarray  # (n_points, 3) m
    weights: sp.csr_matrix  # (n_points, n_pairs) maps values of pairs to those of points
    sizes: np.ndarray  # (n_cells,) corners of each polygon, which are points one after the other; 1 of a pair without area
    pair: np.ndarray  # (n_cells,) index of the pair

    @property
    def offsets(self) -> np.ndarray:
        """Where the corners of each polygon begin, and the end, (n_cells + 1,)."""
        return np.concatenate([[0], np.cumsum(self.sizes)]).astype(np.int64)


def joint_mesh(joint: Joint) -> JointMesh:
    """Return the joint as polygons, and points for pairs that have no area; those without a position are left out.  Local."""
    position = np.where(np.isfinite(joint.position), joint.position, 0.0)
    parts = [_of_faces(faces, position) for faces in joint.faces if len(faces) and faces.shape[1] in RINGS]
    with_cell = np.flatnonzero(has_cell(joint.cells))
    if len(with_cell):
        corners = joint.cells[with_cell].reshape(-1, 3)
        parts.append((corners, _rows(np.repeat(with_cell, 4), joint.n_pairs), np.full(len(with_cell), 4), with_cell))
    done = np.concatenate([np.zeros(0, dtype=int), *(pair for *_, pair in parts)])
    bare = np.setdiff1d(np.flatnonzero(np.isfinite(joint.position).all(axis=1)), done)
    parts.append((position[bare], _rows(bare, joint.n_pairs), np.ones(len(bare), dtype=int), bare))
    points, weights, sizes, pair = zip(*parts)
    return JointMesh(np.concatenate(points), sp.vstack(weights).tocsr(), np.concatenate(sizes), np.concatenate(pair))


def _of_faces(faces: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, sp.csr_matrix, np.ndarray, np.ndarray]:
    """Return points, weights, sizes and pairs of the parts of the faces of one kind."""
    n = faces.shape[1]
    ring = faces[:, list(RINGS[n])]
    shares = parts_of(np.eye(n), n in (6, 8))  # of the nodes of the ring, the same for all faces
    sizes = np.tile([len(share) for share in shares], len(faces))
    share = np.concatenate(shares)  # (corners of all parts, n)
    rows = np.repeat(np.arange(len(faces) * len(share)), n)
    columns = np.repeat(ring[:, None, :], len(share), axis=1).ravel()
    values = np.broadcast_to(share, (len(faces), *share.shape)).ravel()
    weights = sp.csr_matrix((values, (rows, columns)), (len(faces) * len(share), len(position)))
    weights.eliminate_zeros()
    return weights @ position, weights, sizes, ring.ravel()


def _rows(pairs: np.ndarray, n_pairs: int) -> sp.csr_matrix:
    """Return the weights of points that move as their pairs do."""
    return sp.csr_matrix((np.ones(len(pairs)), (np.arange(len(pairs)), pairs)), (len(pairs), n_pairs))
