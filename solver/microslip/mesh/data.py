"""Results of the mesh stage: the whole mesh (rank 0), each rank's part of it, the contact pairs (every rank)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..contact.law import Law
from ..contact.laws import ELASTIC_COULOMB, law_of

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..formats.model import Equations


@dataclass(frozen=True)
class ElementBlock:
    """Elements of one kind and one physical group, nodes in VTK order."""

    kind: str  # a key of elements.KINDS
    group: str  # name of the physical group
    nodes: np.ndarray  # (n_elements, n_nodes_of_kind) index into Mesh.points
    numbers: np.ndarray  # (n_elements,) element numbers of the user's file


@dataclass(frozen=True)
class FaceBlock:
    """Surface faces of one kind and one physical group, nodes in VTK order."""

    kind: str  # "tri3" "tri6" "quad4" "quad8"
    group: str
    nodes: np.ndarray  # (n_faces, n_nodes_of_kind)


@dataclass(frozen=True, eq=False)
class Outside:
    """Nodes of masses, springs or equations that belong to no element of a body."""

    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3) m
    numbers: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (n,) of the user's file
    groups: Mapping[str, np.ndarray] = field(default_factory=dict)  # their named groups: positions in points


@dataclass(frozen=True)
class Mesh:
    """The whole mesh, in metres.  Rank 0 only."""

    path: str
    points: np.ndarray  # (n_nodes, 3) m
    numbers: np.ndarray  # (n_nodes,) node numbers of the user's file
    elements: tuple[ElementBlock, ...]
    faces: tuple[FaceBlock, ...]
    node_groups: dict[str, np.ndarray]  # every named group, of any dimension: its node indices, sorted
    notes: tuple[str, ...] = ()  # notes on omissions and assumptions
    fields: Mapping[str, np.ndarray] = field(default_factory=dict)  # (n_nodes,) each: values at the nodes; NaN: no value
    outside: Outside = field(default_factory=Outside)
    equations: Equations | None = None  # between nodes; n_nodes + k is node k of ``outside``
    touching_faces: frozenset[str] = frozenset()  # groups of touching faces, detected by geometry: some may overlap only partly
    planes: Mapping[str, np.ndarray] = field(default_factory=dict)  # of groups along a plane: a point, the normal, (2, 3)

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box [m]."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


@dataclass(frozen=True)
class LocalBlock:
    """The elements that a rank needs for the matrix rows of its own nodes."""

    kind: str
    body: str  # name in [bodies.<name>]
    nodes: np.ndarray  # (n_elements, n_nodes_of_kind) rank-ordered node numbers
    points: np.ndarray  # (n_elements, n_nodes_of_kind, 3) m
    numbers: np.ndarray  # (n_elements,) the user's element numbers
    temperature_rise: float | np.ndarray = 0.0  # K above the stress-free temperature; at the nodes: (n_elements, n_nodes_of_kind)

    def rise_of(self, rows: slice | np.ndarray) -> float | np.ndarray:
        """Return the temperature rise of some elements, at their nodes or uniform [K].  Local."""
        return self.temperature_rise[rows] if isinstance(self.temperature_rise, np.ndarray) else self.temperature_rise


@dataclass(frozen=True)
class DistributedMesh:
    """A rank's part of the mesh.  Nodes are renumbered so that each rank owns a contiguous range."""

    comm: MPI.Comm
    node_ranges: np.ndarray  # (size + 1,) rank r owns rank-ordered nodes node_ranges[r]:node_ranges[r + 1]
    rank_order: np.ndarray  # (n_nodes,) rank-ordered number of each node of Mesh.points; same on every rank
    blocks: tuple[LocalBlock, ...]
    split_by: str  # method of the partition, for the log


