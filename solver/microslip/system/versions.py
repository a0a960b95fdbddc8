"""Versions of the program and its libraries, for the log and the result file."""

import hashlib
import platform
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).parents[1]


def versions() -> dict[str, str]:
    """Return versions by name.  Local; after PETSc was started."""
    import h5py
    import mpi4py
    import numpy
    import scipy
    from mpi4py import MPI
    from petsc4py import PETSc
    from slepc4py import SLEPc

    known_versions = {
        "PETSc": dotted(PETSc.Sys.getVersion()),
        "SLEPc": dotted(SLEPc.Sys.getVersion()),
        "MUMPS": mumps_version() or "",
        "mpi4py": mpi4py.__version__,
        "MPI": MPI.Get_library_version().split(",")[0].split("\n")[0],
        "HDF5": h5py.version.hdf5_version,
        "h5py": h5py.__version__,
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
    }
    return {name: version for name, version in known_versions.items() if version}


def dotted(numbers: Iterable[int]) -> str:
    """Return numbers joined by dots."""
    return ".".join(map(str, numbers))


def commit(package: Path = _PACKAGE) -> str:
    """Return the commit of the clone that this package lies in, "" if it lies in none.  Local.

    Read from git's files: where MPI has pinned memory no other program should be started.
    """
    try:
        place = next(folder / ".git" for folder in package.resolve().parents if (folder / "setup.py").is_file())
        if place.is_file():  # a worktree names its own part
            place = Path(place.parent, place.read_text(encoding="utf-8").removeprefix("gitdir:").strip())
        head = (place / "HEAD").read_text(encoding="utf-8").strip()
        if not head.startswith("ref:"):
            return _hexadecimal(head)
        name = head.removeprefix("ref:").strip()
        shared = place / "commondir"
        folders = [place, place / shared.read_text(encoding="utf-8").strip()] if shared.is_file() else [place]
        loose = next((folder / name for folder in folders if (folder / name).is_file()), None)
        if loose is not None:
            return _hexadecimal(loose.read_text(encoding="utf-8").strip())
        packed = (folders[-1] / "packed-refs").read_text(encoding="utf-8")
        return next((_hexadecimal(line.split()[0]) for line in packed.splitlines() if line.endswith(f" {name}")), "")
    except (OSError, ValueError, StopIteration):
        return ""


def _hexadecimal(word: str) -> str:
    return word if re.fullmatch("[0-9a-f]{40,64}", word) else ""


@cache
def program_hash(package: Path = _PACKAGE) -> str:
    """Return a hash of the program's files: a developer changes them without a new version.  Local."""
    digest = hashlib.sha256()
    for path in sorted((*package.rglob("*.py"), *package.rglob("*.so"))):
        digest.update(str(path.relative_to(package)).encode() + path.read_bytes())
    return digest.hexdigest()[:8]


def mumps_version() -> str | None:
    """Return the version in the name of the library of MUMPS that this process has loaded.  Local."""
    version = re.search(r"lib[dz]mumps\S*?-(\d[\d.]*\d)", loaded_libraries())
    return version[1] if version else None


def loaded_libraries() -> str:
    """Return the files that this process has loaded, as text; empty where unknown.  Local."""
    try:
        with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
            return maps.read()
    except OSError:
        return ""
