"""Unconstrained rigid-body motions, on each rank's rows: six without supports, springs to ground and equations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..parallel.ownership import summed

if TYPE_CHECKING:
    from ..mesh.data import DistributedMesh, Mesh
    from ..mesh.links import Links
    from .constraints import Constraints

_PREVENTED = 1e-6  # of a rigid motion, its mean on the supported DOFs above which supports prevent it


def free_combinations(mesh: Mesh, links: Links, is_fixed: np.ndarray) -> np.ndarray:
    """Return which combinations of the six motions nothing prevents, (6, n), unit translations before all others.

    Local, rank 0.  ``is_fixed`` is (n_places, 3) bool.  Combinations with a rotation move the farthest node by about the size of
    the mesh; ties, points and equations must take part in them, and they stretch no spring.
    """
    middle = mesh.points.mean(axis=0)
    places = [_motions(mesh.points - middle)]
    for point in links.points:
        turns = np.hstack([np.zeros((3, 3)), np.eye(3)])
        places += [_motions(np.array(point.position) - middle)[None], turns[None]]
    motions = np.concatenate(places).reshape(-1, 6)
    follow = motions[links.dependent] - links.weights @ motions
    springs = np.array([point.springs for point in links.points]).reshape(-1)
    held = [motions[is_fixed.ravel()], follow, motions[3 * links.n_nodes :][springs > 0.0]]
    if links.attached is not None:
        held.append((links.attached.stretch @ motions)[links.attached.stiffness > 0.0])
    prevented = np.concatenate(held) / np.repeat([1.0, mesh.diagonal], 3)
    limit = _PREVENTED * np.sqrt(max(len(prevented), 1))
    translations = _null_space(prevented[:, :3], limit)
    free = _null_space(prevented, limit)
    n_turns = free.shape[1] - translations.shape[1]
    translations = np.vstack([translations, np.zeros_like(translations)])
    turns = np.linalg.svd(free - translations @ (translations.T @ free))[0][:, :n_turns]
    return np.hstack([translations, turns]) / np.repeat([1.0, mesh.diagonal], 3)[:, None]


def _null_space(rows: np.ndarray, limit: float) -> np.ndarray:
    """Return an orthonormal basis of the vectors that rows (m, n) map below ``limit``, (n, k); unit vectors if possible."""
    values, vectors = np.linalg.eigh(rows.T @ rows)
    basis = vectors[:, values <= limit**2]
    axes = np.flatnonzero(np.linalg.norm(basis, axis=1) > 1.0 - 1e-12)
    if len(axes) == basis.shape[1]:
        return np.eye(len(vectors))[:, axes]
    return basis


def rigid_motions(
    dmesh: DistributedMesh, constraints: Constraints | None, dof: np.ndarray | None = None, free: np.ndarray | None = None
) -> np.ndarray:
    """Return rigid-body motions of this rank's rows, (n_dof_owned, n): unit translations and unit rotations, or ``free``.

    Collective on ``dmesh.comm``: one sum.  The rotations are about the middle of the nodes, phi^T f are force [N] and
    moment [N m] of loads f.

    Parameters
    ----------
    dof : (n_nodes, 3) rows of the nodes in the order of the ranks, -1 where fixed; None: no support
    free : combinations of the six motions that supports leave free, (6, n); None: all six
    """
    motions = _six_motions(dmesh, constraints, dof)
    return motions if free is None else np.asfortranarray(motions @ free)


def _six_motions(dmesh: DistributedMesh, constraints: Constraints | None, dof: np.ndarray | None) -> np.ndarray:
    """Return the rows of all six motions, (n_dof_owned, 6).  Collective."""
    comm = dmesh.comm
    first, last = dmesh.node_ranges[comm.rank :][:2]
    owned = np.zeros((last - first, 3))
    for block in dmesh.blocks:
        is_owned = (block.nodes >= first) & (block.nodes < last)
        owned[block.nodes[is_owned] - first] = block.points[is_owned]
    middle = summed(comm, owned.sum(axis=0)) / dmesh.node_ranges[-1]
    arms = owned - middle
    if constraints is None:
        every = _motions(arms).reshape(-1, 6)
        return np.asfortranarray(every if dof is None else every[dof[first:last].ravel() >= 0])
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
