"""Atomic writing of files, and the messages of disk errors.  Rank 0 only."""

import errno
import os
import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..messages.errors import CaseError, MicroslipError, ResourceError
from .signals import unbroken

BESIDE = ".part"  # suffix of a file until it is complete
_OF_PROCESS: set[str] = set()  # folders to remove at its end
_FORBIDDEN = {
    errno.EACCES,
    errno.EPERM,
    errno.EROFS,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.ENOENT,
    errno.ENAMETOOLONG,
    errno.EEXIST,
    errno.ELOOP,
    errno.EINVAL,
}


NO_FILE = "that is a pipe or a device; a file is expected"


@contextmanager
def file_errors(path: str) -> Iterator[None]:
    """Turn what the system reports while ``path`` is written into an error with an exit status.  Local.

    Raises
    ------
    CaseError : the place cannot be written to (status 2)
    ResourceError : the disk is full or fails (status 4)
    """
    try:
        yield
    except MicroslipError:
        raise
    except (OSError, RuntimeError) as problem:  # HDF5 reports a full disk at close as RuntimeError
        number = _errno(problem)
        cause = os.strerror(number) if number else " ".join(str(problem).split())[:200]
        if os.path.isdir(path) and isinstance(getattr(problem, "filename", None), str):
            path = problem.filename.removesuffix(BESIDE)  # the file of the folder that failed
        if number in _FORBIDDEN:
            raise CaseError(f"{path}: cannot be written: {cause}; choose another folder with --out") from problem
        raise ResourceError(f"{path}: could not be written: {cause}; make room or choose another disk with --out") from problem


def remove_files(folder: Path, *names: str) -> None:
    """Remove files of an earlier command from a folder, by names or patterns.  Local.

    Raises
    ------
    CaseError, ResourceError : as :func:`file_errors`
    """
    for path in (path for name in names for path in folder.glob(name)):
        with file_errors(str(path)):
            path.unlink()


def _errno(problem: BaseException) -> int | None:
    """Return the system's error number; HDF5 hides it in its text."""
    if isinstance(problem, OSError) and problem.errno:
        return problem.errno
    match = re.search(r"errno = (\d+)", str(problem))
    return int(match[1]) if match else None


@contextmanager
def atomic_write(path: str) -> Iterator[str]:
    """Yield the name of a temporary file that replaces ``path`` when the block ends without an error.  Local.

    A process killed meanwhile leaves the old file unchanged; a stop signal waits until the new file is in place.

    Raises
    ------
    CaseError, ResourceError : as :func:`file_errors`
    """
    temporary = path + BESIDE
    with unbroken(), file_errors(path):
        try:
            yield temporary
            _to_disk(temporary)
            os.replace(temporary, path)
            _to_disk(os.path.dirname(path) or ".")
        except BaseException:
            with suppress(OSError):
                os.remove(temporary)
            raise


def _to_disk(path: str) -> None:
    """Wait until a file, or the names in a folder, have reached the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def remove_at_end(folder: str) -> None:
    """Have a folder of this process removed when the program ends after a signal, too.  Local."""
    _OF_PROCESS.add(folder)


def remove_folder(folder: str) -> None:
    """Remove a folder of this process, if possible.  Local."""
    _OF_PROCESS.discard(folder)
    shutil.rmtree(folder, ignore_errors=True)


def remove_folders() -> None:
    """Remove all folders of this process, which ends.  Local, in any thread."""
    for folder in tuple(_OF_PROCESS):
        remove_folder(folder)


def refuse_devices(path: str | os.PathLike[str]) -> None:
    """Raise CaseError for a pipe, a socket or a device, whose reading may never end.  Local.

    A folder or a missing file is reported by the function that opens it.
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise CaseError(f"{path}: {NO_FILE}")


def make_folder(folder: str) -> None:
    """Create a folder for results if there is none.  Local.  Raises CaseError, ResourceError: as :func:`file_errors`."""
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise CaseError(f"{folder}: cannot be written: that is a file and no folder; choose another folder with --out")
    with file_errors(folder):
        os.makedirs(folder, exist_ok=True)
