"""Point masses, springs and dampers on nodes; DOFs are numbered by places as in ``ties``."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..messages.errors import MeshError
from ..messages.words import counted, place
from ..parallel.ownership import rows_of
from ..tables.structure import Spring
from ..tables.structure_tables import StructureTables
from .data import Mesh


@dataclass(frozen=True, eq=False)
class Attached:
    """Point masses, springs and dampers of a structure, eq. (2.10); ``n_dof`` is three times the number of places."""

    points: np.ndarray  # (n_masses, 3) m
    mass: np.ndarray  # (n_masses,) kg
    motion: sp.csr_matrix  # (3 n_masses, n_dof): displacements of the masses
    stretch: sp.csr_matrix  # (n_springs, n_dof): elongation of each spring
    stiffness: np.ndarray  # (n_springs,) N/m
    damping: np.ndarray  # (n_springs,) N s/m

    @property
    def M(self) -> sp.csr_matrix:
        """Contribution of the masses to M, (n_dof, n_dof) [kg]."""
        return (self.motion.T @ sp.diags(np.repeat(self.mass, 3)) @ self.motion).tocsr()

    @property
    def K(self) -> sp.csr_matrix:
        """Contribution of the springs to K, (n_dof, n_dof) [N/m]."""
        return (self.stretch.T @ sp.diags(self.stiffness) @ self.stretch).tocsr()

    @property
    def C(self) -> sp.csr_matrix | None:
        """Damping matrix C of the dampers, (n_dof, n_dof) [N s/m]; None without dampers."""
        return (self.stretch.T @ sp.diags(self.damping) @ self.stretch).tocsr() if self.damping.any() else None

    def forces(self, acceleration: np.ndarray) -> np.ndarray:
        """Return mass times ``acceleration`` (n_masses, 3) [m/s2] on the places, (n_places, 3) [N]."""
        return (self.motion.T @ (self.mass[:, None] * acceleration).ravel()).reshape(-1, 3)

    def weighted(self, A: np.ndarray) -> sp.csr_matrix:
        """Return the sum of mass times A (3, 3) over the masses, (n_dof, n_dof): of their spin and Coriolis forces."""
        return (self.motion.T @ sp.kron(sp.diags(self.mass), A) @ self.motion).tocsr()

    def holding(self, translations: np.ndarray) -> np.ndarray:
        """Return the degrees of freedom of springs that a motion (n_dof, 3) of the whole structure stretches, (n,)."""
        is_stretched = (abs(self.stretch @ translations).max(axis=1, initial=0.0) > 1e-6) & (self.stiffness > 0.0)
        return np.unique(self.stretch[np.flatnonzero(is_stretched)].indices)

    @property
    def joined(self) -> np.ndarray:
        """The degrees of freedom that each spring connects, (2, n)."""
        stretch = self.stretch[np.flatnonzero(self.stiffness > 0.0)]
        counts = np.diff(stretch.indptr)
        first = stretch.indices[stretch.indptr[:-1][counts > 0]]
        return np.stack([np.repeat(first, counts[counts > 0]), stretch.indices])


def attach(mesh: Mesh, tables: StructureTables, n_places: int, outside: sp.csr_matrix, loose: np.ndarray) -> Attached:
    """Return the masses, springs and dampers of a scene, docs/theory.md, eq. (2.10).  Local, rank 0.

    ``outside`` (3 n_outside, 3 n_places) are the dependences of nodes outside the elements; ``loose`` (3 n_outside,) bool marks
    their degrees of freedom that follow nothing and are not supported.

    Raises
    ------
    MeshError : a spring between groups of several nodes, or between coincident nodes without a direction; a mass or a spring on
        a loose degree of freedom
    """
    motion = sp.vstack([sp.identity(3 * n_places, format="csr"), outside]).tocsr()
    is_loose = np.concatenate([np.zeros(3 * n_places, dtype=bool), loose])
    place_of = {point.name: len(mesh.points) + 2 * i for i, point in enumerate(tables.points)}
    masses = [
        (_nodes(mesh, entry.group, n_places) if entry.point is None else np.array([place_of[entry.point]]), entry.mass)
        for entry in tables.masses
    ]
    nodes = np.concatenate([np.zeros(0, dtype=np.int64), *(of_mass for of_mass, _ in masses)])
    position = _positions(mesh, tables)
    springs = [_ends(mesh, spring, i, n_places, place_of, position) for i, spring in enumerate(tables.springs, 1)]
    ends = np.concatenate([np.zeros((0, 2), dtype=np.int64), *(of_spring for of_spring, _ in springs)])
    along = np.concatenate([np.zeros((0, 3)), *(direction for _, direction in springs)])
    for what, at, used in (
        ("[[masses]]", nodes, np.ones((len(nodes), 3))),
        ("[[springs]]", ends[:, 0], along),
        ("[[springs]]", ends[:, 1], along),
    ):
        _check_held(mesh, what, at, used, is_loose, n_places)
    return Attached(
        position[nodes],
        np.concatenate([np.zeros(0), *(np.full(len(of_mass), mass) for of_mass, mass in masses)]),
        motion[rows_of(nodes)],
        (_along(ends[:, 0], along, motion) - _along(ends[:, 1], along, motion)).tocsr(),
        *(_of_each(springs, [getattr(entry, key) for entry in tables.springs]) for key in ("stiffness", "damping")),
    )


def _of_each(springs: list[tuple[np.ndarray, np.ndarray]], values: list[float]) -> np.ndarray:
    """Return the values of the tables, repeated for each of their springs, (n_springs,)."""
    return np.concatenate([np.zeros(0), *(np.full(len(ends), value) for (ends, _), value in zip(springs, values, strict=True))])


def _check_held(mesh: Mesh, what: str, nodes: np.ndarray, used: np.ndarray, is_loose: np.ndarray, n_places: int) -> None:
    """Raise MeshError for nodes outside the elements that a mass or spring moves in a free direction."""
    at = 3 * nodes[:, None] + np.arange(3)
    wrong = (nodes[:, None] >= 0) & (used != 0.0) & is_loose[at]
    if wrong.any():
        node = nodes[wrong.any(axis=1)][0] - n_places
        raise MeshError(
            f"{mesh.path}: {what}: node {mesh.outside.numbers[node]} at {place(mesh.outside.points[node])} m belongs to no "
            "element of a body and is free to move; support it, or connect it by equations"
        )


def _nodes(mesh: Mesh, group: str | None, n_places: int) -> np.ndarray:
    """Return the places of a group's nodes; nodes outside the elements come last."""
    assert group is not None, "a group in place of a point"
    outside = mesh.outside.groups.get(group, np.zeros(0, dtype=np.int64))
    return np.concatenate([mesh.node_groups.get(group, np.zeros(0, dtype=np.int64)), n_places + outside])


