"""MATLAB's .mat in a sandbox: SciPy reads versions 4 to 7, ``matlab_hdf5.py`` version 7.3.  Objects are never constructed.

SciPy 1.10 crashes on some damaged files and allocates any stated shape.
"""

from __future__ import annotations

from math import prod

import scipy.io
import scipy.sparse as sp

from ...messages.errors import MicroslipError, ResourceError
from ...system.memory import lack_of_memory
from ...system.sandbox import SandboxError, read_file
from ..hdf5 import COPIES, MOST_GAIN
from .file_matrix import FileMatrix, Wanted, checked
from .matlab_hdf5 import is_hdf5, read_hdf5

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
