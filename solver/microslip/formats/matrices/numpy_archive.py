"""NumPy archives, .npz, of scipy.sparse.save_npz or numpy.savez.  Objects are never unpickled."""

from __future__ import annotations

import zipfile

import numpy as np
import scipy.sparse as sp

from ...messages.errors import CaseError
from .file_matrix import FileMatrix, Wanted, checked

_MOST_DEFLATED = 1040  # largest factor of deflate compression


def read_npz(wanted: Wanted) -> FileMatrix:
    """Return the matrix of an archive, or the wanted one of several.  Local.

    Raises
    ------
    CaseError, ResourceError : the file is faulty or exceeds memory
    """
    if not zipfile.is_zipfile(wanted.path):
        raise CaseError(f"{wanted.where} is not a file of scipy.sparse.save_npz or numpy.savez")
    _check_claims(wanted)
    with np.load(wanted.path, allow_pickle=False) as arrays:
        if "format" not in arrays:  # of scipy.sparse.save_npz
            return FileMatrix(arrays[wanted.choose(arrays.files)])
    return FileMatrix(checked(sp.load_npz(wanted.path), wanted))


def _check_claims(wanted: Wanted) -> None:
    """Raise CaseError unless the sizes of the arrays match their headers."""
    with zipfile.ZipFile(wanted.path) as archive:
        for member in archive.infolist():
            if member.file_size > _MOST_DEFLATED * wanted.size:
                raise wanted.error(f"{member.filename} claims {member.file_size} bytes in a file of {wanted.size}")
            with archive.open(member) as file:
                version = np.lib.format.read_magic(file)
                read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, _, kind = read(file)
            if kind.itemsize < 0 or not kind.hasobject and int(np.prod(shape, dtype=object)) * kind.itemsize > member.file_size:
                raise wanted.error(f"{member.filename} is truncated: its header states an array of shape {shape}")
