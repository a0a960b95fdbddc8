"""The factor of K_L in a cache, for later runs on as many ranks, which assemble the structure alone.

    cache/setup-KEY/factor-N/of                 what the files are of: layout, rows of the N ranks, sizes and checksums
    cache/setup-KEY/factor-N/factor_RANK.mumps  the part of a rank, as MUMPS writes it

The folder is made beside and takes its place whole.  MUMPS believes what its files hold, so that each rank sums its own before
MUMPS opens one; and the factor must then answer to random forces (factor.py).  Where any of it fails, the folder is removed and
the structure factored anew.  Nobody waits until the files have reached the disk: what its end cuts off has another sum.
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
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from ..guards.memory import shortage
from ..linear import bridge, mumps
from ..linear.analysis import saved_size
from ..linear.factor import Factor
from ..linear.mumps import MumpsFactor
from ..messages.errors import CaseError, ResourceError
from ..parallel.agree import on_each, on_root
from ..system.files import BESIDE, said_of
from ..system.memory import gigabytes
from .records import note_record, read_record

if TYPE_CHECKING:
    from mpi4py import MPI

LARGEST = 1e9  # bytes of a factor, all ranks: a quarter of the cache
_NOT_KEPT = "the factor is not kept for other runs"
_CHUNK = 1 << 20  # bytes that are summed at a time
_LEFT = 3600.0  # s after which a folder that is not whole is that of a run that was killed


@dataclass(frozen=True)
class Saved:
    """What the files of a factor are of."""

    ranges: np.ndarray  # (size + 1,) rows of the ranks
    sizes: np.ndarray  # (size,) bytes
    sums: np.ndarray  # (size,) CRC-32

    @classmethod
    def read(cls, folder: Path) -> Saved | None:
        """Return what is there, None where that is damaged or of another layout.  Rank 0."""
        found = read_record(folder / "of")
        if found is None or found[1] != {"layout": _layout()} or found[0].keys() != {"ranges", "sizes", "sums"}:
            return None
        return cls(**found[0]) if all(values.dtype == np.int64 for values in found[0].values()) else None

    def write(self, folder: Path) -> None:
        """Write it.  Rank 0."""
        note_record(folder / "of", vars(self), {"layout": _layout()})

    def is_of(self, A: PETSc.Mat) -> bool:
        """Return whether it is of a matrix with A's rows on the ranks.  Local; the same on every rank."""
        size = A.comm.size
        return np.array_equal(self.ranges, A.getOwnershipRanges()) and self.sizes.shape == self.sums.shape == (size,)


