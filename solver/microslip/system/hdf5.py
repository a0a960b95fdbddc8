"""HDF5 files on disks that fill up: write errors are hidden from HDF5, which would crash at the end of the program.

Imports h5py, which nothing else in this room needs.
"""

import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import h5py

from .files import atomic_write


@contextmanager
def written_hdf5(path: str, mode: str = "w") -> Iterator[h5py.File]:
    """Yield an HDF5 file to write, mode "w" or "r+".  Local.

    Raises
    ------
    OSError : the disk refused something; when the block has ended and the file is closed
    """
    with open(path, "w+b" if mode == "w" else "r+b", buffering=0) as file:
        disk = _Disk(file)
        with h5py.File(disk, mode) as hdf5:
            yield hdf5
    if disk.problem is not None:
        raise disk.problem


@contextmanager
def extended_hdf5(path: str, replaced: str = "") -> Iterator[h5py.File]:
    """Yield an existing HDF5 file, without its group ``replaced``, to add to; the file is complete or as it was.  Local.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    with atomic_write(path) as temporary:
        shutil.copyfile(path, temporary)
        with written_hdf5(temporary, "r+") as file:
            if replaced and replaced in file:
                del file[replaced]
            yield file


class _Disk(io.RawIOBase):
    """A file for HDF5.  After the first write that the disk refuses, all writes go to memory, so that HDF5 can read them back."""

    def __init__(self, file: io.FileIO):
        super().__init__()
        self.problem: OSError | None = None
        self._file, self._at = file, 0
        self._in_memory: list[tuple[int, bytes]] = []  # place and bytes of the writes to memory, in their order

    def seek(self, place: int, whence: int = io.SEEK_SET) -> int:
        self._at = self._file.seek(place, whence)
        if whence == io.SEEK_END:
            self._at = max([self._at, *(at + len(data) for at, data in self._in_memory)])
        return self._at

    def tell(self) -> int:
        return self._at

    def write(self, data) -> int:
        left = memoryview(data).cast("B")
        size = len(left)
        try:
            while self.problem is None and len(left):
                self._file.seek(self._at)
                n = self._file.write(left)
                self._at, left = self._at + n, left[n:]
        except OSError as problem:
            self.problem = problem
        if len(left):
            self._in_memory.append((self._at, bytes(left)))
            self._at += len(left)
        return size

    def readinto(self, target) -> int:
        into = memoryview(target).cast("B")
        into[:] = bytes(len(into))
        self._file.seek(self._at)
        self._file.readinto(into)
        for at, data in self._in_memory:
            first, end = max(at, self._at), min(at + len(data), self._at + len(into))
            if first < end:
                into[first - self._at : end - self._at] = data[first - at : end - at]
        self._at += len(into)
        return len(into)

    def truncate(self, size: int | None = None) -> int:
        size = self._at if size is None else size
        try:
            if self.problem is None:
                self._file.truncate(size)
        except OSError as problem:
            self.problem = problem
        return size

    def flush(self) -> None:
        """Do nothing: the file has no buffer."""
