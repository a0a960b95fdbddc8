"""The factor of K_L in the cache, for later runs on the same number of ranks, which then only assemble the structure.

    cache/setup-KEY/factor-N/of                 layout, rows of the N ranks, sizes and checksums of the files
    cache/setup-KEY/factor-N/factor_RANK.mumps  the part of a rank in MUMPS' format

The folder is written under a temporary name and renamed.  MUMPS trusts its files; each rank therefore checks the sum of its
file before MUMPS opens it, and a solve with random forces verifies the restored factor (factor.py).  If any of this fails, the
folder is removed and the structure factored again.  The files are not synchronised: a truncated file fails its checksum.
"""

from __future__ import annotations

import os
import platform
import shutil
import stat
import sys
import time
import uuid
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..guards.memory import shortage
from ..linear import bridge, mumps
from ..linear.analysis import saved_size
from ..linear.factor import Factor
from ..linear.mumps import MumpsFactor
from ..messages.errors import CaseError, ResourceError
from ..parallel.agree import on_each, on_root
from ..system.files import BESIDE, file_errors
from ..system.memory import gigabytes
from .records import read_record, write_unsynced

T = TypeVar("T")

LARGEST = 1e9  # bytes of a factor, all ranks: a quarter of the cache
_NOT_STORED = "the factor is not stored for other runs"
_CHUNK = 1 << 20  # bytes read at a time for the checksum
_ABANDONED = 3600.0  # s after which a temporary folder is taken as abandoned by a killed run


@dataclass(frozen=True)
class Saved:
    """The description of a factor's files."""

    ranges: np.ndarray  # (size + 1,) rows of the ranks
    sizes: np.ndarray  # (size,) bytes
    sums: np.ndarray  # (size,) CRC-32

    @classmethod
    def read(cls, folder: Path) -> Saved | None:
        """Return the description in a folder, None if it is damaged or of another layout.  Rank 0."""
        record = read_record(folder / "of")
        if record is None or record[1] != {"layout": _layout()} or record[0].keys() != {"ranges", "sizes", "sums"}:
            return None
        return cls(**record[0]) if all(values.dtype == np.int64 for values in record[0].values()) else None

    def write(self, folder: Path) -> None:
        """Write the description into a folder.  Rank 0."""
        write_unsynced(folder / "of", vars(self), {"layout": _layout()})

    def is_of(self, A: PETSc.Mat) -> bool:
        """Return whether the rows of A are distributed like those of the stored factor.  Local; the same on every rank."""
        size = A.comm.size
        return np.array_equal(self.ranges, A.getOwnershipRanges()) and self.sizes.shape == self.sums.shape == (size,)


