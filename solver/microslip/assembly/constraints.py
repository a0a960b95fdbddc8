"""Exact elimination of dependent degrees of freedom: u = T w, K' = T^T K T and so on (docs/theory.md, section 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..mesh.attached import Attached
from ..mesh.data import DistributedMesh, Mesh
from ..mesh.links import DIRECTIONS, Links
from ..messages.errors import MeshError
from ..messages.words import place
from ..parallel.petsc import without_operands
from ..tables.structure import Point
from .real_form import real_matrix

if TYPE_CHECKING:
    from mpi4py import MPI

_NOTHING = 1e-9  # a weight below does not move a held direction


@dataclass(frozen=True, eq=False)
class Constraints:
    """u = T w, eq. (2.5): rows of the DOFs of nodes that no support fixes, and then six of each point; the same on every rank.

    Places are those of ``Links``: nodes in the order of ``Mesh.points``, then two for each point.
    """

    T: sp.csr_matrix  # (n_nodal + 6 n_points, n_dof)
    dof: np.ndarray  # (n_places, 3) row of T, -1 where fixed
    free: np.ndarray  # (n_places, 3) row of the system, -1 where fixed or dependent
    nodal_ranges: np.ndarray  # (size + 1,) rank r has the nodes' rows nodal_ranges[r]:nodal_ranges[r + 1] of T
    row_ranges: np.ndarray  # (size + 1,) and these rows of the system
    points: tuple[Point, ...]
    group_nodes: tuple[int, ...]  # a node of the group of each point
    tied_bodies: np.ndarray  # (n_parts,) which connected parts are tied into one, numbered from 0
    loose: tuple[np.ndarray, ...]  # the connected parts of each of these that only joints hold
    notes: tuple[str, ...]  # descriptions of the constraints, for the log
    attached: Attached | None = None  # masses, springs and dampers

    @property
    def n_dof(self) -> int:
        """The number of rows of the system."""
        return int(self.row_ranges[-1])

    @property
    def n_nodal(self) -> int:
        """The number of the nodes' rows of T."""
        return int(self.nodal_ranges[-1])

    def at_nodes(self, u: np.ndarray) -> np.ndarray:
        """Return the displacements of the nodes, (n_nodes, 3, ...), from those of all rows, (n_dof, ...).  Local."""
        rows = self.T[: self.n_nodal] @ u
        rows = np.concatenate([rows, np.zeros((1, *rows.shape[1:]))])  # row -1: fixed
        return rows[self.dof[: len(self.dof) - 2 * len(self.points)]]

    def name_of_row(self, row: int) -> str:
        """Return the name of a row of the system for messages.  Local."""
        at, axis = np.argwhere(self.free == row)[0]
        n_nodes = len(self.free) - 2 * len(self.points)
        if at < n_nodes:
            return f"node index {at}, direction {DIRECTIONS[axis]}"
        return f"point {self.points[(at - n_nodes) // 2].name!r}, direction {DIRECTIONS[3 * ((at - n_nodes) % 2) + axis]}"

    def transposed(self, comm: MPI.Comm, forces_owned: np.ndarray) -> np.ndarray:
        """Return this rank's rows of T^T f for forces on its nodes' rows, (n_nodal_owned,) [N].  Collective."""
        T = _distributed(self, self.T, comm)
        f, reduced = T.createVecs(side="l"), T.createVecs(side="r")
        f.setArray(forces_owned)
        T.multTranspose(f, reduced)
        values = reduced.getArray().copy()
        for item in (f, reduced, T):
            item.destroy()
        return values

    @property
    def at_places(self) -> sp.csr_matrix:
        """The displacements of all places, (3 n_places, n_dof): rows of T, and none where a support holds."""
        dof = self.dof.ravel()
        free = np.flatnonzero(dof >= 0)
        return sp.csr_matrix((np.ones(len(free)), (free, dof[free])), (len(dof), self.T.shape[0])) @ self.T

    def of_places(self, comm: MPI.Comm, forces: np.ndarray) -> np.ndarray:
        """Return this rank's rows of T^T of forces on all places, (n_places, 3) [N], the same on every rank.  Local."""
        first, last = self.row_ranges[comm.rank : comm.rank + 2]
        return (self.at_places.T @ forces.ravel())[first:last]

    def of_points(self, comm: MPI.Comm, values: np.ndarray) -> np.ndarray:
        """Return this rank's rows of T^T of forces and moments on the points, (6 n_points,), the same on every rank.  Local."""
        first, last = self.row_ranges[comm.rank : comm.rank + 2]
        return (self.T[self.n_nodal :].T @ values)[first:last]


