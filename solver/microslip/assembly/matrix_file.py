"""Read a matrix that another program wrote: Matrix Market, .npz or .mat.  Local; NumPy and SciPy only."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp

from ..parallel.errors import CaseError, ResourceError

ENDINGS = (".mtx", ".npz", ".mat")
_SYMMETRY = 1e-8  # of the largest entry: what a text file may lose


def read_matrix(path: Path, key: str, symbol: str) -> sp.csr_matrix:
    """Return a real symmetric matrix (n, n).

    Local.

    Parameters
    ----------
    key : of the scene, for messages
    symbol : the variable's name in a file of several

    Raises
    ------
    CaseError : the file or the matrix is at fault
    ResourceError : not enough memory
    """
    where = f"{path}: {key}"
    try:
        value = _load(path, where, symbol)
        _check_sort(value, where)
        matrix = sp.csr_matrix(value)
    except CaseError:
        raise
    except MemoryError:
        raise ResourceError(f"{where}: not enough memory to read it") from None
    except Exception as problem:  # whatever a reader makes of a damaged file
        raise CaseError(f"{where} cannot be read as a matrix: {' '.join(str(problem).split())[:200]}") from None
    matrix = matrix.astype(float)
    matrix.sum_duplicates()
    _check_numbers(matrix, where)
    _check_symmetry(matrix, where)
    return ((matrix + matrix.T) / 2.0).tocsr()


def _load(path: Path, where: str, symbol: str):
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise CaseError(f"{where}: ending {path.suffix!r} is not one of {', '.join(ENDINGS)}")
    if ending == ".mtx":
        _check_header(path, where)
        return scipy.io.mmread(path)
    if ending == ".mat":
        found = {name: value for name, value in scipy.io.loadmat(path).items() if not name.startswith("__")}
        return _variable(found, where, symbol)
    if not zipfile.is_zipfile(path):
        raise CaseError(f"{where} is not a file of scipy.sparse.save_npz or numpy.savez")
    with np.load(path, allow_pickle=False) as arrays:
        if "format" not in arrays:  # of scipy.sparse.save_npz
            return _variable(dict(arrays), where, symbol)
    return sp.load_npz(path)


def _variable(found: dict, where: str, symbol: str):
    """Return the one variable of a file, or of several the one named like the matrix."""
    value = next(iter(found.values())) if len(found) == 1 else found.get(symbol)
    if value is None:
        raise CaseError(
            f"{where} needs a file with one variable, or with one named {symbol}; this one has "
            f"{', '.join(sorted(found)) or 'none'}"
        )
    return value


def _check_header(path: Path, where: str) -> None:
    """Raise CaseError unless a file begins as a Matrix Market file with numbers does."""
    with open(path, "rb") as file:
        words = file.readline(200).decode("latin-1").lower().split()
    if words[:2] != ["%%matrixmarket", "matrix"]:
        raise CaseError(f"{where} is not a Matrix Market file; its first line must begin with %%MatrixMarket matrix")
    if "pattern" in words:
        raise CaseError(f"{where} is a pattern without numbers")


def _check_sort(value, where: str) -> None:
    """Raise CaseError unless a file held a table of real numbers, square and not empty."""
    kind = getattr(value, "dtype", np.dtype(object)).kind
    shape: tuple[int, ...] = getattr(value, "shape", ())
    if kind == "c":
        raise CaseError(f"{where} is complex; microslip takes real matrices: damping goes into [model] damping or [damping]")
    if kind not in "biuf":
        raise CaseError(f"{where} holds no numbers")
    if len(shape) != 2 or shape[0] != shape[1] or shape[0] == 0:
        raise CaseError(f"{where} has the shape {tuple(shape)}; a matrix must be square")


def _check_numbers(matrix: sp.csr_matrix, where: str) -> None:
    """Raise CaseError unless all entries are finite."""
    if not np.isfinite(matrix.data).all():
        row = np.searchsorted(matrix.indptr, np.flatnonzero(~np.isfinite(matrix.data))[0], side="right") - 1
        raise CaseError(f"{where} has an entry in row {row} that is not a finite number (rows count from 0)")


def _check_symmetry(matrix: sp.csr_matrix, where: str) -> None:
    skew, largest = abs(matrix - matrix.T).tocoo(), abs(matrix).max()
    if skew.nnz and skew.data.max() > _SYMMETRY * largest:
        at = np.argmax(skew.data)
        i, j = skew.row[at], skew.col[at]
        raise CaseError(
            f"{where} is not symmetric: entries ({i}, {j}) and ({j}, {i}), counted from 0, are {matrix[i, j]:g} and "
            f"{matrix[j, i]:g}; both triangles are needed, or a Matrix Market file "
            "that says 'symmetric' in its first line"
        )
