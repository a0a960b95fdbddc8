"""Compilation of the C code of the oracles when it is first needed."""

from __future__ import annotations

import ctypes
import subprocess
import sysconfig
import tempfile
from functools import lru_cache
from pathlib import Path


@lru_cache
def compiled(name: str) -> ctypes.CDLL:
    """Return the library of a C file of this folder."""
    compiler = (sysconfig.get_config_var("CC") or "cc").split()[0]
    with tempfile.TemporaryDirectory() as folder:  # a loaded library remains usable after the folder is deleted
        library, source = f"{folder}/{name}.so", Path(__file__).with_name(f"{name}.c")
        subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", library, str(source), "-lm"], check=True)
        return ctypes.CDLL(library)


def arguments(*values):
    """Return integers and arrays as arguments of a C function."""
    return [ctypes.c_int(v) if isinstance(v, int) else v.ctypes.data_as(ctypes.c_void_p) for v in values]
