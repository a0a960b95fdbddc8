"""Start PETSc and SLEPc once, with the options of this program only.

Debian's Python packages of PETSc and SLEPc are found through a link that only its development packages
install; :func:`locate` adds the folders of the packages instead, so that no environment variable is needed.
"""

from __future__ import annotations

import ctypes
import glob
import importlib.util
import os
import sys
from typing import TYPE_CHECKING

from ..system.memory import return_large_blocks
from ..system.signals import handlers_unchanged, is_stopping

if TYPE_CHECKING:
    from mpi4py import MPI
    from petsc4py import PETSc

_REFUSED = (62, 63, 86, 92)  # errors of PETSc: wrong argument, argument out of range, unknown type, missing solver
PREFIXES = ("static_", "modes_", "hb_")
_DEBIAN = {
    "petsc4py": ("PETSC_DIR", "/usr/lib/petscdir/petsc*/*-real"),
    "slepc4py": ("SLEPC_DIR", "/usr/lib/slepcdir/slepc*/*-real"),
}


def locate() -> None:
    """Make petsc4py and slepc4py importable from Debian's folders.  Local."""
    for module, (variable, pattern) in _DEBIAN.items():
        if importlib.util.find_spec(module) is not None:
            continue
        stated = os.environ.get(variable)
        for folder in [stated] if stated else sorted(glob.glob(pattern), reverse=True):
            packages = os.path.join(folder, "lib", "python3", "dist-packages")
            if os.path.isdir(os.path.join(packages, module)):
                os.environ[variable] = folder
                sys.path.append(packages)
                break


def initialise(options: list[str] | None = None):
    """Initialise MPI, PETSc and SLEPc and return ``(PETSc, SLEPc)``.  Collective on all ranks.

    ``options`` are the options after ``--`` on the command line, already checked.  No ``.petscrc`` is read,
    since it could execute code from the working directory.  PETSc answers no signals: at its end it would give SIGTERM and
    SIGHUP back to the system, which then end a finished run.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    locate()
    arguments = ["microslip", "-skip_petscrc", "-no_signal_handler", *(options or [])]
    with handlers_unchanged():
        import petsc4py

        petsc4py.init(arguments)
        import slepc4py

        slepc4py.init(arguments)
    return_large_blocks()
    from petsc4py import PETSc
    from slepc4py import SLEPc

    return PETSc, SLEPc


def free(*objects: PETSc.Object) -> None:
    """Destroy objects of PETSc and SLEPc; do nothing after a signal that stops the program.  Collective.

    The signal may have interrupted a solver: PETSc then refuses to free its objects, or crashes, and the other ranks do not take
    part.
    """
    if not is_stopping():
        for each in objects:
            each.destroy()


def without_operands(product: PETSc.Mat) -> PETSc.Mat:
    """Return a copy of a matrix product, which is freed: PETSc stores its operands as long as it exists.  Collective."""
    copy = product.duplicate(copy=True)
    product.destroy()
    return copy


def everyone() -> MPI.Comm:
    """Return the communicator of all ranks, PETSc and SLEPc initialised.  Collective on all ranks."""
    initialise()
    from mpi4py import MPI

    return MPI.COMM_WORLD


def unused_options(options: tuple[str, ...]) -> list[str]:
    """Return the names of ``options`` (names and values as given to PETSc) that no solver has read so far.

    Local; the same on every rank.  Calls PETSc's library directly, since petsc4py has no such function.
    """
    from petsc4py import PETSc

    library = ctypes.CDLL(PETSc.__file__)
    used = ctypes.c_int(0)
    unused = []
    for name in options:
        if name.startswith("-") and name[1:].startswith(PREFIXES):
            library.PetscOptionsUsed(None, name[1:].encode(), ctypes.byref(used))
            if not used.value:
                unused.append(name)
    return unused


def refused_option(problem: BaseException) -> str | None:
    """Return PETSc's message on a refused option value, with the given options; None for any other error.  Local."""
    if getattr(problem, "ierr", None) not in _REFUSED:
        return None
    from petsc4py import PETSc

    given = {name: value for name, value in PETSc.Options().getAll().items() if name.startswith(PREFIXES)}
    if not given:
        return None
    reason = str(problem).splitlines()[-1].partition("] ")[2].strip().rstrip(".")
    options = " ".join(f"-{name} {value}".strip() for name, value in given.items())
    return f"PETSc refuses an option: {reason}; after -- was given: {options}"
