"""The sparsity pattern of the stuck structure, without values: sizes of its matrices and their factor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..mesh.data import ContactPairs, DistributedMesh
from .constraints import Constraints
from .matrices import GivenStructure
from .node_blocks import node_pattern

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True, eq=False)
class Coupling:
    """The graph of the unknowns of K_L: of nodes with three DOFs each, or of single DOFs."""

    graph: PETSc.Mat  # (n, n) ones where two are coupled, symmetric; freed by the caller
    n_dof_each: int  # 3 of nodes, 1 of DOFs
    entries_owned: int  # of this rank's rows of K
    dofs_owned: int
    n_dof: int


def coupling_of_nodes(dmesh: DistributedMesh, pairs: ContactPairs, constraints: Constraints | None = None) -> Coupling:
    """Return the coupling of the nodes of a mesh by elements, pairs and constraints.

    Collective on ``dmesh.comm``.  What supports fix is counted among it.  The graph of a structure with ``constraints`` is on
    rank 0 alone.
    """
    comm, pattern = dmesh.comm, node_pattern(dmesh)
    n_owned, n = len(pattern.indptr) - 1, pattern.n_nodes
    nodal = sp.csr_matrix((np.ones(len(pattern.indices), dtype=np.int8), pattern.indices, pattern.indptr), (n_owned, n))
    touched = sum((_ones(side) for side in pairs.sides(n)), sp.csr_matrix((pairs.n_pairs, n), dtype=np.int8))[:, _back(dmesh)]
    if constraints is not None:
        T = _places_that_lead(constraints, dmesh.rank_order)
        nodal = T[pattern.row_start : pattern.row_start + n_owned].T @ _ones(nodal @ T[:n])
        parts, touched, n = comm.gather(nodal) or [], touched @ T[:n], T.shape[1]
        nodal = _ones(sum(parts[1:], parts[0])) if comm.rank == 0 else sp.csr_matrix((0, n), dtype=np.int8)
        first = 0
    else:
        first = pattern.row_start
    by_pairs = _ones(touched.T.tocsr()[first : first + nodal.shape[0]] @ touched)
    rows = _ones(nodal + by_pairs + sp.eye(nodal.shape[0], n, first, dtype=np.int8))
    return Coupling(_matrix(comm, rows), 3, 9 * nodal.nnz, 3 * nodal.shape[0], 3 * n)


def coupling_of_dofs(given: GivenStructure | None, comm: MPI.Comm) -> Coupling:
    """Return the coupling of the DOFs of a structure given as matrices (on rank 0, None elsewhere).  Collective on ``comm``."""
    n = comm.bcast(0 if given is None else given.n_dof)
    rows, n_entries = sp.csr_matrix((0, n), dtype=np.int8), 0
    if given is not None:
        n_entries, R = given.K.nnz, _ones(given.R)
        rows = _ones(_ones(given.K) + R.T @ R + sp.identity(n, dtype=np.int8))
    return Coupling(_matrix(comm, rows), 1, n_entries, rows.shape[0], n)


def _places_that_lead(constraints: Constraints, rank_order: np.ndarray) -> sp.csr_matrix:
    """Return which places each place follows, (n_places, n_places), nodes in the order of the ranks; itself where free."""
    at, n_places = np.concatenate([rank_order, np.arange(len(rank_order), len(constraints.dof))]), len(constraints.dof)
    row_of, column_of = np.zeros(constraints.T.shape[0], dtype=int), np.zeros(constraints.T.shape[1], dtype=int)
    for place_of, numbers in ((row_of, constraints.dof), (column_of, constraints.free)):
        place, axis = np.nonzero(numbers >= 0)
        place_of[numbers[place, axis]] = at[place]
    T = constraints.T.tocoo()
    entries = (np.ones(T.nnz, dtype=np.int8), (row_of[T.row], column_of[T.col]))
    return _ones(sp.csr_matrix(entries, (n_places, n_places)))


def _back(dmesh: DistributedMesh) -> np.ndarray:
    """Return the node of ``Mesh.points`` of each rank-ordered node."""
    return np.argsort(dmesh.rank_order)


def _ones(A: sp.spmatrix) -> sp.csr_matrix:
    """Return the pattern of a matrix."""
    A = sp.csr_matrix(A)
    A.sum_duplicates()
    return sp.csr_matrix((np.ones(A.nnz, dtype=np.int8), A.indices, A.indptr), A.shape)


def _matrix(comm: MPI.Comm, rows: sp.csr_matrix) -> PETSc.Mat:
    """Return a graph from this rank's rows.  Collective on ``comm``."""
    rows.sort_indices()
    csr = (rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), np.ones(rows.nnz))
    graph = PETSc.Mat().createAIJ(((rows.shape[0], None), (rows.shape[0], None)), csr=csr, comm=comm)
    graph.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    graph.setOption(PETSc.Mat.Option.SPD, True)
    return graph
