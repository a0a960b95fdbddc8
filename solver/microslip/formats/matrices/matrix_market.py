"""Matrix Market: a header, then entries as coordinates or column by column."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...messages.errors import CaseError
from .file_matrix import FileMatrix, Wanted, from_coordinates
from .text import table_of

_COLUMNS = {"real": 1, "double": 1, "integer": 1, "complex": 2}
_SYMMETRIES = ("general", "symmetric", "skew-symmetric", "hermitian")


def read_matrix_market(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file.  Local.

    Raises
    ------
    CaseError, ResourceError : the file is at fault, or larger than memory
    """
    with open(wanted.path, "rb") as file:
        words = file.readline(200).decode("latin-1").lower().split()
        form, kind, symmetry = _header(words, wanted)
        line = file.readline(4096)
        while line.startswith(b"%") or (line and not line.strip()):
            line = file.readline(4096)
        sizes = line.split()
        n_sizes = 3 if form == "coordinate" else 2
        if len(sizes) != n_sizes or not all(size.isdigit() for size in sizes):
            raise wanted.error(f"the line of its size is not {n_sizes} whole numbers")
        counts = [int(size) for size in sizes]
        read = _coordinates if form == "coordinate" else _columns
        matrix = read(file, counts, _COLUMNS[kind], symmetry, wanted)
    if symmetry == "skew-symmetric":
        raise CaseError(f"{wanted.where} is skew-symmetric; microslip takes symmetric matrices")
    return FileMatrix(matrix, is_triangle=symmetry != "general")


def _header(words: list[str], wanted: Wanted) -> tuple[str, str, str]:
    """Return form, kind and symmetry; CaseError unless a file begins as a Matrix Market file with numbers does."""
    if words[:2] != ["%%matrixmarket", "matrix"]:
        raise CaseError(f"{wanted.where} is not a Matrix Market file; its first line must begin with %%MatrixMarket matrix")
    if "pattern" in words:
        raise CaseError(f"{wanted.where} is a pattern without numbers")
    if len(words) != 5 or words[2] not in ("coordinate", "array") or words[3] not in _COLUMNS or words[4] not in _SYMMETRIES:
        raise wanted.error(f"its first line says '{' '.join(words[2:])}'")
    return words[2], words[3], words[4]


def _coordinates(file, counts: list[int], n_values: int, symmetry: str, wanted: Wanted) -> sp.csr_matrix:
    """Return the matrix of lines with row, column and value, from 1."""
    n_rows, n_columns, n = counts
    wanted.check_entries(n, 5.0)
    wanted.check_rows(max(n_rows, n_columns))
    table = table_of(file, 2 + n_values, wanted)
    if len(table) != n:
        raise wanted.error(f"its header says {n} entries, and it has {len(table)}")
    values = table[:, 2] if n_values == 1 else table[:, 2] + 1j * table[:, 3]
    return from_coordinates(
        table[:, 0].astype(np.int64) - 1, table[:, 1].astype(np.int64) - 1, values, (n_rows, n_columns), wanted
    )


def _columns(file, counts: list[int], n_values: int, symmetry: str, wanted: Wanted) -> np.ndarray:
    """Return the matrix of values column by column, of the lower triangle where it is symmetric."""
    n_rows, n_columns = counts
    n = n_rows * n_columns if symmetry == "general" else n_rows * (n_rows + 1) // 2
    wanted.check_entries(n, 2.0 * n_values - 0.5)
    if symmetry != "general":
        wanted.check_entries(n_rows * n_rows, 0.5)
    table = table_of(file, n_values, wanted)
    if len(table) != n:
        raise wanted.error(f"its header says {n} entries, and it has {len(table)}")
    values = table[:, 0] if n_values == 1 else table[:, 0] + 1j * table[:, 1]
    if symmetry == "general":
        return values.reshape(n_columns, n_rows).T
    full = np.zeros((n_rows, n_rows), dtype=values.dtype)
    full.T[np.triu_indices(n_rows)] = values
    return full