class CachedFactor:
    """The factor of a set-up in the cache.  All methods are collective on ``comm``; faulty files raise no errors."""

    def __init__(self, comm: MPI.Comm, entry: Path):
        self.comm, self.entry = comm, entry
        self.messages: tuple[str, ...] = ()  # reasons why it was not used

    @property
    def path(self) -> Path:
        """The folder of the factor, by number of ranks."""
        return self.entry / f"factor-{self.comm.size}"

    def restore(self, A: PETSc.Mat, prefix: str) -> tuple[MumpsFactor, dict[str, Any]] | None:
        """Return the factor of A and its report; None, on every rank, if there is none to use."""
        if not bridge.is_there(self.comm) or not on_root(self.comm, self.path.is_dir):
            return None
        saved = on_root(self.comm, _tried, Saved.read, self.path)
        why = self._fault(saved, A)
        if not why and shortage(self.comm, float(saved.sizes[self.comm.rank])) is not None:
            return None  # a new factorisation chooses, and reports, a method that fits into memory
        restored = None if why else self._restored(A, prefix)
        if restored is None:
            self.drop(why or "MUMPS rejects it")
            return None
        sizes = saved.sizes / 1e6
        return restored[0], restored[1] | {
            "memory_MB": sizes.sum(),
            "memory_max_MB": sizes.max(),
            "restored_from": str(self.path),
        }

    def _fault(self, saved: Saved | None, A: PETSc.Mat) -> str:
        """Return why the files must not be given to MUMPS, or nothing."""
        if saved is None or not saved.is_of(A):
            return "it is damaged, or of another machine or partition"
        size, checksum = int(saved.sizes[self.comm.rank]), int(saved.sums[self.comm.rank])
        measured = _tried(summed, self.path / mumps.saved_file(self.comm.rank), size)
        return "" if all(self.comm.allgather(measured == (size, checksum))) else "a file of it is damaged"

    def _restored(self, A: PETSc.Mat, prefix: str) -> tuple[MumpsFactor, dict[str, Any]] | None:
        """Return the factor that MUMPS restores; it refuses files of different saves, if another run replaced some meanwhile."""
        try:
            return mumps.restored(A, prefix, str(self.path))
        except ResourceError:  # the path is longer than when the factor was saved
            return None

    def drop(self, why: str) -> None:
        """Remove a faulty factor, and record a message."""
        on_root(self.comm, _tried, self._remove)
        self.messages = (f"the factor of an earlier run in {self.path} is not used: {why}",)

    def _remove(self) -> None:
        """Rename the folder and remove it, so that no other run reads a part of it.  Rank 0."""
        temporary = self._temporary()
        os.rename(self.path, temporary)
        shutil.rmtree(temporary, ignore_errors=True)

    def is_wanted(self, factor: Factor) -> bool:
        """Return whether to store a factor: by MUMPS, in memory, computed by this run, and missing in the cache."""
        if not isinstance(factor.solver, MumpsFactor) or factor.info["out_of_core"] or "restored_from" in factor.info:
            return False
        return on_root(self.comm, self._is_missing)

    def _is_missing(self) -> bool:
        return (self.entry / "model").is_file() and not self.path.exists()

    def keep(self, factor: Factor) -> str:
        """Store a factor for later runs; return an error message or nothing."""
        solver = factor.solver
        assert isinstance(solver, MumpsFactor), "a factor that is_wanted()"
        size = self.comm.allreduce(saved_size(solver.mumps))
        if size > LARGEST:
            return f"the factor is not stored for other runs: its size is {gigabytes(size)}, the limit {gigabytes(LARGEST)}"
        try:
            temporary = on_root(self.comm, self._begin, size)
            try:
                self._write(solver, temporary)
            finally:
                on_root(self.comm, shutil.rmtree, temporary, True)  # unless it was renamed
        except (CaseError, ResourceError) as problem:
            return f"{_NOT_STORED}: {problem}"
        return ""

    def _begin(self, size: float) -> Path:
        """Return a new temporary folder for the files; remove those of killed runs.  Rank 0."""
        with file_errors(str(self.entry)):
            for other in self.entry.glob(f"factor-*{BESIDE}"):
                with suppress(OSError):
                    if time.time() - other.stat().st_mtime > _ABANDONED:
                        shutil.rmtree(other)
            if shutil.disk_usage(self.entry).free < 2.0 * size:
                raise ResourceError(f"{self.entry}: the disk has no room for {gigabytes(size)}")
            temporary = self._temporary()
            temporary.mkdir()
        return temporary

    def _temporary(self) -> Path:
        return self.entry / f"{self.path.name}-{uuid.uuid4().hex[:12]}{BESIDE}"

    def _write(self, solver: MumpsFactor, temporary: Path) -> None:
        """Write the files, compute their checksums and publish the folder.

        Raises
        ------
        CaseError, ResourceError : they cannot be written
        """
        solver.save(str(temporary))
        measured = self.comm.allgather(on_each(self.comm, _local_sum, temporary, self.comm.rank))
        sizes, sums = (np.array(each, dtype=np.int64) for each in zip(*measured))
        on_root(self.comm, self._publish, Saved(solver.ranges.astype(np.int64), sizes, sums), temporary)

    def _publish(self, saved: Saved, temporary: Path) -> None:
        """Write the description and rename the folder, unless another run was faster.  Rank 0."""
        with file_errors(str(temporary)):
            for file in temporary.glob("*.info"):  # MUMPS does not read them
                file.unlink()
            saved.write(temporary)
        with suppress(OSError):
            os.rename(temporary, self.path)


def _layout() -> str:
    """Return the layout of a factor's files, which depends on MUMPS and the machine.  Local; needs the bridge."""
    from ..linear._mumps import BUILT_FOR

    return f"MUMPS {BUILT_FOR}, {platform.machine()}, {sys.byteorder}"


def _local_sum(folder: Path, rank: int) -> tuple[int, int]:
    """Return size and checksum of the file that a rank has written.  Local.

    Raises
    ------
    CaseError, ResourceError : it cannot be read
    """
    path = folder / mumps.saved_file(rank)
    with file_errors(str(path)):
        return summed(path, path.stat().st_size)


def summed(path: Path, size: int) -> tuple[int, int]:
    """Return size and CRC-32 of a file, (-1, 0) if it does not have the expected ``size``.  Local.

    Raises
    ------
    OSError : it cannot be read
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # opening a pipe would block
    with open(handle, "rb", buffering=0) as file:
        status, checksum = os.fstat(handle), 0
        if not stat.S_ISREG(status.st_mode) or status.st_size != size:
            return -1, 0
        while chunk := file.read(_CHUNK):
            checksum = zlib.crc32(chunk, checksum)
    return size, checksum


def _tried(function: Callable[..., T], *arguments: Any) -> T | None:
    """Return the result of ``function``, None after an OSError.  Local."""
    with suppress(OSError):
        return function(*arguments)
    return None
