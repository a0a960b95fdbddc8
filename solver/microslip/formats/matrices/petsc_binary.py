"""PETSc's binary matrix files: AIJ and dense, 32-bit or 64-bit indices, 64-bit real numbers."""

import numpy as np
import scipy.sparse as sp

from ...messages.errors import CaseError
from .file_matrix import FileMatrix, Wanted

_MATRIX = 1211216  # first number of a matrix file
_DENSE = -1
_OBJECTS = set(range(1211214, 1211224))  # first numbers of the objects in a file: vectors, matrices, index sets, ...


def is_petsc(head: bytes) -> bool:
    """Return whether a file begins as a PETSc matrix.  Local."""
    return _MATRIX in (int.from_bytes(head[:4], "big"), int.from_bytes(head[:8], "big"))


def read_petsc(wanted: Wanted) -> FileMatrix:
    """Return the first matrix of a file.  Local.  Raises CaseError: the file is faulty."""
    data = np.memmap(wanted.path, dtype=np.uint8, mode="r") if wanted.size else np.empty(0, dtype=np.uint8)
    if not is_petsc(bytes(data[:8])):
        raise CaseError(f"{wanted.where} is not a matrix of PETSc")
    index = np.dtype(">i4" if int.from_bytes(bytes(data[:4]), "big") == _MATRIX else ">i8")
    if len(data) < 4 * index.itemsize:
        raise wanted.error("it is truncated")
    _, n_rows, n_columns, n = (int(number) for number in data[: 4 * index.itemsize].view(index))
    start = 4 * index.itemsize
    if n == _DENSE:
        wanted.check_entries(n_rows * n_columns, 8.0)
        _check_length(data, start, n_rows * n_columns, wanted)
        return FileMatrix(_part(data, start, n_rows * n_columns, np.dtype(">f8")).astype(float).reshape(n_rows, n_columns))
    wanted.check_entries(n, index.itemsize + 8.0)
    wanted.check_entries(n_rows, index.itemsize)
    wanted.check_rows(n_columns)
    _check_length(data, start + index.itemsize * (n_rows + n), n, wanted)
    counts = _part(data, start, n_rows, index).astype(np.int64)
    columns = _part(data, start + index.itemsize * n_rows, n, index).astype(np.int64)
    values = _part(data, start + index.itemsize * (n_rows + n), n, np.dtype(">f8")).astype(float)
    if (counts < 0).any() or counts.sum() != n or n and (columns.min() < 0 or columns.max() >= n_columns):
        raise wanted.error("its rows do not have the number of entries stated by its header")
    return FileMatrix(sp.csr_matrix((values, columns, np.concatenate([[0], np.cumsum(counts)])), (n_rows, n_columns)))


def _part(data: np.ndarray, start: int, n: int, kind: np.dtype) -> np.ndarray:
    return data[start : start + n * kind.itemsize].view(kind)


def _check_length(data: np.ndarray, start: int, n: int, wanted: Wanted) -> None:
    """Raise CaseError if a file is too short for ``n`` numbers from byte ``start`` on, or has the length of complex ones.

    A file of that length is taken as real if another object of PETSc follows the numbers.
    """
    end = start + 8 * n
    if wanted.size < end:
        raise wanted.error(f"it is truncated: {end} bytes are needed, and it has {wanted.size}")
    following = bytes(data[end : end + 8])
    if n and wanted.size == end + 8 * n and not _OBJECTS & {int.from_bytes(following[:size], "big") for size in (4, 8)}:
        raise wanted.error("its numbers are complex; microslip takes real matrices")
