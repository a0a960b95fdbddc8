"""MATLAB's .mat in a sandbox: SciPy reads versions 4 to 7, h5py version 7.3.  Objects are never constructed.

SciPy 1.10 crashes on some damaged files and allocates any stated shape.
"""

from math import prod

import numpy as np
import scipy.io
import scipy.sparse as sp

from ...messages.errors import MicroslipError, ResourceError
from ...system.memory import lack_of_memory
from ...system.sandbox import SandboxError, read_file
from ..hdf5 import COPIES, MOST_GAIN, Storage
from .file_matrix import FileMatrix, Wanted, checked

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_INTERNAL = ("#refs#", "#subsystem#")

_NUMBERS = ("sparse", "double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "logical")


def read_mat(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file, or the wanted one of several variables.  Local.

    Raises
    ------
    CaseError, ResourceError : the file is faulty or exceeds memory
    """
    with open(wanted.path, "rb") as file:
        read = read_hdf5 if is_hdf5(file.read(1024)) else _read
    try:
        return read_file(wanted.path, read, wanted, gain=MOST_GAIN, returns=(FileMatrix,))
    except SandboxError as problem:
        raise wanted.error(str(problem)) from None


def _read(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file of versions 4 to 7.  Local, in a sandbox; SciPy's exceptions become messages."""
    try:
        return _by_scipy(wanted)
    except (MicroslipError, MemoryError):
        raise
    except Exception as problem:
        raise wanted.error(f"it is not a .mat file of versions 4 to 7, or it is damaged: {problem}") from problem


def _by_scipy(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file of versions 4 to 7.  Local; may raise any exception for a damaged file."""
    variables = {name: (shape, kind) for name, shape, kind in scipy.io.whosmat(wanted.path, appendmat=False)}
    shape, kind = variables[name := wanted.choose(list(variables))]
    if kind not in _NUMBERS:
        raise wanted.error(f"its variable {name} is of the class {kind}; a matrix of numbers is needed")
    lack = lack_of_memory(COPIES * 8 * prod(shape)) if kind == "double" else None
    if lack is not None:
        raise ResourceError(f"{wanted.where}: its variable {name} needs {lack}")
    matrix = scipy.io.loadmat(wanted.path, appendmat=False, variable_names=[name])[name]
    return FileMatrix(checked(matrix, wanted) if sp.issparse(matrix) else matrix)


def is_hdf5(head: bytes) -> bool:
    """Return whether a file begins as HDF5, with or without MATLAB's 512 bytes.  Local."""
    return head.startswith(_SIGNATURE) or head[512:520] == _SIGNATURE


def read_hdf5(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file, or the wanted one of several variables.  Local, in a sandbox.

    Raises
    ------
    CaseError : the file is faulty, or h5py is missing
    """
    try:
        import h5py
    except ImportError:
        raise wanted.error("a .mat of version 7.3 needs h5py; save it with -v7, or install h5py") from None
    with h5py.File(wanted.path, "r", locking=False) as file:
        name = wanted.choose([name for name in file if name not in _INTERNAL])
        item = _inside(file, name, wanted)
        if "MATLAB_object_decode" in item.attrs:
            raise wanted.error(f"its variable {name} is an object; a matrix of numbers is needed")
        if isinstance(item, h5py.Group):
            return FileMatrix(_sparse(item, name, wanted))
        return FileMatrix(_array(item, name, wanted).T)


def _inside(group, name: str, wanted: Wanted):
    """Return an item of this file; CaseError for a link to another file or a broken link."""
    fault = Storage(wanted.size).link_fault(group, name)
    if fault is not None:
        raise wanted.error(fault)
    return group[name]


def _array(item, name: str, wanted: Wanted) -> np.ndarray:
    """Return the numbers of a dataset."""
    import h5py

    if isinstance(item, h5py.Group):
        raise wanted.error(f"its variable {name} is a structure; a matrix of numbers is needed")
    if item.dtype.names == ("real", "imag"):
        values = item[()]
        return values["real"] + 1j * values["imag"]
    if item.dtype.kind not in "biuf":
        raise wanted.error(f"its variable {name} is of the class {item.dtype}; a matrix of numbers is needed")
    return np.asarray(item[()])


def _sparse(group, name: str, wanted: Wanted) -> sp.csc_matrix:
    """Return a sparse matrix in compressed columns, with the number of rows as an attribute."""
    if "MATLAB_sparse" not in group.attrs:
        raise wanted.error(f"its variable {name} is a structure; a matrix of numbers is needed")
    n_rows = int(group.attrs["MATLAB_sparse"])
    wanted.check_rows(n_rows)
    parts = {part: _array(_inside(group, part, wanted), part, wanted).ravel() for part in ("data", "ir", "jc") if part in group}
    if "jc" not in parts or len(parts) not in (1, 3):
        raise wanted.error(f"its sparse variable {name} lacks data, ir or jc")
    data, rows, starts = parts.get("data", np.empty(0)), *(parts.get(part, np.empty(0)).astype(np.int64) for part in ("ir", "jc"))
    if starts[0] != 0 or (np.diff(starts) < 0).any() or not starts[-1] == len(rows) == len(data):
        raise wanted.error(f"the columns of its sparse variable {name} do not have the stated number of entries")
    if len(rows) and not 0 <= rows.min() <= rows.max() < n_rows:
        raise wanted.error("row index exceeds matrix dimensions")
    return sp.csc_matrix((data, rows, starts), (n_rows, len(starts) - 1))
