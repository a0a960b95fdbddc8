"""One run at a time in a results folder: a lock file there names the running process.

The file has a system lock (flock), which ends with the process in any case.  On file systems without such locks, or with locks
local to a machine, the content of the file decides: on this machine the process by number and start time, on another machine
whether the process still touches the file regularly.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..messages.errors import CaseError, ResourceError
from ..parallel.agree import on_root
from ..system.files import file_errors, make_folder
from ..system.signals import unsignalled

if TYPE_CHECKING:
    from mpi4py import MPI

NAME = ".microslip.lock"
TOUCHED_EVERY = 20.0  # s
STILL = 4.5 * TOUCHED_EVERY  # s without a touch after which a run on another machine has ended; file systems show it late
FIRST_CONTENT = 1.0  # s until a new file names its process
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL, errno.EPERM}
_JOBS = ("SLURM_JOB_ID", "PBS_JOBID")
_HELD: set[Lock] = set()  # locks of this process


@contextmanager
def locked(comm: MPI.Comm, folder: Path) -> Iterator[list[str]]:
    """Create a folder and lock it for this run until the block ends in any way; yield messages on the lock.

    Collective on ``comm`` at its beginning, local at its end: rank 0 holds the lock.

    Raises
    ------
    CaseError : another run is at work there; on every rank
    CaseError, ResourceError : the folder cannot be written to; on every rank
    """
    lock, messages = on_root(comm, _take, folder, share=False) or (None, [])
    try:
        yield messages
    finally:
        if lock is not None:
            lock.release()


class Lock:
    """The lock of a folder, held by this process.  Local."""

    def __init__(self, path: Path, handle: int):
        self._path, self._handle, self._ends = path, handle, threading.Event()
        _HELD.add(self)
        try:
            os.ftruncate(handle, 0)
            os.pwrite(handle, json.dumps(_self()).encode(), 0)
        except OSError:  # a full disk
            self.release()
            raise
        try:
            with unsignalled():
                threading.Thread(target=self._touch, name="lock", daemon=True).start()
        except RuntimeError as problem:
            self.release()
            raise ResourceError(
                f"{path}: the system allows this process no further thread; see ulimit -v and ulimit -u"
            ) from problem

    def _touch(self) -> None:
        """Touch the file regularly while this process runs, whenever its libraries let a thread run."""
        while not self._ends.wait(TOUCHED_EVERY):
            with suppress(OSError):
                os.utime(self._handle)

    def release(self) -> None:
        """Remove the file, if it is still the file of this lock, and release the lock."""
        self._ends.set()
        _HELD.discard(self)
        with suppress(OSError):
            if _is_at(self._path, self._handle):
                os.remove(self._path)
        with suppress(OSError):
            os.close(self._handle)


def release_all() -> None:
    """Release all locks of this process at its end.  Local, in any thread."""
    for lock in tuple(_HELD):
        lock.release()


def _take(folder: Path) -> tuple[Lock, list[str]]:
    """Return the lock of a folder, and a message on an abandoned lock that it replaced.  On rank 0.

    Raises
    ------
    CaseError, ResourceError
    """
    make_folder(str(folder))
    path = folder / NAME
    with file_errors(str(path)):
        while True:
            handle, is_new = _open(path)
            is_free = _flock(handle)
            holder = _read(handle)
            if is_free is None and not is_new and not holder:  # between its creation and its first content
                time.sleep(FIRST_CONTENT)
                holder = _read(handle)
            if is_free is False or not (is_new or _is_gone(path, holder, trusted=is_free is True)):
                os.close(handle)
                raise CaseError(
                    f"{folder}: another run is at work there{_in_words(holder)}; wait for it, end it, or choose another "
                    "folder with --out"
                )
            if _is_at(path, handle):
                messages = [f"{path} was left behind{_in_words(holder)}, which has ended; taken over"] if holder else []
                return Lock(path, handle), messages
            os.close(handle)  # another process removed it meanwhile


def _open(path: Path) -> tuple[int, bool]:
    """Return a handle of the file, and whether this call created it."""
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666), True
    except FileExistsError:
        return os.open(path, os.O_RDWR | os.O_CREAT, 0o666), False


def _flock(handle: int) -> bool | None:
    """Return whether the system granted its lock on a file; None: the file system has no such locks."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as problem:
        if problem.errno in _NO_LOCKS:
            return None
        raise
    return True


def _is_at(path: Path, handle: int) -> bool:
    """Return whether the path still names the file of a handle."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(handle))
    except FileNotFoundError:
        return False


def _is_gone(path: Path, holder: dict[str, Any], trusted: bool) -> bool:
    """Return whether the process that wrote the file has ended; ``trusted``: the system granted the lock."""
    if not holder:
        return trusted or _stands_still(path)
    if holder.get("host") == socket.gethostname():
        return trusted or started(holder.get("process")) != holder.get("started")
    is_same_job = bool(holder.get("job")) and holder.get("job") == _self()["job"]  # a job that was requeued
    return (trusted and is_same_job) or _stands_still(path)


def _stands_still(path: Path) -> bool:
    """Return whether no process touches a file, watched until that is certain."""
    if time.time() - os.stat(path).st_mtime > 10.0 * STILL:
        return True
    _report_wait(path)
    first, until = _touched(path), time.monotonic() + STILL
    while time.monotonic() < until:
        time.sleep(0.05 * STILL)
        if _touched(path) != first:
            return False
    return True


def _report_wait(path: Path) -> None:
    """Write the reason of the wait to standard error."""
    with suppress(OSError, AttributeError):  # standard error may be closed
        sys.stderr.write(
            f"microslip: {path} belongs to another run; waiting {STILL:.0f} s to see whether that run is still at work\n"
        )
        sys.stderr.flush()


def _touched(path: Path) -> int | None:
    """Return the last modification time of a file from the file server, which opening the file ensures."""
    try:
        with open(path, "rb") as file:
            return os.fstat(file.fileno()).st_mtime_ns
    except FileNotFoundError:
        return None


def _self() -> dict[str, Any]:
    """Return the content of the file for this process."""
    return {
        "host": socket.gethostname(),
        "process": os.getpid(),
        "started": started(os.getpid()),
        "since": time.strftime("%Y-%m-%d %H:%M:%S"),
        "job": next((os.environ[name] for name in _JOBS if os.environ.get(name)), ""),
    }


def started(process: Any) -> str:
    """Return the start time of a process of this machine, in the machine's count; "" if the process does not exist."""
    try:
        with open("/proc/sys/kernel/random/boot_id") as boot, open(f"/proc/{int(process)}/stat") as file:
            state, *fields = file.read().rpartition(")")[2].split()
            return "" if state in "ZX" else f"{boot.read().strip()} {fields[18]}"
    except (OSError, ValueError, TypeError, IndexError, OverflowError):
        return ""


def _read(handle: int) -> dict[str, Any]:
    """Return the content of a lock's file; empty if it is unreadable."""
    try:
        holder = json.loads(os.pread(handle, 4096, 0))
    except (OSError, ValueError, RecursionError):
        return {}
    return holder if isinstance(holder, dict) else {}


def _in_words(holder: dict[str, Any]) -> str:
    """Return the process that wrote a lock's file as text."""
    if not holder:
        return ""
    job = f", job {holder['job']}" if holder.get("job") else ""
    return f" by process {holder.get('process')} on {holder.get('host')}{job}, begun {holder.get('since')}"
