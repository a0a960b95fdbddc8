"""Dependent degrees of freedom of the whole mesh by ties, points, equations and sectors, with chains resolved."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..messages.errors import Faults, MeshError
from ..messages.words import counted, place, verb
from ..tables.structure import Point
from ..tables.structure_tables import StructureTables
from .attached import Attached, attach
from .cyclic import CyclicFaces, check_joints_beside, cyclic_faces, followers
from .data import Mesh
from .equations import solve_equations, translations
from .locate import find_node
from .reference_points import of_distributing, of_equations, of_rigid
from .ties import Follower, check_joints, of_tie, resolved

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Links:
    """Dependent degrees of freedom: u[dependent] = weights u, all others independent.  docs/theory.md, eq. (2.5)."""

    dependent: np.ndarray  # (m,) ascending
    weights: sp.csr_matrix  # (m, n_dof) of independent degrees of freedom
    points: tuple[Point, ...]
    n_nodes: int
    joined: tuple[np.ndarray, ...]  # (2, n) connected nodes of each tie and point
    notes: tuple[str, ...]  # notes on ties, for the log
    attached: Attached | None = None  # masses, springs and dampers
    more_joined: tuple[np.ndarray, ...] = ()  # (2, n) nodes connected by equations and springs
    more_grounded: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # nodes held by equations and springs
    cyclic: CyclicFaces | None = None  # faces between sectors; nodes of the high face are dependent

    @property
    def n_places(self) -> int:
        """The number of places: nodes, then two per point (displacement and rotation)."""
        return self.n_nodes + 2 * len(self.points)

    def place_of(self, name: str, turns: bool = False) -> int:
        """Return the place of a point's displacement, or of its rotation."""
        return self.n_nodes + 2 * [point.name for point in self.points].index(name) + turns

    def node_of(self, name: str) -> int:
        """Return a node of the group of a point."""
        i = [point.name for point in self.points].index(name)
        return int(self.joined[len(self.joined) - len(self.points) + i][0, 0])

    @property
    def grounded(self) -> np.ndarray:
        """Nodes held by springs or equations, and one node per point held by springs, (n,)."""
        of_points = [self.node_of(point.name) for point in self.points if any(point.springs)]
        return np.concatenate([np.array(of_points, dtype=np.int64), self.more_grounded])

    @property
    def is_empty(self) -> bool:
        """Whether there are no dependent degrees of freedom and no attachments."""
        return not self.joined and self.attached is None and self.cyclic is None


def find_links(mesh: Mesh, tables: StructureTables) -> Links:
    """Return the dependences by ties, points, equations and cyclic faces of a scene, and its masses, springs and dampers.

    Local, rank 0.

    Raises
    ------
    MeshError : nodes too far from the facets, nodes that follow twice or themselves, groups that cannot turn, joints on tied
        faces, free nodes outside the elements, cyclic faces that do not match
    """
    links = _within(mesh, tables)
    return links if tables.cyclic is None else _with_sectors(mesh, tables, links)


def _with_sectors(mesh: Mesh, tables: StructureTables, links: Links) -> Links:
    """Return the links with the nodes of the high face dependent on the low face."""
    assert tables.cyclic is not None, "a disc"
    faces, is_fixed = cyclic_faces(mesh, tables.cyclic), fixed_places(mesh, tables, links)
    check_joints_beside(mesh, tables.cyclic, tables.joints)
    dependent, weights = followers(mesh, faces, is_fixed, links.dependent, links.weights)
    dependent, weights = np.concatenate([links.dependent, dependent]), sp.vstack([links.weights, weights]).tocsr()
    order = np.argsort(dependent)
    return replace(
        links,
        dependent=dependent[order],
        weights=weights[order],
        notes=(*links.notes, faces.note),
        more_joined=(*links.more_joined, faces.joined),
        cyclic=faces,
    )


