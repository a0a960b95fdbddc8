"""Archives of NumPy, .npz: of scipy.sparse.save_npz or numpy.savez.  Objects are never unpickled."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp

from ...messages.errors import CaseError
from .file_matrix import FileMatrix, Wanted, from_coordinates

_MOST_DEFLATED = 1040  # bytes that one byte of an archive can stand for


def read_npz(wanted: Wanted) -> FileMatrix:
    """Return the matrix of an archive, or of several the one that is wanted.  Local.

    Raises
    ------
    CaseError, ResourceError : the file is at fault, or larger than memory
    """
    if not zipfile.is_zipfile(wanted.path):
        raise CaseError(f"{wanted.where} is not a file of scipy.sparse.save_npz or numpy.savez")
    _check_claims(wanted)
    with np.load(wanted.path, allow_pickle=False) as arrays:
        if "format" not in arrays:  # of scipy.sparse.save_npz
            return FileMatrix(arrays[wanted.choose(arrays.files)])
        return FileMatrix(_sparse(arrays, wanted))


def _sparse(arrays: Mapping[str, np.ndarray], wanted: Wanted) -> sp.spmatrix:
    """Return the matrix of an archive of SciPy, whose own conversions believe every index and crash."""
    shape, form = arrays["shape"], arrays["format"]
    if shape.dtype.kind not in "iu" or shape.shape != (2,) or shape.min() < 0:
        raise wanted.error("its shape is not two whole numbers")
    n_rows, n_columns = (int(length) for length in shape)
    wanted.check_rows(max(n_rows, n_columns))
    word = form.item() if form.shape == () else b""
    word = word.decode("ascii", "replace") if isinstance(word, bytes) else str(word)
    if word in ("csr", "csc"):
        return _compressed(arrays, (n_rows, n_columns), word, wanted)
    if word == "bsr":
        rows, columns, values = _blocks(arrays, n_rows, wanted)
    elif word == "coo":
        rows, columns, values = _whole(arrays, "row", wanted), _whole(arrays, "col", wanted), arrays["data"]
    elif word == "dia":
        rows, columns, values = _diagonals(arrays, n_rows, n_columns, wanted)
    else:
        raise wanted.error(f"it is of the form {word[:20]!r}; csr, csc, coo, bsr and dia are read")
    if not len(rows) == len(columns) == len(values) or values.ndim != 1:
        raise wanted.error(f"it has {len(rows)} rows, {len(columns)} columns and {values.shape} values")
    return from_coordinates(rows, columns, values, (n_rows, n_columns), wanted)


def _whole(arrays: Mapping[str, np.ndarray], name: str, wanted: Wanted) -> np.ndarray:
    """Return a row of whole numbers."""
    found = arrays[name]
    if found.dtype.kind not in "iu" or found.ndim != 1:
        raise wanted.error(f"its {name} is no row of whole numbers")
    return found.astype(np.int64)


def _compressed(arrays: Mapping[str, np.ndarray], shape: tuple[int, int], form: str, wanted: Wanted) -> sp.spmatrix:
    """Return a matrix of compressed rows or columns."""
    starts, across, values = _whole(arrays, "indptr", wanted), _whole(arrays, "indices", wanted), arrays["data"]
    n, n_across = shape if form == "csr" else shape[::-1]
    _check_starts(starts, n, across, values, wanted)
    if values.ndim != 1 or len(across) and not 0 <= across.min() <= across.max() < n_across:
        raise wanted.error("row or column index exceeds matrix dimensions")
    return (sp.csr_matrix if form == "csr" else sp.csc_matrix)((values, across, starts), shape)


def _check_starts(starts: np.ndarray, n: int, across: np.ndarray, values: np.ndarray, wanted: Wanted) -> None:
    """Raise CaseError unless the entries of ``n`` rows begin and end where there are entries."""
    if len(starts) != n + 1 or starts[0] != 0 or (np.diff(starts) < 0).any() or not starts[-1] == len(across) == len(values):
        raise wanted.error("its rows or columns do not have the entries that they say")


def _blocks(arrays: Mapping[str, np.ndarray], n_rows: int, wanted: Wanted) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and values of compressed rows of blocks."""
    starts, across, values = _whole(arrays, "indptr", wanted), _whole(arrays, "indices", wanted), arrays["data"]
    if values.ndim != 3 or 0 in values.shape[1:] or n_rows % values.shape[1]:
        raise wanted.error(f"its blocks have the shape {values.shape}")
    high, wide = values.shape[1:]
    _check_starts(starts, n_rows // high, across, values, wanted)
    along = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    rows = along[:, None, None] * high + np.arange(high)[:, None]
    columns = across[:, None, None] * wide + np.arange(wide)
    return tuple(np.broadcast_to(part, values.shape).ravel() for part in (rows, columns, values))  # type: ignore[return-value]


def _diagonals(
    arrays: Mapping[str, np.ndarray], n_rows: int, n_columns: int, wanted: Wanted
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and values of diagonals, each with a value for every column."""
    offsets, values = _whole(arrays, "offsets", wanted), arrays["data"]
    if values.ndim != 2 or len(values) != len(offsets):
        raise wanted.error(f"it has {len(offsets)} diagonals and values of the shape {values.shape}")
    columns = np.broadcast_to(np.arange(values.shape[1]), values.shape)
    rows = columns - offsets[:, None]
    is_inside = (rows >= 0) & (rows < n_rows) & (columns < n_columns)
    return rows[is_inside], columns[is_inside], values[is_inside]


def _check_claims(wanted: Wanted) -> None:
    """Raise unless the arrays are as large as their headers say."""
    with zipfile.ZipFile(wanted.path) as archive:
        for member in archive.infolist():
            if member.file_size > _MOST_DEFLATED * wanted.size:
                raise wanted.error(f"{member.filename} claims {member.file_size} bytes in a file of {wanted.size}")
            with archive.open(member) as file:
                version = np.lib.format.read_magic(file)
                read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, _, kind = read(file)
            if kind.itemsize < 0 or not kind.hasobject and int(np.prod(shape, dtype=object)) * kind.itemsize > member.file_size:
                raise wanted.error(f"{member.filename} is truncated: its header asks for an array of shape {shape}")
