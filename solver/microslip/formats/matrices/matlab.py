"""MATLAB's .mat: versions 4 to 7 in matlab_binary.py, version 7.3 in matlab_hdf5.py.  Objects are never made."""

from __future__ import annotations

from .file_matrix import FileMatrix, Wanted
from .matlab_binary import read_4, read_5
from .matlab_hdf5 import is_hdf5, read_hdf5


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
    if len(head) < 4:
        raise wanted.error("it is empty or truncated")
    if 0 in head[:4]:  # version 4 begins with a number, later ones with a text
        return read_4(wanted)
    if len(head) < 128:
        raise wanted.error("it is truncated in its head")
    return read_5(wanted)
