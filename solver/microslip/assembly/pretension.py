"""Bolts with pretension: the load of a shortened shank and the force in its cut (docs/theory.md, section 12)."""

from dataclasses import dataclass

import numpy as np

from .. import elements
from ..mesh.cut import Cut, cuts_through
from ..mesh.data import DistributedMesh, LocalBlock, Mesh
from ..messages.errors import MeshError
from ..messages.words import place
from ..parallel.agree import on_root
from ..tables.constant_loads import Bolt
from ..tables.structure_tables import StructureTables
from .assemble import element_chunks
from .prestress import element_forces, on_rows, owned_nodes
from .spin import stated_statics
from .system import System

_ALONG = 1e-6  # of the normal: a support along less of it does not hold the cut


@dataclass(frozen=True, eq=False)
class Overlap:
    """Displacements of the elements above the cuts in addition to those of their nodes, on one rank: 0 except on cut nodes."""

    normals: np.ndarray  # (n_bolts, 3) of the cuts
    of_nodes: np.ndarray  # (n_nodes,) rank-ordered: the bolt whose cut the node is in, or -1
    of_elements: tuple[np.ndarray, ...]  # for each block (n_elements,): the bolt above whose cut the element is, or -1

    def motions_of(self, block: LocalBlock, i: int, rows, shortening: np.ndarray) -> np.ndarray:
        """Return -n delta of some elements of block i, (n_elements, n, 3) [m]; ``shortening`` (n_bolts,) [m].

        Local.  docs/theory.md, eq. (12.6).
        """
        bolt = self.of_elements[i][rows]
        here = (bolt >= 0)[:, None] & (self.of_nodes[block.nodes[rows]] == bolt[:, None])
        steps = -shortening[bolt, None] * self.normals[bolt]
        return here[:, :, None] * steps[:, None, :]


@dataclass(frozen=True, eq=False)
class Bolts:
    """The bolts of a structure, the same on every rank but for the rows of F."""

    given: tuple[Bolt, ...]
    area: np.ndarray  # (n_bolts,) m2
    overlap: Overlap
    F_owned: np.ndarray  # (n_dof_owned, n_bolts) N/m, the load of a unit shortening
    k: np.ndarray  # (n_bolts,) N/m, force in the cut of a unit shortening while no node moves
    loaded: np.ndarray  # (n_bolts,) N, force in a cut due to the loads on the elements above it


def pretension(dmesh: DistributedMesh, mesh: Mesh | None, tables: StructureTables, system: System) -> Bolts | None:
    """Return the bolts of ``tables.statics``, eq. (12.7); None where there are none.

    Collective on ``dmesh.comm``.  ``mesh`` is that of rank 0.

    Raises
    ------
    MeshError : a group that is no cut through a shank, or a cut that is held or in contact; on every rank
    """
    statics = stated_statics(tables)
    if not statics.bolts:
        return None
    comm = dmesh.comm
    cuts = on_root(comm, _checked_cuts, mesh, tables, system)
    overlap = _overlap(dmesh, tables, cuts)
    F, load = _nodal(dmesh, tables, overlap, len(cuts))
    first, last = owned_nodes(dmesh)
    bolt = overlap.of_nodes[first:last]
    n = np.where((bolt >= 0)[:, None], overlap.normals[bolt], 0.0)
    mine = bolt[:, None] == np.arange(len(cuts))
    along = np.einsum("bai,ai->ab", F, n), np.einsum("ai,ai->a", load, n)[:, None]
    k, loaded = (comm.allreduce((mine * values).sum(axis=0)) for values in along)
    F_owned = np.column_stack([on_rows(dmesh, system, nodal) for nodal in F])
    return Bolts(statics.bolts, np.array([cut.area for cut in cuts]), overlap, F_owned, k, loaded)


def _checked_cuts(mesh: Mesh, tables: StructureTables, system: System) -> list[Cut]:
    """Return the cuts; MeshError where a support holds one along its normal, or contact pairs lie on it.  Local, rank 0."""
    assert system.dof is not None, "a structure with a mesh"
    bolts = stated_statics(tables).bolts
    cuts = cuts_through(mesh, bolts)
    in_contact = np.zeros(system.n_dof, dtype=bool)
    in_contact[system.R.indices] = True
    holding = "a support" if system.constraints is None else "a support, a tie or a point"
    for bolt, cut in zip(bolts, cuts):
        dof = system.dof[cut.nodes]
        for bad, what in (
            (((dof < 0) & (np.abs(cut.normal) > _ALONG)).any(axis=1), f"{holding} holds it along the shank"),
            ((in_contact[dof] & (dof >= 0)).any(axis=1), "it belongs to a joint"),
        ):
            if bad.any():
                node = cut.nodes[np.argmax(bad)]
                raise MeshError(
                    f"{mesh.path}: bolt {bolt.label!r}: group {bolt.group!r}: node {mesh.numbers[node]} "
                    f"{place(mesh.points[node])} m of the cut cannot open, for {what}; cut the shank where it is free"
                )
    return cuts


def _overlap(dmesh: DistributedMesh, tables: StructureTables, cuts: list[Cut]) -> Overlap:
    """Return which of this rank's elements and nodes are at the cuts.  Local."""
    of_nodes = np.full(len(dmesh.rank_order), -1)
    of_elements = tuple(np.full(len(block.nodes), -1) for block in dmesh.blocks)
    for b, cut in enumerate(cuts):
        of_nodes[dmesh.rank_order[cut.nodes]] = b
        for (kind, group), numbers in cut.numbers.items():
            for block, of_block in zip(dmesh.blocks, of_elements):
                if (block.kind, block.body) == (kind, tables.body_of[group]):
                    of_block[np.isin(block.numbers, numbers)] = b
    return Overlap(np.array([cut.normal for cut in cuts]), of_nodes, of_elements)


def _nodal(dmesh: DistributedMesh, tables: StructureTables, overlap: Overlap, n_bolts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return on this rank's nodes the load of each unit shortening, (n_bolts, n_owned, 3) [N/m], and the remaining load.  Local.

    The latter, (n_owned, 3) [N], is what else acts on the elements above the cuts.
    """
    first, last = owned_nodes(dmesh)
    F, load = np.zeros((n_bolts, last - first, 3)), np.zeros((last - first, 3))
    for i, block in enumerate(dmesh.blocks):
        body = tables.sections[block.body]
        for chunk in element_chunks(block):
            rows = chunk.start + np.flatnonzero(overlap.of_elements[i][chunk] >= 0)
            points, nodes = block.points[rows], block.nodes[rows] - first
            K = elements.stiffness(body.solids(block.kind, points))
            step = overlap.motions_of(block, i, rows, np.ones(n_bolts))
            forces = -np.einsum("eij,ej->ei", K, step.reshape(len(K), K.shape[1])).reshape(step.shape)
            mine = (nodes >= 0) & (nodes < last - first)
            bolt = np.broadcast_to(overlap.of_elements[i][rows][:, None], nodes.shape)
            np.add.at(F, (bolt[mine], nodes[mine]), forces[mine])
            np.add.at(load, nodes[mine], element_forces(block, rows, tables)[mine])
    return F, load