def constrain(
    dmesh: DistributedMesh, links: Links, is_fixed: np.ndarray, tied_bodies: np.ndarray, loose: tuple[np.ndarray, ...]
) -> Constraints:
    """Return T with the numbering of its rows and columns.  Local; the same on every rank.

    ``is_fixed`` is (n_places, 3) bool.
    """
    n_nodes = links.n_nodes
    to_mesh = np.argsort(dmesh.rank_order)
    nodal, nodal_ranges = number_dofs(dmesh, is_fixed[:n_nodes][to_mesh])
    n_nodal = int(nodal_ranges[-1])
    of_points = n_nodal + np.arange(6 * len(links.points)).reshape(-1, 3)
    dof = np.where(is_fixed, -1, np.concatenate([nodal[dmesh.rank_order], of_points]))
    is_gone = is_fixed.copy()
    is_gone.ravel()[links.dependent] = True
    free, row_ranges = _number(dmesh, links, is_gone)
    group_nodes = tuple(links.node_of(point.name) for point in links.points)
    T = _transformation(links, dof.ravel(), free.ravel(), (n_nodal + of_points.size, int(row_ranges[-1])))
    return Constraints(
        T, dof, free, nodal_ranges, row_ranges, links.points, group_nodes, tied_bodies, loose, links.notes, links.attached
    )


