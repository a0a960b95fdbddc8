"""Factors that do not fit into memory: written to disk by MUMPS, where a disk has room."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from mpi4py import MPI

from ..messages.errors import ResourceError
from ..parallel.agree import on_each
from ..system.files import remove_at_end, remove_folder
from ..system.memory import gigabytes

if TYPE_CHECKING:
    from ._mumps import Instance
    from .analysis import FactorMemory

VARIABLE = "MUMPS_OOC_TMPDIR"  # names another folder
PREFIX = "microslip_factor_"  # prefix of the folders with one rank's part of a factor
_OUT_OF_CORE = 22  # ICNTL
_IN_MEMORY = ("tmpfs", "ramfs", "rootfs")  # file systems in memory
_MARGIN = 1.2  # of the estimate, for the memory that MUMPS adds during factorisation


def room_on_disk(comm: MPI.Comm, memory: FactorMemory) -> str | None:
    """Return the folder to which each rank may write its part of a factor; None, on every rank, if one has no room.

    Collective on ``comm``.  Ranks of one machine are assumed to share a disk.
    """
    here = comm.Split_type(MPI.COMM_TYPE_SHARED)
    needed = _MARGIN * here.allreduce(memory.on_disk)
    here.Free()
    folder = next((folder for folder in _folders() if _is_on_disk(folder) and shutil.disk_usage(folder).free > needed), None)
    return folder if comm.allreduce(folder is not None, op=MPI.LAND) else None


def usual_folder() -> str:
    """Return the folder that is stated, or else the first of the usual ones.  Local."""
    return _folders()[0]


def write_to_disk(comm: MPI.Comm, mumps: Instance, folder: str) -> None:
    """Store an analysed factor on disk by MUMPS, in a new folder within ``folder``.  Collective on ``comm``.

    The folder is removed when the factor is freed, or at the end of the program, unless that is killed.
    """
    on_each(comm, _take_folder, mumps, folder)
    mumps.set_icntl(_OUT_OF_CORE, 1)


def _take_folder(mumps: Instance, folder: str) -> None:
    """Make a folder for this rank's files of a factor, and state it.  Local."""
    try:
        folder_of_rank = tempfile.mkdtemp(prefix=PREFIX, dir=folder)
        weakref.finalize(mumps, remove_folder, folder_of_rank)
        remove_at_end(folder_of_rank)
        mumps.set_folder(folder_of_rank)
    except (OSError, ValueError) as error:
        raise ResourceError(f"{folder}: cannot be written ({error}); set {VARIABLE}") from error


def disks(memory: FactorMemory) -> str:
    """Return a text on the folders for a factor, and the space that it needs there.  Local."""
    return f"{gigabytes(memory.on_disk)} on a disk in {' or '.join(_folders())} (${VARIABLE} names another folder)"


def _folders() -> list[str]:
    """Return the folders for a factor: the stated one, or the usual ones.  Local."""
    stated = os.environ.get(VARIABLE)
    return [stated] if stated else list(dict.fromkeys([os.environ.get("TMPDIR") or "/tmp", "/tmp", "/var/tmp"]))


def _is_on_disk(folder: str) -> bool:
    """Return whether a folder exists, may be written, and is not on a file system in memory.  Local."""
    path = Path(folder).resolve()
    mounts = {Path(place): kind for place, kind in _mounts()}
    kind = next((mounts[parent] for parent in (path, *path.parents) if parent in mounts), "")
    return path.is_dir() and os.access(path, os.W_OK) and kind not in _IN_MEMORY


def _mounts() -> Iterator[tuple[str, str]]:
    """Yield mount point and type of each file system; none if the system does not list them."""
    try:
        with open("/proc/mounts") as file:
            for line in file:
                _, place, kind, *_ = line.split()
                yield place, kind
    except OSError:
        return