@dataclass(frozen=True)
class ContactPairs:
    """The contact pairs, the same on every rank; pair i owns rows 3 i to 3 i + 2 of R (x, y tangential, z normal)."""

    joint: tuple[str, ...]  # (n_pairs,) name of the joint
    node1: np.ndarray  # (n_pairs,) index of the (nearest) node of body 1 in Mesh.points; -1 without a mesh
    node2: np.ndarray  # (n_pairs,) the same of body 2; -1: ground
    position: np.ndarray  # (n_pairs, 3) m
    frame: np.ndarray  # (n_pairs, 3, 3) rows x, y, z in model axes; z from body 2 into body 1
    area: np.ndarray  # (n_pairs,) m2, positive
    mu: np.ndarray  # (n_pairs,) -
    N0: np.ndarray  # (n_pairs,) N; negative: initial gap -N0 / k_n
    k_t: np.ndarray  # (n_pairs,) N/m
    k_n: np.ndarray  # (n_pairs,) N/m
    separate: np.ndarray  # (n_pairs,) bool: each tangential direction has its own friction limit
    faces: tuple[np.ndarray, ...]  # contact faces for pictures: (n_faces, n_corners or with mid-sides) pair indices
    T0: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))  # (n_pairs, 2) N, friction force at rest; default 0
    open_at_rest: np.ndarray = field(
        default_factory=lambda: np.zeros(0, dtype=bool)
    )  # (n_pairs,) bool: open at rest, without springs
    weights1: sp.csr_matrix | None = None  # (n_pairs, n_nodes) weights of the nodes of body 1; None: only node1
    weights2: sp.csr_matrix | None = None  # (n_pairs, n_nodes) the same of body 2
    cells: np.ndarray = field(default_factory=lambda: np.full((0, 4, 3), np.nan))  # (n_pairs, 4, 3) m, for pictures; NaN: none
    notes: tuple[str, ...] = ()  # notes on the pairing, for the log
    laws: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=str))  # (n_pairs,) names of laws; default elastic-Coulomb
    w0: np.ndarray = field(
        default_factory=lambda: np.zeros((0, 0, 2))
    )  # (n_pairs, n_elements, 2) m, initial slider positions of laws with several elements
    next_sector: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n_pairs,) bool: side 2 in the next sector
    law_columns: Mapping[str, np.ndarray] = field(
        default_factory=dict
    )  # (n_pairs,) each: further columns of laws; NaN for pairs of other laws

    def __post_init__(self):
        if len(self.laws) != self.n_pairs:
            object.__setattr__(self, "laws", np.full(self.n_pairs, ELASTIC_COULOMB))
        for name in ("T0", "open_at_rest", "w0", "next_sector"):  # defaults of pairs without statics
            values = getattr(self, name)
            if len(values) != self.n_pairs:
                object.__setattr__(self, name, np.zeros((self.n_pairs, *values.shape[1:]), dtype=values.dtype))
        if len(self.cells) != self.n_pairs:
            object.__setattr__(self, "cells", np.full((self.n_pairs, 4, 3), np.nan))

    @property
    def n_pairs(self) -> int:
        """The number of contact pairs."""
        return len(self.k_t)

    def of_joint(self, name: str) -> np.ndarray:
        """Return the numbers of the pairs of a joint, ascending; empty if no pair belongs to it.  Local."""
        return np.flatnonzero(np.array(self.joint, dtype=object) == name)

    def by_joint(self) -> dict[str, np.ndarray]:
        """Return the numbers of the pairs of each joint that has any, by the name of the joint.  Local."""
        return {name: self.of_joint(name) for name in dict.fromkeys(self.joint)}

    def sides(self, n_nodes: int) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """Return the weights of the nodes of Mesh.points on each side, (n_pairs, n_nodes); ground has no weights."""
        given = ((self.weights1, self.node1), (self.weights2, self.node2))
        first, second = (on_nodes(nodes, n_nodes) if weights is None else weights for weights, nodes in given)
        return first, second

    @property
    def law(self) -> Law:
        """The contact law of the pairs about their state of rest."""
        return law_of(self.laws, self.columns)

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """The parameters of laws, (n_pairs, ...) each."""
        names = ("mu", "N0", "k_t", "k_n", "separate", "T0", "open_at_rest", "w0")
        return {name: getattr(self, name) for name in names} | dict(self.law_columns)


def stacked(parts: Sequence):
    """Return arrays, or sparse matrices, of several parts joined along the first axis.  Local."""
    return sp.vstack(parts).tocsr() if sp.issparse(parts[0]) else np.concatenate(parts)


def on_nodes(nodes: np.ndarray, n_nodes: int) -> sp.csr_matrix:
    """Return the weights of points at nodes, (n, n_nodes); -1: ground.  Local."""
    on_mesh = nodes >= 0
    places = (np.flatnonzero(on_mesh), nodes[on_mesh])
    return sp.csr_matrix((np.ones(np.count_nonzero(on_mesh)), places), (len(nodes), n_nodes))