def _positions(mesh: Mesh, tables: StructureTables) -> np.ndarray:
    """Return the positions of the places, then of the nodes outside the elements, (n, 3) [m]; a point has two places."""
    points = np.array([point.position for point in tables.points], dtype=float).reshape(-1, 3)
    return np.concatenate([mesh.points, np.repeat(points, 2, axis=0), mesh.outside.points])


def _ends(
    mesh: Mesh, spring: Spring, number: int, n_places: int, place_of: Mapping[str, int], position: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends of each spring, (n, 2), the second -1 on ground, and the directions, (n, 3)."""
    where = f"{mesh.path}: [[springs]] {number}"
    of_groups = [_nodes(mesh, group, n_places) for group in spring.groups]
    first, *other = of_groups + [np.array([place_of[name]]) for name in spring.points]
    if other:
        for group, nodes in zip(spring.groups, of_groups):
            if len(nodes) != 1:
                raise MeshError(f"{where} groups: {group!r} holds {counted(len(nodes), 'node')}; a spring has one at each end")
    ends = np.stack([first, other[0] if other else np.full(len(first), -1)], axis=1)
    if spring.direction is not None:
        direction = np.asarray(spring.direction, dtype=float)
    else:
        direction = position[ends[0, 0]] - position[ends[0, 1]]
        if not np.linalg.norm(direction) > 1e-12 * mesh.diagonal:
            raise MeshError(f"{where}: its two nodes lie on each other, at {place(position[first[0]])} m; state direction")
    return ends, np.tile(direction / np.linalg.norm(direction), (len(ends), 1))


def _along(nodes: np.ndarray, directions: np.ndarray, motion: sp.csr_matrix) -> sp.csr_matrix:
    """Return the displacements of nodes along directions, (n, n_dof); 0 on ground, node -1."""
    at_node = np.flatnonzero(nodes >= 0)
    rows, columns = np.repeat(at_node, 3), rows_of(nodes[at_node])
    pick = sp.csr_matrix((directions[at_node].ravel(), (rows, columns)), (len(nodes), motion.shape[0]))
    along = (pick @ motion).tocsr()
    along.eliminate_zeros()
    return along
