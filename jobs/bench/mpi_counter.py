"""What a process says to others by MPI, counted below Python, PETSc and MUMPS: a library compiled at run time and preloaded.

mpi_counter.c says what is counted.  In a process that began with it, ``counters`` reads it.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np

KINDS = ("sums", "gathers", "exchanges", "messages", "waits")
_COMPILER = ("cc", "gcc", "clang")
_LIBRARY = "from mpi4py import MPI; print(MPI.get_vendor()[0]); print(*(line.split()[-1] for line in open('/proc/self/maps') if 'libmpi.so' in line))"


def compiled(folder: Path) -> Path:
    """Return the library that counts, made in ``folder``.  Local.

    Raises
    ------
    SystemExit : no C compiler, or another MPI than Open MPI
    """
    compiler = next(filter(None, map(shutil.which, _COMPILER)), None)
    said = subprocess.run([sys.executable, "-c", _LIBRARY], stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()
    if compiler is None or said[0] != "Open MPI" or not said[1].split():
        sys.exit(f"counting messages needs a C compiler and Open MPI; found {compiler or 'no compiler'} and {said[0]}")
    folder.mkdir(parents=True, exist_ok=True)
    made = (folder / "mpi_counter.so").resolve()
    source = Path(__file__).with_suffix(".c")
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", made, source, said[1].split()[0], "-ldl"], check=True)
    return made


def preloading(library: Path) -> list[str]:
    """Return what stands before a command that is to be counted."""
    return ["env", f"LD_PRELOAD={library}", f"MICROSLIP_MPI_COUNTER={library}"]


@lru_cache(maxsize=1)
def _numbers() -> np.ndarray:
    """Return the counters of this process, which change under it."""
    library = ctypes.CDLL(os.environ["MICROSLIP_MPI_COUNTER"])
    return np.ctypeslib.as_array((ctypes.c_double * (2 + 2 * len(KINDS))).in_dll(library, "microslip_mpi"))


def counters() -> np.ndarray:
    """Return (2 + 2 n_kinds,): wall and processor seconds in MPI so far, calls by kind, bytes by kind.  Local."""
    return _numbers().copy()
