"""The six rigid-body motions of a structure that nothing supports, on each rank's rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..parallel.ownership import summed

if TYPE_CHECKING:
    from ..mesh.data import DistributedMesh
    from .constraints import Constraints


def rigid_motions(dmesh: DistributedMesh, constraints: Constraints | None) -> np.ndarray:
    """Return three unit translations and three unit rotations about the middle of the nodes, (n_dof_owned, 6).

    Collective on ``dmesh.comm``: one sum.  The structure has no supports.  phi^T f are force [N] and moment [N m] of loads f.
    """
    comm = dmesh.comm
    first, last = dmesh.node_ranges[comm.rank :][:2]
    own = np.zeros((last - first, 3))
    for block in dmesh.blocks:
        is_own = (block.nodes >= first) & (block.nodes < last)
        own[block.nodes[is_own] - first] = block.points[is_own]
    middle = summed(comm, own.sum(axis=0)) / dmesh.node_ranges[-1]
    arms = own - middle
    if constraints is None:
        return np.asfortranarray(_motions(arms).reshape(-1, 6))
    row_start, row_end = constraints.row_ranges[comm.rank :][:2]
    motions = np.zeros((row_end - row_start, 6), order="F")
    n_places = len(dmesh.rank_order)
    rows = constraints.free[:n_places][np.argsort(dmesh.rank_order)[first:last]]
    _put(motions, rows - row_start, _motions(arms))
    for i, point in enumerate(constraints.points):
        moves, turns = constraints.free[n_places + 2 * i : n_places + 2 * i + 2] - row_start
        _put(motions, moves, _motions(np.array(point.position) - middle))
        _put(motions, turns, np.hstack([np.zeros((3, 3)), np.eye(3)]))
    return motions


def _motions(arms: np.ndarray) -> np.ndarray:
    """Return the motions at places (..., 3) about the middle, (..., 3, 6)."""
    shape = arms.shape[:-1]
    rotations = np.cross(np.eye(3), arms[..., None, :])  # (..., 3 rotations, 3)
    return np.concatenate([np.broadcast_to(np.eye(3), (*shape, 3, 3)), rotations.swapaxes(-1, -2)], axis=-1)


def _put(motions: np.ndarray, rows: np.ndarray, values: np.ndarray) -> None:
    """Put values (..., 6) at rows (...) of this rank; others are dependent, or of another rank."""
    is_here = (rows >= 0) & (rows < len(motions))
    motions[rows[is_here]] = values[is_here]