def _number(dmesh: DistributedMesh, links: Links, is_gone: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of the places, (n_places, 3), and the row ranges: on each rank its nodes, then its points."""
    n_nodes = links.n_nodes
    owners = [
        np.searchsorted(dmesh.node_ranges, dmesh.rank_order[links.node_of(point.name)], "right") - 1 for point in links.points
    ]
    owner = np.concatenate([np.searchsorted(dmesh.node_ranges, dmesh.rank_order, "right") - 1, np.repeat(owners, 2)]).astype(int)
    order = np.lexsort((np.concatenate([dmesh.rank_order, np.arange(n_nodes, links.n_places)]), owner))
    before = np.concatenate([[0], np.cumsum(~is_gone[order].ravel())])
    rows = np.where(is_gone[order], -1, before[:-1].reshape(-1, 3))
    free = np.empty_like(rows)
    free[order] = rows
    ends = np.searchsorted(owner[order], np.arange(dmesh.comm.size), side="right")
    return free, before[3 * np.concatenate([[0], ends])]


def _transformation(links: Links, dof: np.ndarray, free: np.ndarray, shape: tuple[int, int]) -> sp.csr_matrix:
    """Return T: ones for free DOFs, weights of free DOFs for dependent ones, zeros for fixed ones."""
    is_free = np.flatnonzero(free >= 0)
    followed = links.weights.tocoo()
    row, column = dof[links.dependent[followed.row]], free[followed.col]
    is_entry = (row >= 0) & (column >= 0)
    values = np.concatenate([np.ones(len(is_free)), followed.data[is_entry]])
    places = (np.concatenate([dof[is_free], row[is_entry]]), np.concatenate([free[is_free], column[is_entry]]))
    return sp.csr_matrix((values, places), shape)


def check_supports(mesh: Mesh, links: Links, is_fixed: np.ndarray) -> None:
    """Raise MeshError if a support fixes a DOF that follows moving ones.  Local, rank 0."""
    fixed = is_fixed.ravel()
    both = np.flatnonzero(fixed[links.dependent])
    moving = abs(links.weights[both][:, ~fixed])
    moved = both[(moving.max(axis=1).toarray().ravel() if moving.shape[1] else np.zeros(len(both))) > _NOTHING]
    if len(moved) == 0:
        return
    at, axis = divmod(int(links.dependent[moved[0]]), 3)
    if at >= links.n_nodes:
        name = links.points[(at - links.n_nodes) // 2].name
        raise MeshError(f"{mesh.path}: point {name!r} follows its nodes and cannot be held; let it be rigid, or give it springs")
    raise MeshError(
        f"{mesh.path}: {len(moved)} degrees of freedom have a support and follow a tie or a point that moves; the first is that "
        f"of node {mesh.numbers[at]} at {place(mesh.points[at])} m along {'xyz'[axis]}; support what leads (the second surface "
        "of the tie, the point), swap the surfaces of the tie, or take the node out of one group"
    )


def tidy(matrix: sp.spmatrix) -> sp.csr_matrix:
    """Return a matrix by rows, without stored zeros, columns rising.  Local."""
    matrix = matrix.tocsr()
    matrix.eliminate_zeros()
    matrix.sort_indices()
    return matrix


def damping_of(on_places: sp.csr_matrix, constraints: Constraints, comm: MPI.Comm) -> PETSc.Mat:
    """Return C of the free DOFs from that of the dampers (3 n_places, 3 n_places) [N s/m].  Collective on ``comm``."""
    return _of_rows(constraints, tidy(constraints.at_places.conj().T @ on_places @ constraints.at_places), comm)


def _of_rows(constraints: Constraints, values: sp.csr_matrix, comm: MPI.Comm) -> PETSc.Mat:
    """Return a small matrix (n_dof, n_dof), the same on every rank, as a distributed one, a complex one in real form.

    Collective on ``comm``.
    """
    first, last = constraints.row_ranges[comm.rank : comm.rank + 2]
    owned, copies = values[first:last], 1
    if np.iscomplexobj(owned):
        owned, copies = real_matrix(owned), 2
    csr = (owned.indptr.astype(PETSc.IntType), owned.indices.astype(PETSc.IntType), owned.data)
    sizes = (copies * int(last - first), copies * constraints.n_dof)
    return PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=comm)


def reduced(matrix: PETSc.Mat, constraints: Constraints, blocks: np.ndarray, on_places: sp.csr_matrix | None = None) -> PETSc.Mat:
    """Return T^T A T plus the matrices of points, masses and springs; symmetric.

    Collective; destroys ``matrix``.  ``blocks`` (n_points, 6, 6) are those of the points, ``on_places``
    (3 n_places, 3 n_places) those of the others.
    """
    comm = matrix.comm.tompi4py()
    projected = _projected(matrix, constraints, comm)
    added = added_by_points(constraints, blocks)
    if on_places is not None:
        added = tidy(added + constraints.at_places.T @ on_places @ constraints.at_places)
    if added.nnz:
        more = _of_rows(constraints, added, comm)
        projected.axpy(1.0, more, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        more.destroy()
    projected.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    projected.setOption(PETSc.Mat.Option.SYMMETRY_ETERNAL, True)
    return projected


def _projected(matrix: PETSc.Mat, constraints: Constraints, comm: MPI.Comm) -> PETSc.Mat:
    """Return T^T A T, A of the nodes.  Collective."""
    selected = _selected(constraints.T[: constraints.n_nodal])
    if selected is not None:
        rows = PETSc.IS().createGeneral(selected[slice(*constraints.row_ranges[comm.rank : comm.rank + 2])], comm=matrix.comm)
        projected = matrix.createSubMatrix(rows, rows)
        rows.destroy()
        matrix.destroy()
        return projected
    T = _distributed(constraints, constraints.T, comm)
    right = matrix.matMult(T)  # two products take a quarter of the time of PETSc's one, MatPtAP
    matrix.destroy()
    projected = T.transposeMatMult(right)
    for operand in (T, right):
        operand.destroy()
    return without_operands(projected)


def _selected(T: sp.csr_matrix) -> np.ndarray | None:
    """Return the row that each column of T selects, (n_dof,), or None: T is not a selection of rows.  Local."""
    columns = T.tocsc()
    if not ((np.diff(columns.indptr) == 1).all() and (columns.data == 1.0).all() and np.diff(T.indptr).max(initial=0) <= 1):
        return None
    return columns.indices.astype(PETSc.IntType)


def added_by_points(constraints: Constraints, blocks: np.ndarray) -> sp.csr_matrix:
    """Return T^T B T of blocks (n_points, 6, 6) on the points, (n_dof, n_dof).  Local; the same on every rank."""
    P = constraints.T[constraints.n_nodal :]
    added = (P.conj().T @ sp.block_diag([*blocks, sp.csr_matrix((0, 0))], format="csr") @ P).tocsr()
    added.sort_indices()
    return added


def stiffness_blocks(points: tuple[Point, ...]) -> np.ndarray:
    """Return the springs to ground of the points, (n_points, 6, 6).  Local."""
    return np.array([np.diag(point.springs) for point in points]).reshape(-1, 6, 6)


def mass_blocks(points: tuple[Point, ...]) -> np.ndarray:
    """Return the masses and inertias of the points, (n_points, 6, 6).  Local."""
    blocks = np.zeros((len(points), 6, 6))
    for block, point in zip(blocks, points, strict=True):
        block[:3, :3] = point.mass * np.eye(3)
        xx, yy, zz, xy, yz, zx = point.whole_inertia
        block[3:, 3:] = [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]
    return blocks


def _distributed(constraints: Constraints, T: sp.csr_matrix, comm: MPI.Comm) -> PETSc.Mat:
    """Return the nodes' rows of T, or of a part of it, as a PETSc matrix, split as K is before and after.  Collective."""
    (first, last), (begin, end) = constraints.nodal_ranges[comm.rank :][:2], constraints.row_ranges[comm.rank :][:2]
    owned = tidy(T[first:last])
    csr = (owned.indptr.astype(PETSc.IntType), owned.indices.astype(PETSc.IntType), owned.data)
    return PETSc.Mat().createAIJ(((last - first, None), (end - begin, None)), csr=csr, comm=comm)


def number_dofs(dmesh: DistributedMesh, is_fixed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the row of every DOF and the row ranges of the ranks.  Local; the same on every rank.

    Parameters
    ----------
    is_fixed : (n_nodes, 3) bool, by rank-ordered node

    Returns
    -------
    dof : (n_nodes, 3) row of each rank-ordered node, -1 where fixed
    row_ranges : (size + 1,) rank r owns rows row_ranges[r]:row_ranges[r + 1]
    """
    rows_before = np.concatenate([[0], np.cumsum(~is_fixed.ravel())])
    dof = np.where(is_fixed, -1, rows_before[:-1].reshape(is_fixed.shape))
    return dof, rows_before[3 * dmesh.node_ranges]
