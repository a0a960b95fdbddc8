"""Read a matrix of another program in any known format.  Local; no MPI, no PETSc."""

from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ...messages.errors import CaseError, MicroslipError, ResourceError
from ...system.files import refuse_devices
from .file_matrix import FileMatrix, Wanted

_SYMMETRY = 1e-8  # accepted asymmetry over the largest entry: rounding of text files


def _lazy(module: str, function: str) -> Callable[[Wanted], FileMatrix]:
    """Return a reader of this folder that imports its module at the first call."""
    return lambda wanted: getattr(import_module(f".{module}", __package__), function)(wanted)


def _read_mtx(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file .mtx, of Matrix Market or Abaqus."""
    from .abaqus import is_abaqus, read_abaqus
    from .matrix_market import read_matrix_market

    with open(wanted.path, "rb") as file:
        head = file.read(4096)
    return (read_abaqus if is_abaqus(wanted, head) else read_matrix_market)(wanted)


READERS: dict[str, Callable[[Wanted], FileMatrix]] = {
    ".mtx": _read_mtx,
    ".npz": _lazy("numpy_archive", "read_npz"),
    ".mat": _lazy("matlab", "read_mat"),
    ".sti": _lazy("coordinates", "read_calculix"),
    ".mas": _lazy("coordinates", "read_calculix"),
    ".op4": _lazy("op4", "read_op4"),
    ".op2": _lazy("op2", "read_op2"),
    ".pch": _lazy("dmig", "read_dmig"),
    ".dmig": _lazy("dmig", "read_dmig"),
    ".bdf": _lazy("dmig", "read_dmig"),
    ".full": _lazy("ansys_full", "read_full"),
    ".sub": _lazy("ansys_sub", "read_sub"),
    ".rb": _lazy("harwell_boeing", "read_harwell_boeing"),
    ".rsa": _lazy("harwell_boeing", "read_harwell_boeing"),
    ".rua": _lazy("harwell_boeing", "read_harwell_boeing"),
    ".hb": _lazy("harwell_boeing", "read_harwell_boeing"),
    ".petsc": _lazy("petsc_binary", "read_petsc"),
    ".bin": _lazy("petsc_binary", "read_petsc"),
}
ENDINGS = tuple(READERS)


def read_matrix(path: Path, key: str, symbol: str, name: str | None = None) -> FileMatrix:
    """Return a real symmetric matrix (n, n), as CSR with both triangles.

    Local.

    Parameters
    ----------
    key : key of the scene, for messages
    symbol : K, M or C, which selects among several variables
    name : name of the variable, if the user states one

    Raises
    ------
    CaseError : the file or the matrix is faulty
    ResourceError : not enough memory
    """
    where = f"{path}: {key}"
    read = read_any(path, key, symbol, name)
    matrix = sp.csr_matrix(read.matrix).astype(float)
    matrix.sum_duplicates()
    _check_numbers(matrix, where, read)
    if read.is_triangle:
        matrix = _mirrored(matrix, where)
    skew = _check_symmetry(matrix, where, read)
    return replace(read, matrix=(matrix / 2.0 + matrix.T / 2.0).tocsr(), is_triangle=False, skew=skew)


def read_any(path: Path, key: str, symbol: str, name: str | None = None, *, is_square: bool = True) -> FileMatrix:
    """Return a real matrix as stored in its file, with only its type and shape checked.  Local.

    Raises
    ------
    CaseError, ResourceError : as in read_matrix
    """
    where = f"{path}: {key}" + (f' "{name}"' if name is not None else "")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise CaseError(f"{where}: ending {path.suffix!r} is not one of {', '.join(ENDINGS)}")
    refuse_devices(path)
    wanted = Wanted(path, symbol, where, name)
    try:
        with np.errstate(all="ignore"):  # numbers are checked after reading
            read = reader(wanted)
        _check_sort(read.matrix, where, is_square)
    except MicroslipError:  # includes a signal that stops the run
        raise
    except MemoryError:
        raise ResourceError(f"{where}: not enough memory to read it") from None
    except Exception as problem:  # any failure of a reader on a damaged file
        raise wanted.error(" ".join(str(problem).split())[:200]) from None
    return read


def _check_sort(value, where: str, is_square: bool) -> None:
    """Raise CaseError unless the value is a real matrix, square and not empty."""
    kind = getattr(value, "dtype", np.dtype(object)).kind
    shape: tuple[int, ...] = getattr(value, "shape", ())
    if kind == "c":
        raise CaseError(f"{where} is complex; microslip takes real matrices: damping goes into [model] damping or [damping]")
    if kind not in "biuf":
        raise CaseError(f"{where} holds no numbers")
    if len(shape) != 2 or shape[0] == 0 or (is_square and shape[0] != shape[1]):
        must = "a matrix must be square" if is_square else "a matrix must have two dimensions"
        raise CaseError(f"{where} has the shape {tuple(shape)}; {must}")


def _at(read: FileMatrix, row: int) -> str:
    """Return the DOF of a row, for a message after its number."""
    return "" if read.dofs is None else f", {read.dofs.name(row)}"


def _check_numbers(matrix: sp.csr_matrix, where: str, read: FileMatrix) -> None:
    """Raise CaseError unless all entries are finite."""
    if not np.isfinite(matrix.data).all():
        row = np.searchsorted(matrix.indptr, np.flatnonzero(~np.isfinite(matrix.data))[0], side="right") - 1
        raise CaseError(f"{where} has an entry in row {row} that is not a finite number (rows count from 0){_at(read, row)}")


def _mirrored(matrix: sp.csr_matrix, where: str) -> sp.csr_matrix:
    """Return both triangles of a matrix stored by one triangle; if the file has both, they must be equal."""
    diagonal = sp.diags(matrix.diagonal(), format="csr")
    below, above = sp.tril(matrix, -1, format="csr"), sp.triu(matrix, 1, format="csr")
    both = below.astype(bool).multiply(above.T.astype(bool)).tocsr()
    if both.nnz:
        at = both.tocoo()
        twice = np.asarray(below[at.row, at.col]).ravel(), np.asarray(above.T.tocsr()[at.row, at.col]).ravel()
        wrong = np.flatnonzero(np.abs(twice[0] - twice[1]) > _SYMMETRY * abs(matrix).max())
        if len(wrong):
            i, j = at.row[wrong[0]], at.col[wrong[0]]
            raise CaseError(
                f"{where} states 'symmetric', but holds ({i}, {j}) and ({j}, {i}), counted from 0, with different values"
            )
        above = above - above.multiply(both.T)
    return below + below.T + above + above.T + diagonal


def _check_symmetry(matrix: sp.csr_matrix, where: str, read: FileMatrix) -> float:
    """Return the asymmetry relative to the largest entry; CaseError if it exceeds rounding."""
    skew, largest = abs(matrix - matrix.T).tocoo(), abs(matrix).max()
    if skew.nnz and skew.data.max() > _SYMMETRY * largest:
        at = np.argmax(skew.data)
        i, j = skew.row[at], skew.col[at]
        raise CaseError(
            f"{where} is not symmetric: entries ({i}, {j}) and ({j}, {i}), counted from 0{_at(read, i)}, are {matrix[i, j]:g} "
            f"and {matrix[j, i]:g}; both triangles are needed, or a Matrix Market file "
            "with 'symmetric' in its first line"
        )
    return float(skew.data.max() / largest) if skew.nnz and largest > 0.0 else 0.0
