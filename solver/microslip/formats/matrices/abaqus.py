"""Abaqus, *MATRIX GENERATE and *MATRIX OUTPUT: job_STIF1.mtx, by nodes and degrees of freedom, or by rows."""

import re

import numpy as np

from ...messages.words import counted, verb
from .file_matrix import LARGEST, DofMap, FileMatrix, Wanted, from_coordinates
from .text import square_of, table_of

_FIXED = 1e36  # diagonal entry of a DOF held by *BOUNDARY
_ABAQUS_NAME = re.compile(r"_(STIF|MASS|DMPV|DMPS|X\d+)\d+\.mtx$", re.IGNORECASE)


def is_abaqus(wanted: Wanted, head: bytes) -> bool:
    """Return whether a file .mtx is from Abaqus: by lines of five numbers, keyword or name.  Local."""
    if head.startswith(b"%%"):
        return False
    lines = [line for line in head.splitlines() if line.strip()]
    is_labelled = bool(lines) and len(lines[0].replace(b",", b" ").split()) == 5
    return is_labelled or head.lstrip().startswith(b"*") or _ABAQUS_NAME.search(wanted.path.name) is not None


def read_abaqus(wanted: Wanted) -> FileMatrix:
    """Return the matrix of lines node, dof, node, dof, value (MATRIX INPUT, LABELS) or row, column, value (COORDINATE).

    Local.  DOFs held by boundary conditions, 1e36 on the diagonal, are left out; negative numbers are internal nodes.

    Raises
    ------
    CaseError : the file is faulty
    """
    with open(wanted.path, "rb") as file:
        position, line = 0, file.readline(4096)
        while line.startswith((b"*", b"%")) or (line and not line.strip()):
            position, line = file.tell(), file.readline(4096)
        n_columns = len(line.replace(b",", b" ").split())
        if n_columns not in (3, 5):
            raise wanted.error("its lines are neither node, dof, node, dof, value nor row, column, value")
        file.seek(position)
        table = table_of(file, n_columns, wanted, has_no_count=True)
    if not (abs(table[:, :-1]) < LARGEST).all() or (table[:, :-1] % 1.0).any():
        raise wanted.error("nodes and degrees of freedom must be whole numbers")
    if n_columns == 5:
        return _labelled(table, wanted)
    matrix = square_of(table, wanted)
    return FileMatrix(matrix, is_triangle=_is_triangle(matrix))


def _labelled(table: np.ndarray, wanted: Wanted) -> FileMatrix:
    places = table[:, :4].astype(np.int64)
    wrong = (places[:, [1, 3]] < 0) | (places[:, [1, 3]] > 7)
    if wrong.any():
        raise wanted.error(f"it has a degree of freedom {places[:, [1, 3]][wrong][0]}; 1 to 7 are known")
    first, second = (8 * places[:, i] + places[:, i + 1] for i in (0, 2))
    keys, at = np.unique(np.concatenate([first, second]), return_inverse=True)
    rows, columns = at[: len(first)], at[len(first) :]
    dofs = DofMap(keys // 8, keys % 8)
    n, values = len(keys), table[:, 4]
    is_fixed = np.zeros(n, dtype=bool)
    is_fixed[rows[(rows == columns) & (values >= _FIXED)]] = True
    matrix = from_coordinates(rows, columns, values, (n, n), wanted)
    notes = []
    if n := int(is_fixed.sum()):
        free = np.flatnonzero(~is_fixed)
        matrix, dofs = matrix[free][:, free], dofs[free]
        notes.append(f"{wanted.path.name}: {counted(n, 'DOF')} {verb(n, 'are')} held by boundary conditions and left out")
    if n := int((dofs.nodes < 0).sum()):
        notes.append(f"{wanted.path.name}: {counted(n, 'DOF')} {verb(n, 'belong')} to internal nodes of Abaqus")
    return FileMatrix(matrix, dofs, is_triangle=_is_triangle(matrix), notes=tuple(notes))


def _is_triangle(matrix) -> bool:
    """Return whether all entries lie on one side of the diagonal: Abaqus writes one triangle of a symmetric matrix."""
    entries = matrix.tocoo()
    below, above = (entries.row > entries.col).any(), (entries.row < entries.col).any()
    if not (below and above):
        return True
    pattern = (matrix != 0).astype(np.int8)
    return bool((pattern.multiply(pattern.T)).nnz == (matrix.diagonal() != 0).sum())