class CachedFactor:
    """The factor of a set-up in a cache.  All methods are collective on ``comm``; files at fault raise nothing."""

    def __init__(self, comm: MPI.Comm, entry: Path):
        self.comm, self.entry = comm, entry
        self.said: tuple[str, ...] = ()  # why it was not used

    @property
    def path(self) -> Path:
        return self.entry / f"factor-{self.comm.size}"

    def restore(self, A: PETSc.Mat, prefix: str) -> tuple[MumpsFactor, dict[str, Any]] | None:
        """Return the factor of A and its report; None, on every rank, where there is none that may be used."""
        if not bridge.is_there(self.comm) or not on_root(self.comm, self.path.is_dir):
            return None
        saved = on_root(self.comm, _tried, Saved.read, self.path)
        why = self._fault(saved, A)
        if not why and shortage(self.comm, float(saved.sizes[self.comm.rank])) is not None:
            return None  # what is done for want of memory is said with the factor made anew
        restored = None if why else self._restored(A, prefix)
        if restored is None:
            self.drop(why or "MUMPS does not take it")
            return None
        sizes = saved.sizes / 1e6
        return restored[0], restored[1] | {"memory_MB": sizes.sum(), "memory_max_MB": sizes.max(), "kept_in": str(self.path)}

    def _fault(self, saved: Saved | None, A: PETSc.Mat) -> str:
        """Return why MUMPS must not see the files, or nothing."""
        if saved is None or not saved.is_of(A):
            return "it is damaged, or of another machine or partition"
        size, checksum = int(saved.sizes[self.comm.rank]), int(saved.sums[self.comm.rank])
        found = _tried(summed, self.path / mumps.saved_file(self.comm.rank), size)
        return "" if all(self.comm.allgather(found == (size, checksum))) else "a file of it is damaged"

    def _restored(self, A: PETSc.Mat, prefix: str) -> tuple[MumpsFactor, dict[str, Any]] | None:
        """Return what MUMPS makes of the files: of one save alone, should another run have put its own there meanwhile."""
        try:
            return mumps.restored(A, prefix, str(self.path))
        except ResourceError:  # a longer name of the folder than that by which it was kept
            return None

    def drop(self, why: str) -> None:
        """Remove the factor, which is at fault, and note it."""
        on_root(self.comm, _tried, self._remove)
        self.said = (f"the factor of an earlier run in {self.path} is not used: {why}",)

    def _remove(self) -> None:
        """Take the folder away under another name, so that nobody finds half of it.  Rank 0."""
        beside = self._beside()
        os.rename(self.path, beside)
        shutil.rmtree(beside, ignore_errors=True)

    def is_wanted(self, factor: Factor) -> bool:
        """Return whether a factor is one to keep: MUMPS', in memory, made by this run, for a set-up that lacks it."""
        if not isinstance(factor.solver, MumpsFactor) or factor.info["out_of_core"] or "kept_in" in factor.info:
            return False
        return on_root(self.comm, self._is_missing)

    def _is_missing(self) -> bool:
        return (self.entry / "model").is_file() and not self.path.exists()

    def keep(self, factor: Factor) -> str:
        """Keep a factor for later runs; return why that could not be, or nothing."""
        solver = factor.solver
        assert isinstance(solver, MumpsFactor), "a factor that is_wanted()"
        size = self.comm.allreduce(saved_size(solver.mumps))
        if size > LARGEST:
            return (
                f"the factor is not kept for other runs: it takes {gigabytes(size)}, of which the cache has {gigabytes(LARGEST)}"
            )
        try:
            beside = on_root(self.comm, self._begin, size)
            try:
                self._write(solver, beside)
            finally:
                on_root(self.comm, shutil.rmtree, beside, True)  # unless it has taken its place
        except (CaseError, ResourceError) as problem:
            return f"{_NOT_KEPT}: {problem}"
        return ""

    def _begin(self, size: float) -> Path:
        """Return a new folder for the files, and remove those that killed runs have left.  Rank 0."""
        with said_of(str(self.entry)):
            for other in self.entry.glob(f"factor-*{BESIDE}"):
                with suppress(OSError):
                    if time.time() - other.stat().st_mtime > _LEFT:
                        shutil.rmtree(other)
            if shutil.disk_usage(self.entry).free < 2.0 * size:
                raise ResourceError(f"{self.entry}: the disk has no room for {gigabytes(size)}")
            beside = self._beside()
            beside.mkdir()
        return beside

    def _beside(self) -> Path:
        return self.entry / f"{self.path.name}-{uuid.uuid4().hex[:12]}{BESIDE}"

    def _write(self, solver: MumpsFactor, beside: Path) -> None:
        """Write the files, sum them, and give their folder its place.

        Raises
        ------
        CaseError, ResourceError : they cannot be written
        """
        solver.save(str(beside))
        found = self.comm.allgather(on_each(self.comm, _own_sum, beside, self.comm.rank))
        sizes, sums = (np.array(each, dtype=np.int64) for each in zip(*found))
        on_root(self.comm, self._take_place, Saved(solver.ranges.astype(np.int64), sizes, sums), beside)

    def _take_place(self, saved: Saved, beside: Path) -> None:
        """Say what the files are of, and give their folder its place, if nobody was faster.  Rank 0."""
        with said_of(str(beside)):
            for file in beside.glob("*.info"):  # MUMPS asks for them no more
                file.unlink()
            saved.write(beside)
        with suppress(OSError):
            os.rename(beside, self.path)


def _layout() -> str:
    """Return what the files of a factor are of, where the bridge is there: they serve machines of one kind.  Local."""
    from ..linear._mumps import BUILT_FOR

    return f"MUMPS {BUILT_FOR}, {platform.machine()}, {sys.byteorder}"


def _own_sum(folder: Path, rank: int) -> tuple[int, int]:
    """Return size and checksum of a rank's file that was just written.  Local.

    Raises
    ------
    CaseError, ResourceError : it cannot be read
    """
    path = folder / mumps.saved_file(rank)
    with said_of(str(path)):
        return summed(path, path.stat().st_size)


def summed(path: Path, size: int) -> tuple[int, int]:
    """Return size and CRC-32 of a file, which is not read if its size is not that expected.  Local.

    Raises
    ------
    OSError : it cannot be read
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe would wait for ever
    with open(handle, "rb", buffering=0) as file:
        found, checksum = os.fstat(handle), 0
        if not stat.S_ISREG(found.st_mode) or found.st_size != size:
            return -1, 0
        while chunk := file.read(_CHUNK):
            checksum = zlib.crc32(chunk, checksum)
    return size, checksum


def _tried(function, *arguments):
    """Return what a function of files returns, None where the system refuses.  Local."""
    with suppress(OSError):
        return function(*arguments)
    return None
