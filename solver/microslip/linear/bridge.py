"""Availability of the compiled bridge to MUMPS; without it PETSc calls MUMPS for every factor (other_package.py)."""

import ctypes
import importlib
import os

from mpi4py import MPI
from petsc4py import PETSc

from ..messages.errors import CaseError, ResourceError
from ..parallel.agree import on_each

VARIABLE = "MICROSLIP_MUMPS"  # "bridge" or "petsc"; not set: the bridge if available
_CHOICES = ("bridge", "petsc")
_LARGEST = 2**31 - 1  # of MUMPS' integers


def missing() -> str:
    """Return why the bridge is not used, or nothing.  Local.

    Raises
    ------
    CaseError : the environment names neither way to MUMPS, or a bridge that is not there
    """
    choice = os.environ.get(VARIABLE, "")
    if choice not in ("", *_CHOICES):
        raise CaseError(f"{VARIABLE}={choice}: it is one of {', '.join(_CHOICES)}")
    if choice == "petsc":
        return f"{VARIABLE}=petsc"
    fault = _fault()
    if fault and choice == "bridge":
        raise CaseError(f"{VARIABLE}=bridge: {fault}")
    return fault


def _fault() -> str:
    """Return why the bridge cannot be used, or nothing.  Local."""
    try:
        importlib.import_module("microslip.linear._mumps")
    except ImportError as problem:
        return f"microslip was installed without MUMPS' headers ({problem})"
    if not hasattr(ctypes.CDLL(PETSc.__file__), "dmumps_c"):
        return "PETSc's libraries do not show MUMPS' own functions"
    return ""


def is_there(comm: MPI.Comm) -> bool:
    """Return whether every rank has the bridge.  Collective on ``comm``.

    Raises
    ------
    CaseError : as :func:`missing`; on every rank
    """
    return comm.allreduce(not on_each(comm, missing), op=MPI.LAND)


def within_int32(number: int, of_what: str) -> int:
    """Return a number as an integer of 32 bits for MUMPS.  Local.

    Raises
    ------
    ResourceError : it is too large for that
    """
    if not 0 <= number <= _LARGEST:
        raise ResourceError(f"{number} {of_what}: MUMPS' integers end at {_LARGEST}; use a coarser mesh, or more ranks")
    return int(number)
