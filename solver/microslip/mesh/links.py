"""What follows what in the whole mesh: ties and points together, chains of them resolved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..parallel.errors import MeshError
from ..parallel.words import place
from .data import Mesh
from .locate import find_node
from .points import of_distributing, of_rigid
from .settings import MeshSettings, Point
from .ties import Follower, check_joints, of_tie


@dataclass(frozen=True, eq=False)
class Links:
    """Degrees of freedom that follow others: u[dependent] = weights u, the others independent.  docs/theory.md, eq. (2.5)."""

    dependent: np.ndarray  # (m,) rising
    weights: sp.csr_matrix  # (m, n_dof) of independent ones alone
    points: tuple[Point, ...]
    n_nodes: int
    joined: tuple[np.ndarray, ...]  # (2, n) nodes that hang together, for each tie and point
    notes: tuple[str, ...]  # what was tied, for the log

    @property
    def n_places(self) -> int:
        return self.n_nodes + 2 * len(self.points)

    def place_of(self, name: str, turns: bool = False) -> int:
        """Return the place of a point's displacement, or of its rotation."""
        return self.n_nodes + 2 * [point.name for point in self.points].index(name) + turns

    def node_of(self, name: str) -> int:
        """Return a node of the group that a point is connected to."""
        i = [point.name for point in self.points].index(name)
        return int(self.joined[len(self.joined) - len(self.points) + i][0, 0])

    @property
    def grounded(self) -> np.ndarray:
        """A node of the group of each point that springs hold, (n,)."""
        return np.array([self.node_of(point.name) for point in self.points if point.is_sprung], dtype=np.int64)


def find_links(mesh: Mesh, settings: MeshSettings) -> Links:
    """Return what the ties and points of a scene make follow.  Local, rank 0.

    Raises
    ------
    MeshError : nodes too far from the facets, what follows two things or itself, groups that cannot turn, joints on tied faces
    """
    n_places = len(mesh.points) + 2 * len(settings.points)
    if not settings.ties and not settings.points:
        return Links(np.zeros(0, dtype=np.int64), sp.csr_matrix((0, 3 * n_places)), (), len(mesh.points), (), ())
    check_joints(mesh, settings)
    followers = [of_tie(mesh, tie, n_places) for tie in settings.ties]
    for i, point in enumerate(settings.points):
        followers.append((of_rigid if point.rigid else of_distributing)(mesh, point, len(mesh.points) + 2 * i, n_places))
    _check_once(mesh, followers)
    dependent = np.concatenate([one.dependent for one in followers])
    weights = sp.vstack([one.weights for one in followers]).tocsr()
    order = np.argsort(dependent)
    weights = _independent(mesh, followers, dependent[order], weights[order])
    joined, notes = tuple(one.joined for one in followers), tuple(one.note for one in followers)
    return Links(dependent[order], weights, settings.points, len(mesh.points), joined, notes)


def places_of(mesh: Mesh, links: Links | None, entry, where: str) -> np.ndarray:
    """Return the nodes, or the place of the point, that a support, a load or an output names, (n,).  Local, rank 0.

    Raises
    ------
    MeshError, CaseError : no such node
    """
    if entry.point is not None:
        assert links is not None, "a scene with points"
        turns = getattr(entry, "moment", None) or getattr(entry, "rotation", None)
        return np.array([links.place_of(entry.point, turns=turns is not None)])
    keys = ("position", "node", "group")
    return find_node(mesh, **{key: getattr(entry, key, None) for key in keys}, where=where)


def _check_once(mesh: Mesh, followers: Sequence[Follower]) -> None:
    """Raise MeshError where a node follows two things."""
    first = np.full(len(mesh.points), -1)
    for i, one in enumerate(followers):
        own = np.unique(one.dependent // 3)
        own = own[own < len(mesh.points)]
        twice = own[first[own] >= 0]
        if len(twice):
            raise MeshError(
                f"{mesh.path}: {len(twice)} nodes follow two things, {followers[first[twice[0]]].what} and {one.what}; the first "
                f"is node {mesh.numbers[twice[0]]} at {place(mesh.points[twice[0]])} m; swap the surfaces of a tie so that its "
                "other side follows, or take these nodes out of one group"
            )
        first[own] = i


def _independent(mesh: Mesh, followers: Sequence[Follower], dependent: np.ndarray, weights: sp.csr_matrix) -> sp.csr_matrix:
    """Return the weights with dependent ones among them replaced by what those follow.

    Raises
    ------
    MeshError : a node follows itself in the end
    """
    inner = weights[:, dependent]
    _, ring = connected_components(inner, directed=True, connection="strong")
    round_and_round = np.flatnonzero((np.bincount(ring)[ring] > 1) | (inner.diagonal() != 0.0))
    if len(round_and_round):
        node = dependent[round_and_round[0]] // 3
        whats = dict.fromkeys(one.what for one in followers if np.isin(dependent[round_and_round], one.dependent).any())
        raise MeshError(
            f"{mesh.path}: {' and '.join(whats)} follow each other in a ring, at node {mesh.numbers[node]} "
            f"{place(mesh.points[node])} m among others; leave one of them out, or swap its surfaces"
        )
    n_dof, m = weights.shape[1], len(dependent)
    stays = np.ones(n_dof)
    stays[dependent] = 0.0
    onward = sp.diags(stays) + sp.csr_matrix((np.ones(m), (dependent, np.arange(m))), (n_dof, m)) @ weights
    while weights[:, dependent].nnz:
        weights = weights @ onward
        weights.eliminate_zeros()
    return weights
