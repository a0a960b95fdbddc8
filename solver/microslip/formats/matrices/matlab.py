"""MATLAB's .mat: versions 4 to 7 by SciPy, version 7.3 in matlab_hdf5.py.  Objects are never made."""

from __future__ import annotations

import zlib

import numpy as np
import scipy.io
import scipy.sparse as sp

from .file_matrix import FileMatrix, Wanted
from .matlab_hdf5 import is_hdf5, read_hdf5

_COMPRESSED = 15
_NUMBERS = {"double", "single", "sparse", "logical", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"}


def read_mat(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file, or of several variables the one that is wanted.  Local.

    Raises
    ------
    CaseError, ResourceError : the file is at fault, or larger than memory
    """
    with open(wanted.path, "rb") as file:
        head = file.read(1024)
    if is_hdf5(head):
        return read_hdf5(wanted)
    if head.startswith(b"MATLAB 5"):
        _check_elements(wanted)
    found = {name: kind for name, _, kind in scipy.io.whosmat(wanted.path) if not name.startswith("__")}
    name = wanted.choose(list(found))
    if found[name] not in _NUMBERS:
        raise wanted.error(f"its variable {name} is of the class {found[name]}; a matrix of numbers is needed")
    matrix = scipy.io.loadmat(wanted.path, variable_names=[name])[name]
    if sp.issparse(matrix):
        wanted.check_rows(max(matrix.shape))
        matrix.check_format(full_check=True)
    return FileMatrix(matrix)


def _check_elements(wanted: Wanted) -> None:
    """Raise CaseError for an element of a file of version 5 that is longer than what is left of the file."""
    with open(wanted.path, "rb") as file:
        head = file.read(128)
        order = "<" if head[126:128] == b"IM" else ">"
        at = 128
        while at < wanted.size:
            tag = np.frombuffer(file.read(8).ljust(8, b"\0"), dtype=f"{order}u4")
            if at + 8 + int(tag[1]) > wanted.size:
                raise wanted.error(f"it is truncated: {int(tag[1])} bytes are announced, {max(wanted.size - at - 8, 0)} follow")
            if tag[0] == _COMPRESSED:
                _check_compressed(file.read(min(int(tag[1]), 4096)), int(tag[1]), order, wanted)
            at += 8 + int(tag[1])
            file.seek(at)


def _check_compressed(start: bytes, n_bytes: int, order: str, wanted: Wanted) -> None:
    """Raise CaseError where a compressed variable claims more than its bytes can stand for."""
    inside = zlib.decompressobj().decompress(start, 8)
    claimed = int(np.frombuffer(inside.ljust(8, b"\0"), dtype=f"{order}u4")[1])
    if claimed > 1040 * n_bytes:
        raise wanted.error(f"a variable claims {claimed} bytes in {n_bytes}")
