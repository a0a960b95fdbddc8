"""A structure given as matrices by the user: K, M and optionally C; pairs, loads and outputs by rows, or by nodes.

DOF numbers count from 0 and are the rows of the matrices.  The files of the matrices, or tables in addition, state
which rows belong to which nodes: matrix_places.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
import scipy.sparse.csgraph
from petsc4py import PETSc

from ..contact.laws import columns_of_joint, joined
from ..formats.matrices.read import read_matrix
from ..mesh.data import ContactPairs, Mesh
from ..mesh.pairing import join_pairs, pair_contacts
from ..messages.errors import CaseError, ResourceError
from ..messages.words import counted
from ..parallel.ownership import split_evenly
from ..tables.joint import Joint
from ..tables.structure_tables import StructureTables
from ..tables.vibration import Load, Output
from .fixed_pairs import fixed_by_rows, notes_on_fixed
from .force_file import forces_on_dofs
from .maps import orders_of
from .matrix_checks import messages_on_matrices
from .matrix_places import Places, aligned, names_nodes, read_places
from .pair_file import COLUMNS, GROUND, read_pairs
from .system import System

if TYPE_CHECKING:
    from mpi4py import MPI

_SYMBOLS = {"stiffness": "K", "mass": "M", "damping": "C"}
_MOST_ENTRIES = 2**31 - 1  # MPI and PETSc count with 32 bits


@dataclass(frozen=True)
class GivenStructure:
    """The contents of the files.  Rank 0 only."""

    K: sp.csr_matrix  # (n_dof, n_dof) N/m, without the joint springs
    M: sp.csr_matrix  # (n_dof, n_dof) kg
    C: sp.csr_matrix | None  # (n_dof, n_dof) N s/m
    pairs: ContactPairs
    R: sp.csr_matrix  # (3 n_pairs, n_dof) relative displacement of the pairs
    loads: sp.csc_matrix  # (n_dof, n_loads) real shapes of the loads, per unit level
    outputs: sp.csr_matrix  # (n_outputs, n_dof)
    places: Places | None = None  # nodes, where rows belong to some
    notes: tuple[str, ...] = ()  # on the files, for the log

    @property
    def n_dof(self) -> int:
        """The number of degrees of freedom."""
        return self.K.shape[0]

    @property
    def n_massless(self) -> int:
        """The number of degrees of freedom without mass."""
        return int(np.count_nonzero(self.M.diagonal() == 0.0))

    @property
    def mesh(self) -> Mesh | None:
        """The nodes, with elements where [model] nodes is a mesh file; None where rows belong to none."""
        return None if self.places is None else self.places.mesh


def read_structure(tables: StructureTables) -> GivenStructure:
    """Read the files and check that they fit together, and to the loads and outputs.

    Local, on rank 0.

    Raises
    ------
    CaseError : a file, a matrix or a DOF number is at fault
    ResourceError : not enough memory
    """
    given = tables.model.matrices
    files = {key: path for key, (path, _) in given.items()}
    of_files = {key: read_matrix(files[key], f"[model] {key}", _SYMBOLS[key], given[key][1]) for key in _SYMBOLS if key in given}
    matrices, dofs = aligned(of_files, files)
    K, M, C = (matrices.get(key) for key in _SYMBOLS)
    n_dof = K.shape[0]
    for key, matrix in matrices.items():
        if matrix.shape != K.shape:
            raise CaseError(
                f"{files[key]}: [model] {key} is {matrix.shape[0]} x {matrix.shape[1]}, but the stiffness {n_dof} x {n_dof}"
            )
    _check_mass(M, C, f"{files['mass']}: [model] mass")
    if K.nnz > _MOST_ENTRIES:
        raise ResourceError(
            f"{files['stiffness']}: [model] stiffness has {K.nnz} entries; this version reads {_MOST_ENTRIES} at most"
        )
    places = read_places(tables, dofs, n_dof)
    _check_dofs(tables, n_dof, places)
    notes = tuple(note for each in of_files.values() for note in each.notes)
    notes += () if places is None else places.mesh.notes
    notes += tuple(messages_on_matrices(K, M, {key: each.skew for key, each in of_files.items()}, places))
    pairs, R = _read_joints(tables, n_dof, places)
    notes += notes_on_fixed(pairs, fixed_by_rows(R), str(tables.path))
    loads, outputs = _load_map(tables.loads, n_dof, places), _output_map(tables.outputs, n_dof, places)
    return GivenStructure(K, M, C, pairs, R, loads, outputs, places, notes + pairs.notes)


def _check_dofs(tables: StructureTables, n_dof: int, places: Places | None) -> None:
    """Raise CaseError for loads and outputs on rows that do not exist, and on nodes without known rows."""
    named: dict[str, Sequence[Load | Output]] = {"loads": tables.loads, "outputs": tables.outputs}
    for table, entries in named.items():
        for i, entry in enumerate(entries, 1):
            if _is_elsewhere(entry) or (entry.dof is None and places is not None):
                continue
            if entry.dof is None:
                raise CaseError(
                    f"{tables.path}: [[{table}]] {i}: the files of the matrices have no nodes; state [model] dofs, or name a dof"
                )
            if entry.dof >= n_dof:
                raise CaseError(f"{tables.path}: [[{table}]] {i} dof = {entry.dof}: the matrices have DOFs 0 to {n_dof - 1}")
    if places is None and any(joint.pairs is None for joint in tables.joints):
        raise CaseError(f"{tables.path}: [[joints]] node_pairs: the files of the matrices have no nodes; state [model] dofs")


def _is_elsewhere(entry: Load | Output) -> bool:
    """Return whether a load or an output is at no DOF of its own: forces of a file, the contact force of a joint."""
    return getattr(entry, "forces", None) is not None or getattr(entry, "joint", None) is not None


def _check_mass(M: sp.csr_matrix, C: sp.csr_matrix | None, where: str) -> None:
    """Raise CaseError for negative masses, and for massless DOFs with mass coupling or damping."""
    mass = M.diagonal()
    if (mass < 0.0).any():
        raise CaseError(f"{where} of DOF {np.argmin(mass)} is {mass.min():g} kg; a mass must not be negative")
    if not (mass > 0.0).any():
        raise CaseError(f"{where} is zero on the whole diagonal; without any mass nothing vibrates")
    for matrix, name in ((M, "mass couples it to others"), (C, "damping acts on it")):
        if matrix is not None:
            loaded = np.flatnonzero((mass == 0.0) & (abs(matrix).sum(axis=1).A1 > 0.0))
            if len(loaded):
                raise CaseError(
                    f"{where} of DOF {loaded[0]} is 0, yet {name} ({counted(len(loaded), 'DOF')} of this sort); a DOF without "
                    "mass follows its springs alone: give it a small mass, or remove the entries"
                )


def _read_joints(tables: StructureTables, n_dof: int, places: Places | None) -> tuple[ContactPairs, sp.csr_matrix]:
    """Return the pairs of all joints and their R, (3 n_pairs, n_dof): those by DOFs first."""
    by_dof = [joint for joint in tables.joints if joint.pairs is not None]
    by_node = [joint for joint in tables.joints if joint.pairs is None]
    pairs, dofs = _pairs_of_dofs(by_dof, n_dof)
    R = _pair_map(dofs, n_dof)
    if not by_node:
        return pairs, R
    of_nodes = pair_contacts(places.mesh, by_node)
    return join_pairs(pairs, of_nodes), sp.vstack([R, places.pair_map(of_nodes)]).tocsr()


def _pairs_of_dofs(joints: Sequence[Joint], n_dof: int) -> tuple[ContactPairs, np.ndarray]:
    """Return the pairs of joints by DOFs, and those, (n_pairs, 6): x, y, z of body 1, x, y, z of body 2; -1 is ground."""
    tables, names, separate, laws, of_laws = [np.empty((0, len(COLUMNS)))], [], [], [], []
    for joint in joints:
        path = joint.file_of("pairs")
        if path is None:
            raise ValueError(f"joint {joint.name!r} is no joint of DOFs")
        table = read_pairs(path, n_dof, joint.law)
        tables.append(table)
        names += [joint.name] * len(table)
        separate += [joint.is_separate] * len(table)
        laws += [joint.law] * len(table)
        of_laws.append((len(table), columns_of_joint(joint.law, joint.values_of_law, len(table))))
    table = np.concatenate(tables)
    n, (mu, n0, g0, k_t, k_n) = len(table), table[:, 6:].T
    pairs = ContactPairs(
        joint=tuple(names),
        node1=np.full(n, -1),
        node2=np.full(n, -1),
        position=np.full((n, 3), np.nan),
        frame=np.tile(np.eye(3), (n, 1, 1)),
        area=np.full(n, np.nan),
        mu=mu,
        N0=np.where(g0 > 0.0, -k_n * g0, n0),
        k_t=k_t,
        k_n=k_n,
        separate=np.array(separate, dtype=bool),
        faces=(),
        laws=np.array(laws, dtype=str),
        law_columns=joined(of_laws),
    )
    return pairs, table[:, :6].astype(int)


def _load_map(loads: Sequence[Load], n_dof: int, places: Places | None) -> sp.csc_matrix:
    """Return one column per real shape of the loads: a scale at a DOF, a force on nodes, or the forces of a file."""
    columns = []
    for i, load in enumerate(loads, 1):
        path = load.file_of("forces")
        on_nodes = load.dof is None if path is None else places is not None and names_nodes(path)
        if on_nodes and places is not None:
            columns.append(places.of_load(load, f"[[loads]] {i}").T.tocsc())
            continue
        dofs, forces = ([load.dof], np.array([load.scale + 0j])) if path is None else forces_on_dofs(path, n_dof)
        at = dofs, np.zeros(len(dofs), dtype=int)
        columns += [sp.csc_matrix((part, at), (n_dof, 1)) for part in (forces.real, forces.imag)[: len(load.phases)]]
    return sp.hstack(columns, format="csc") if columns else sp.csc_matrix((n_dof, 0))


def _output_map(outputs: Sequence[Output], n_dof: int, places: Places | None) -> sp.csr_matrix:
    """Return one row an output, an empty one of a contact force.  Local."""
    rows = []
    for i, output in enumerate(outputs, 1):
        if output.dof is not None:
            rows.append(sp.csr_matrix(([1.0], ([0], [output.dof])), (1, n_dof)))
        elif output.joint is not None or places is None:
            rows.append(sp.csr_matrix((1, n_dof)))
        else:
            rows.append(places.of_output(output, f"[[outputs]] {i} ({output.name!r})"))
    return sp.vstack(rows).tocsr() if rows else sp.csr_matrix((0, n_dof))


# -- on all ranks ----------------------------------------------------------------------------------------------


def distribute_structure(given: GivenStructure | None, tables: StructureTables, comm: MPI.Comm) -> tuple[System, ContactPairs]:
    """Return the system with the rows of its matrices split evenly over the ranks, and the pairs.

    Collective on ``comm``.  ``given`` on rank 0, None elsewhere; a rank may get no row.
    """
    here = given is not None
    small = None
    if given is not None:
        small = given.pairs, given.R, given.loads, given.outputs, _nodes_of(given), given.C is not None
    pairs, R, loads, outputs, dof, has_damping = comm.bcast(small)
    K, M = (_distribute(getattr(given, name, None), comm) for name in "KM")
    C = _distribute(given.C if here else None, comm) if has_damping else None
    part, names = comm.bcast(_connected(given.K) if here else None)
    first, last = K.getOwnershipRange()
    return System(
        comm=comm,
        K=K,
        M=M,
        C=C,
        R=R,
        loads=loads,
        outputs=outputs,
        dof=dof,
        parts=part[first:last],
        part_names=names,
        split_by="rows split evenly",
        output_orders=orders_of(tables.outputs),
    ), pairs


def _nodes_of(given: GivenStructure) -> np.ndarray | None:
    """Return the rows of the nodes of a mesh that fields can be drawn on, (n_nodes, 3); None where there is none."""
    places = given.places
    if places is None or not places.mesh.elements or places.expand.shape[0] > given.n_dof:
        return None
    return places.dof


def _pair_map(dofs: np.ndarray, n_dof: int) -> sp.csr_matrix:
    """Return R: the DOF of body 1 minus that of body 2, ground drops out.  Local."""
    rows = np.arange(3 * len(dofs)).reshape(-1, 3)
    R = sp.csr_matrix((3 * len(dofs), n_dof))
    for side, sign in ((dofs[:, :3], 1.0), (dofs[:, 3:], -1.0)):
        is_free = side != GROUND
        R = R + sp.csr_matrix((np.full(is_free.sum(), sign), (rows[is_free], side[is_free])), R.shape)
    return R.tocsr()


def _connected(K: sp.csr_matrix) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the connected part of each DOF, and the name of each part.  Local."""
    _, part = scipy.sparse.csgraph.connected_components(K, directed=False)
    _, first, counts = np.unique(part, return_index=True, return_counts=True)
    return part, tuple(
        f"DOF {dof}" if n == 1 else f"the part of {counted(n, 'DOF')} with DOF {dof}" for dof, n in zip(first, counts)
    )