def _within(mesh: Mesh, tables: StructureTables) -> Links:
    """Return the dependences within the structure."""
    links = _ties_and_points(mesh, tables)
    if mesh.equations is None and not tables.masses and not tables.springs:
        return links
    n_outside, n_dof = len(mesh.outside.points), 3 * links.n_places
    is_fixed = np.concatenate([fixed_places(mesh, tables, links).ravel(), _fixed_outside(mesh, tables).ravel()])
    dependent, weights = links.dependent, _widened(links.weights, n_dof + 3 * n_outside)
    more_joined, holding, notes = np.zeros((2, 0), dtype=np.int64), np.zeros(0, dtype=np.int64), links.notes
    if mesh.equations is not None:
        solved = solve_equations(mesh, [point.name for point in links.points], is_fixed, dependent, weights)
        weights = sp.vstack([resolved(solved.dependent, solved.weights, weights), solved.weights]).tocsr()
        dependent = np.concatenate([dependent, solved.dependent])
        more_joined, holding = solved.joined // 3, solved.grounded // 3
        notes += (
            f"{counted(len(mesh.equations.where), 'equation')} of the file: {len(solved.dependent)} degrees of freedom follow",
        )
    outside = _outside(mesh, dependent, weights, is_fixed, n_dof)
    leads = ~is_fixed
    leads[dependent] = False
    inside = np.flatnonzero(dependent < n_dof)
    inside = inside[np.argsort(dependent[inside])]
    attached = attach(mesh, tables, links.n_places, outside, leads[n_dof:])
    fixed = attached.holding(translations(links.n_nodes, links.n_places, n_dof)) // 3
    return replace(
        links,
        dependent=dependent[inside],
        weights=weights[inside][:, :n_dof],
        notes=notes,
        attached=attached,
        more_joined=(_on_nodes(links, more_joined), _on_nodes(links, attached.joined // 3)),
        more_grounded=_on_nodes(links, np.tile(np.concatenate([holding, fixed]), (2, 1)))[0],
    )


def fixed_places(mesh: Mesh, tables: StructureTables, links: Links) -> np.ndarray:
    """Return the directions of the places held by supports, (n_places, 3) bool.  Local, rank 0."""
    is_fixed = np.zeros((links.n_places, 3), dtype=bool)
    for i, support in enumerate(tables.supports, 1):
        if support.group is not None and support.group in mesh.outside.groups and not len(mesh.node_groups[support.group]):
            continue
        places = places_of(mesh, links, support, f"[[supports]] {i}")
        for direction in support.fix:
            turns, axis = divmod(DIRECTIONS.index(direction), 3)
            is_fixed[places + turns, axis] = True
    return is_fixed


def _fixed_outside(mesh: Mesh, tables: StructureTables) -> np.ndarray:
    """Return the directions of the nodes outside the elements held by supports, (n_outside, 3) bool."""
    is_fixed = np.zeros((len(mesh.outside.points), 3), dtype=bool)
    for support in tables.supports:
        nodes = mesh.outside.groups.get(support.group or "", np.zeros(0, dtype=np.int64))
        for direction in support.fix:
            is_fixed[nodes, "xyz".index(direction)] = True
    return is_fixed


def _outside(mesh: Mesh, dependent: np.ndarray, weights: sp.csr_matrix, is_fixed: np.ndarray, n_dof: int) -> sp.csr_matrix:
    """Return the dependences of degrees of freedom outside the elements, (3 n_outside, n_dof); 0 for held ones."""
    turning = np.flatnonzero(dependent >= n_dof)
    rows = sp.csr_matrix((np.ones(len(turning)), (dependent[turning] - n_dof, turning)), (len(is_fixed) - n_dof, len(dependent)))
    return (rows @ weights)[:, :n_dof].tocsr()


def _widened(weights: sp.csr_matrix, n_dof: int) -> sp.csr_matrix:
    return sp.csr_matrix((weights.data, weights.indices, weights.indptr), (weights.shape[0], n_dof))


def _on_nodes(links: Links, places: np.ndarray) -> np.ndarray:
    """Return pairs of nodes for pairs of places; a point is replaced by a node of its group, nodes outside are omitted."""
    nodes = np.concatenate([np.arange(links.n_nodes), np.repeat([links.node_of(point.name) for point in links.points], 2)])
    inside = (places < links.n_places).all(axis=0)
    return nodes.astype(np.int64)[places[:, inside]]


def _ties_and_points(mesh: Mesh, tables: StructureTables) -> Links:
    """Return the dependences by ties and points only."""
    n_places = len(mesh.points) + 2 * len(tables.points)
    if not tables.ties and not tables.points:
        return Links(np.zeros(0, dtype=np.int64), sp.csr_matrix((0, 3 * n_places)), (), len(mesh.points), (), ())
    followers, faults = list[Follower](), Faults()
    taken = np.zeros(len(mesh.points), dtype=bool)
    for tie in tables.ties:
        with faults.collected():
            followers.append(of_tie(mesh, tie, n_places, taken))
            taken[followers[-1].dependent // 3] = True
    if len(followers) == len(tables.ties):
        with faults.collected():
            check_joints(mesh, tables, followers)
    for i, point in enumerate(tables.points):
        connected = {"rigid": of_rigid, "distributing": of_distributing, "equations": of_equations}[point.connection]
        with faults.collected():
            followers.append(connected(mesh, point, len(mesh.points) + 2 * i, n_places))
    with faults.collected():
        _check_once(mesh, followers)
    faults.refuse()
    dependent = np.concatenate([part.dependent for part in followers])
    weights = sp.vstack([part.weights for part in followers]).tocsr()
    order = np.argsort(dependent)
    weights = _independent(mesh, followers, dependent[order], weights[order])
    joined, notes = tuple(part.joined for part in followers), tuple(part.note for part in followers)
    return Links(dependent[order], weights, tables.points, len(mesh.points), joined, notes)


def places_of(mesh: Mesh, links: Links | None, entry, where: str) -> np.ndarray:
    """Return the nodes, or the place of the point, of a support, a load or an output, (n,).  Local, rank 0.

    Raises
    ------
    MeshError, CaseError : the node does not exist
    """
    if entry.point is not None:
        assert links is not None, "a scene with points"
        turns = getattr(entry, "moment", None) or getattr(entry, "rotation", None)
        return np.array([links.place_of(entry.point, turns=turns is not None)])
    keys = ("position", "node", "group")
    return find_node(mesh, **{key: getattr(entry, key, None) for key in keys}, where=where)


def _check_once(mesh: Mesh, followers: Sequence[Follower]) -> None:
    """Raise MeshError if a node is dependent twice."""
    first = np.full(len(mesh.points), -1)
    for i, follower in enumerate(followers):
        places = np.unique(follower.dependent // 3)
        places = places[places < len(mesh.points)]
        twice = places[first[places] >= 0]
        if len(twice):
            raise MeshError(
                f"{mesh.path}: {counted(len(twice), 'node')} {verb(len(twice), 'follow')} two things, "
                f"{followers[first[twice[0]]].what} and "
                f"{follower.what}; the "
                f"first is node {mesh.numbers[twice[0]]} at {place(mesh.points[twice[0]])} m; swap the surfaces of a tie so that "
                "its other side follows, or take these nodes out of one group"
            )
        first[places] = i


def _independent(mesh: Mesh, followers: Sequence[Follower], dependent: np.ndarray, weights: sp.csr_matrix) -> sp.csr_matrix:
    """Return the weights with dependent degrees of freedom replaced by independent ones.

    Raises
    ------
    MeshError : cyclic dependences
    """
    inner = weights[:, dependent]
    _, ring = connected_components(inner, directed=True, connection="strong")
    in_ring = np.flatnonzero((np.bincount(ring)[ring] > 1) | (inner.diagonal() != 0.0))
    if len(in_ring):
        node = dependent[in_ring[0]] // 3
        names = dict.fromkeys(follower.what for follower in followers if np.isin(dependent[in_ring], follower.dependent).any())
        raise MeshError(
            f"{mesh.path}: {' and '.join(names)} follow each other in a ring, at node {mesh.numbers[node]} "
            f"{place(mesh.points[node])} m among others; leave one of them out, or swap its surfaces"
        )
    while weights[:, dependent].nnz:
        weights = resolved(dependent, weights, weights)
        weights.eliminate_zeros()
    return weights
