"""NumPy archives, .npz, of scipy.sparse.save_npz or numpy.savez.  Objects are never unpickled."""

import zipfile

import numpy as np
import scipy.sparse as sp

from ...messages.errors import CaseError, ResourceError
from ...system.memory import lack_of_memory
from ..hdf5 import COPIES
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
    claimed = _claims(wanted)
    is_sparse = "format" in claimed  # of scipy.sparse.save_npz
    name = "" if is_sparse else wanted.choose(list(claimed))
    lack = lack_of_memory(COPIES * (sum(claimed.values()) if is_sparse else claimed[name]))
    if lack is not None:
        raise ResourceError(f"{wanted.where}: its numbers need {lack}")
    if is_sparse:
        return FileMatrix(checked(sp.load_npz(wanted.path), wanted))
    with np.load(wanted.path, allow_pickle=False) as arrays:
        return FileMatrix(arrays[name])


def _claims(wanted: Wanted) -> dict[str, int]:
    """Return the bytes of each array of an archive by its name.

    Raises
    ------
    CaseError : an array is larger than the file can hold, or than its header states, or a sparse matrix has too many rows
    """
    claimed, has_shape = {}, True
    with zipfile.ZipFile(wanted.path) as archive:
        for member in archive.infolist():
            if member.file_size > _MOST_DEFLATED * wanted.size:
                raise wanted.error(f"{member.filename} claims {member.file_size} bytes in a file of {wanted.size}")
            with archive.open(member) as file:
                version = np.lib.format.read_magic(file)
                read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, _, kind = read(file)
                if member.filename == "shape.npy":
                    has_shape = kind.kind in "iu" and shape == (2,)
                    if has_shape:
                        wanted.check_rows(int(np.frombuffer(file.read(2 * kind.itemsize), kind).max()))
            if kind.itemsize < 0 or not kind.hasobject and int(np.prod(shape, dtype=object)) * kind.itemsize > member.file_size:
                raise wanted.error(f"{member.filename} is truncated: its header states an array of shape {shape}")
            claimed[member.filename.removesuffix(".npy")] = member.file_size
    if "format" in claimed and not has_shape:
        raise wanted.error("the shape of its matrix is not two whole numbers")
    return claimed