def _distribute(matrix: sp.csr_matrix | None, comm: MPI.Comm) -> PETSc.Mat:
    """Return rank 0's matrix as a PETSc matrix, rows split evenly.  Collective: three scatters."""
    here = matrix is not None
    n_dof = comm.bcast(matrix.shape[0] if here else None)
    limits = split_evenly(n_dof, comm.size)
    n_entries = comm.bcast(np.diff(matrix.indptr[limits]) if here else None)
    n_in_row = _scatter(np.diff(matrix.indptr) if here else None, np.diff(limits), PETSc.IntType, comm)
    indices = _scatter(matrix.indices if here else None, n_entries, PETSc.IntType, comm)
    data = _scatter(matrix.data if here else None, n_entries, float, comm)
    csr = (np.concatenate([[0], np.cumsum(n_in_row)]).astype(PETSc.IntType), indices, data)
    A = PETSc.Mat().createAIJ(((len(n_in_row), n_dof), (len(n_in_row), n_dof)), csr=csr, comm=comm)
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return A


def _scatter(values: np.ndarray | None, counts: np.ndarray, kind: type, comm: MPI.Comm) -> np.ndarray:
    """Return this rank's ``counts[rank]`` of rank 0's values.  Collective."""
    part: np.ndarray = np.empty(counts[comm.rank], dtype=kind)
    comm.Scatterv(None if values is None else [np.ascontiguousarray(values, dtype=kind), counts], part)
    return part
