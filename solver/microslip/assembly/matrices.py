"""A structure given as matrices by the user: K, M and optionally C, pairs by DOF numbers, loads and outputs by DOF.

DOF numbers count from 0 and are the rows of the matrices.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp
import scipy.sparse.csgraph
from petsc4py import PETSc

from ..mesh.data import ContactPairs
from ..parallel.agree import on_root
from ..parallel.errors import CaseError
from .system import System

ENDINGS = (".mtx", ".npz", ".mat")
COLUMNS = ("x1", "y1", "z1", "x2", "y2", "z2", "mu", "n0", "g0", "kt", "kn")
_SYMMETRY = 1e-8        # of the largest entry: what a text file may lose


def read_structure(scene, comm) -> tuple[System, ContactPairs]:
    """Return the structure of a scene given as matrices, rows split evenly over the ranks.

    Collective on ``comm``.  Rank 0 reads.

    Raises
    ------
    CaseError : a file, a matrix or a DOF number is at fault; on every rank
    """
    matrices, pairs, dofs = on_root(comm, _read_all, scene, share=False) or (None, None, None)
    pairs, dofs = comm.bcast((pairs, dofs))
    matrices = matrices or {}
    K, M, C = (_distribute(matrices.get(name), comm) for name in ("stiffness", "mass", "damping"))
    n_dof, (first, last) = K.getSize()[0], K.getOwnershipRange()
    part, names = comm.bcast(_connected(matrices["stiffness"]) if comm.rank == 0 else None)
    return System(
        comm=comm, K=K, M=M, C=C, R=_pair_map(dofs, n_dof), loads=_load_map(scene.loads, n_dof),
        outputs=_output_map(scene.outputs, n_dof), dof=None, parts=part[first:last], part_names=names,
    ), pairs


# -- files -----------------------------------------------------------------------------------------------------


def _read_all(scene):
    """Read and check everything on rank 0: matrices by key, pairs, DOFs of the pairs (n_pairs, 6)."""
    named = {key: getattr(scene.model, key) for key in ("stiffness", "mass", "damping")}
    matrices = {key: read_matrix(scene.folder / file, f"[model] {key}") for key, file in named.items() if file is not None}
    n_dof = matrices["stiffness"].shape[0]
    for key, matrix in matrices.items():
        if matrix.shape != (n_dof, n_dof):
            raise CaseError(f"{named[key]}: [model] {key} is {matrix.shape[0]} x {matrix.shape[1]}, the stiffness {n_dof} x {n_dof}")
    if (matrices["mass"].diagonal() <= 0.0).any():
        row = int(np.argmin(matrices["mass"].diagonal()))
        raise CaseError(f"{named['mass']}: DOF {row} has mass {matrices['mass'].diagonal()[row]:g}; every DOF needs a positive mass: "
                        "condense those without, or give them a small one")
    for kind, entries in (("loads", scene.loads), ("outputs", scene.outputs)):
        for i, entry in enumerate(entries, 1):
            if entry.dof is None:
                raise CaseError(f"[[{kind}]] {i}: a scene given as matrices has no nodes; name a dof (0 to {n_dof - 1})")
            if not 0 <= entry.dof < n_dof:
                raise CaseError(f"[[{kind}]] {i}: dof = {entry.dof} is not one of 0 to {n_dof - 1}")
    return matrices, *_read_joints(scene, n_dof)


def read_matrix(path: Path, key: str) -> sp.csr_matrix:
    """Return a real symmetric sparse matrix from Matrix Market, .npz (scipy.sparse) or .mat.  Local.

    A damping matrix may be unsymmetric by no more than rounding either: gyroscopic terms are not modelled.
    """
    try:
        matrix = sp.csr_matrix(_load(path, key))
    except CaseError:
        raise
    except Exception as problem:            # whatever a reader makes of a damaged file
        raise CaseError(f"{path}: {key} cannot be read as a matrix: {problem}") from None
    if np.iscomplexobj(matrix):
        raise CaseError(f"{path}: {key} is complex; microslip takes real matrices, damping goes into [model] damping or [damping]")
    matrix = matrix.astype(float)
    matrix.sum_duplicates()
    if matrix.shape[0] != matrix.shape[1]:
        raise CaseError(f"{path}: {key} is {matrix.shape[0]} x {matrix.shape[1]}; it must be square")
    if not np.isfinite(matrix.data).all():
        row = int(np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))[~np.isfinite(matrix.data)][0])
        raise CaseError(f"{path}: {key} has an entry in row {row} that is not a finite number")
    skew = abs(matrix - matrix.T)
    if skew.nnz and skew.max() > _SYMMETRY * abs(matrix).max():
        raise CaseError(f"{path}: {key} is not symmetric: entries differ from their mirror image by up to {skew.max():.3g} "
                        "(a file with one triangle only must say 'symmetric' in its header)")
    return ((matrix + matrix.T) / 2.0).tocsr()


def _load(path: Path, key: str):
    if not path.is_file():
        raise CaseError(f"{path}: {key}: there is no such file")
    if path.suffix == ".mtx":
        return scipy.io.mmread(path)
    if path.suffix == ".npz":
        return sp.load_npz(path)
    if path.suffix == ".mat":
        found = {name: value for name, value in scipy.io.loadmat(path).items() if not name.startswith("__")}
        if len(found) != 1:
            raise CaseError(f"{path}: {key} needs a file with one variable, this one has {', '.join(sorted(found)) or 'none'}")
        return next(iter(found.values()))
    raise CaseError(f"{path}: {key}: ending {path.suffix!r} is not one of {', '.join(ENDINGS)}")


def _read_joints(scene, n_dof: int) -> tuple[ContactPairs, np.ndarray]:
    """Return the pairs of all joints and their DOFs, (n_pairs, 6)."""
    tables, names, separate = [np.empty((0, len(COLUMNS)))], [], []
    for joint in scene.joints:
        if joint.pairs is None:
            raise CaseError(f"[[joints]] {joint.name!r}: a scene given as matrices has no surfaces; give pairs = \"….csv\"")
        table = read_pairs(scene.folder / joint.pairs, n_dof)
        tables.append(table)
        names += [joint.name] * len(table)
        separate += [joint.friction_limit == "separate"] * len(table)
    table = np.concatenate(tables)
    n, (mu, n0, g0, k_t, k_n) = len(table), table[:, 6:].T
    return ContactPairs(
        joint=tuple(names), node1=np.full(n, -1), node2=np.full(n, -1), position=np.full((n, 3), np.nan),
        frame=np.tile(np.eye(3), (n, 1, 1)), area=np.ones(n), mu=mu, N0=np.where(g0 > 0.0, -k_n * g0, n0), k_t=k_t, k_n=k_n,
        separate=np.array(separate, dtype=bool), faces=(),
    ), table[:, :6].astype(int)


def read_pairs(path: Path, n_dof: int) -> np.ndarray:
    """Return the table of a pairs file, (n_pairs, 11) in the order of ``COLUMNS``.  Local."""
    if not path.is_file():
        raise CaseError(f"{path}: there is no such file of contact pairs")
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except (UnicodeDecodeError, csv.Error) as problem:
        raise CaseError(f"{path}: not a text file of comma-separated values: {problem}") from None
    header = tuple(cell.strip().lower() for cell in rows[0]) if rows else ()
    if set(header) != set(COLUMNS):
        raise CaseError(f"{path}: the first line must name the columns {','.join(COLUMNS)}; it is {','.join(header) or 'missing'}")
    order = [header.index(name) for name in COLUMNS]
    table = np.array([_numbers(row, order, f"{path}, line {line}") for line, row in enumerate(rows[1:], 2)])
    table = table.reshape(-1, len(COLUMNS))
    for line, row in enumerate(table, 2):
        _check_pair(row, n_dof, f"{path}, line {line}")
    return table


def _numbers(row: list[str], order: list[int], where: str) -> list[float]:
    if len(row) != len(COLUMNS):
        raise CaseError(f"{where}: {len(row)} values, {len(COLUMNS)} are needed")
    try:
        return [float(row[i]) for i in order]
    except ValueError as problem:
        raise CaseError(f"{where}: {problem}") from None


def _check_pair(row: np.ndarray, n_dof: int, where: str) -> None:
    if not np.isfinite(row).all():
        raise CaseError(f"{where}: every value must be a finite number")
    dofs = row[:6]
    for name, dof in zip(COLUMNS, dofs):
        if dof != int(dof) or not -1 <= dof < n_dof:
            raise CaseError(f"{where}: {name} = {dof:g} is not a DOF number; 0 to {n_dof - 1}, or -1 for ground")
    if (dofs == -1).all():
        raise CaseError(f"{where}: the pair joins ground to ground")
    for first, second, name in zip(dofs[:3], dofs[3:], "xyz"):
        if first == second != -1:
            raise CaseError(f"{where}: {name}1 and {name}2 are the same DOF {first:g}; the pair would join it to itself")
    for name, value in zip(COLUMNS[6:], row[6:]):
        if value < 0.0 and name != "n0":
            raise CaseError(f"{where}: {name} = {value:g} must not be negative")
    if row[COLUMNS.index("g0")] > 0.0 and row[COLUMNS.index("n0")] != 0.0:
        raise CaseError(f"{where}: a pair has either a preload n0 or a gap g0, not both")


# -- maps and matrices -----------------------------------------------------------------------------------------


def _pair_map(dofs: np.ndarray, n_dof: int) -> sp.csr_matrix:
    """Return R: the DOF of body 1 minus that of body 2, ground drops out.  Local."""
    rows = np.arange(3 * len(dofs)).reshape(-1, 3)
    R = sp.csr_matrix((3 * len(dofs), n_dof))
    for own, sign in ((dofs[:, :3], 1.0), (dofs[:, 3:], -1.0)):
        free = own >= 0
        R = R + sp.csr_matrix((np.full(free.sum(), sign), (rows[free], own[free])), R.shape)
    return R.tocsr()


def _load_map(loads, n_dof: int) -> sp.csc_matrix:
    """Return one column a load, its scale at its DOF.  Local."""
    values = ([load.scale for load in loads], ([load.dof for load in loads], range(len(loads))))
    return sp.csc_matrix(values, (n_dof, len(loads)), dtype=float)


def _output_map(outputs, n_dof: int) -> sp.csr_matrix:
    """Return one row an output.  Local."""
    values = (np.ones(len(outputs)), (range(len(outputs)), [output.dof for output in outputs]))
    return sp.csr_matrix(values, (len(outputs), n_dof))


def _connected(K: sp.csr_matrix) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the connected part of each DOF and what to call each part.  Local."""
    n, part = scipy.sparse.csgraph.connected_components(K, directed=False)
    names = []
    for number in range(n):
        members = np.flatnonzero(part == number)
        names.append(f"the {len(members)} DOFs connected to DOF {members[0]}")
    return part, tuple(names)


def _distribute(matrix: sp.csr_matrix | None, comm):
    """Return a PETSc matrix of rank 0's matrix, rows split evenly; None where no rank has one.  Collective."""
    n_dof = comm.bcast(None if matrix is None else matrix.shape[0])
    if n_dof is None:
        return None
    limits = [n_dof * rank // comm.size for rank in range(comm.size + 1)]
    shares = [matrix[a:b] for a, b in zip(limits, limits[1:])] if comm.rank == 0 else None
    own = comm.scatter(shares)
    n_own = own.shape[0]
    indices = (own.indptr.astype(PETSc.IntType), own.indices.astype(PETSc.IntType), own.data)
    A = PETSc.Mat().createAIJ(((n_own, n_dof), (n_own, n_dof)), csr=indices, comm=comm)
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return A
