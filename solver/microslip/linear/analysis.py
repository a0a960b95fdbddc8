"""The analysis of a factorisation by MUMPS before its numbers: how much memory it will take, on each rank.

petsc4py does not offer PETSc's symbolic factorisation, so its library is asked itself.  The factorisation that follows uses the
same analysis again.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

from petsc4py import PETSc

_MB = 1e6  # bytes of what MUMPS calls a megabyte
_BYTES_AN_ENTRY = 12.0  # of a matrix: its value and its place
_MATRIX_INFO = 32  # numbers, more than PETSc's MatFactorInfo has; MUMPS reads none
_SYMBOLIC = {PETSc.PC.Type.CHOLESKY: "MatCholeskyFactorSymbolic", PETSc.PC.Type.LU: "MatLUFactorSymbolic"}


@dataclass(frozen=True)
class FactorMemory:
    """What MUMPS estimates of a factorisation on this rank; the entries are of all ranks."""

    in_core: float  # bytes
    out_of_core: float  # bytes in memory, the factor on disk
    on_disk: float  # bytes of the factor, out of core
    entries: int  # of the factor


def analyse(pc: PETSc.PC, A: PETSc.Mat) -> int | None:
    """Do the symbolic factorisation of A by the factor of ``pc``; return MUMPS' INFOG(1), 0 or negative.

    Collective.  None, on every rank, where PETSc's library has no such function.  ``pc`` (Cholesky or LU by MUMPS) has its factor
    already, without numbers.
    """
    function = _function(_SYMBOLIC[pc.getType()])
    if function is None:
        return None
    F = pc.getFactorMatrix()
    before = ctypes.c_void_p(F.handle), ctypes.c_void_p(A.handle)
    orderings = [None] if pc.getType() == PETSc.PC.Type.CHOLESKY else [None, None]  # MUMPS has its own
    status = function(*before, *orderings, (ctypes.c_double * _MATRIX_INFO)())
    if status != 0:
        raise PETSc.Error(status)
    return min(0, F.getMumpsInfog(1))


def factor_memory(F: PETSc.Mat) -> FactorMemory:
    """Return the memory that the numbers of an analysed factor will take on this rank.  Local."""
    return FactorMemory(
        in_core=_MB * F.getMumpsInfo(15),
        out_of_core=_MB * F.getMumpsInfo(17),
        on_disk=8.0 * count(F.getMumpsInfo(3)),
        entries=count(F.getMumpsInfog(20)),
    )


def scaled_memory(F: PETSc.Mat, n_dof_each: int, entries_owned: int) -> FactorMemory:
    """Return the memory of a factor on this rank from the analysed graph of its nodes, of ``n_dof_each`` unknowns each.  Local.

    Fronts have as many times the rows, and so the square of it of entries; to them come the entries of the matrix itself, half of
    ``entries_owned`` with their places.
    """
    size = 8.0 * n_dof_each**2
    of_matrix = _BYTES_AN_ENTRY * entries_owned / 2.0
    factor = size * count(F.getMumpsInfo(3))
    return FactorMemory(
        in_core=size * count(F.getMumpsInfo(8)) + of_matrix,
        out_of_core=_MB * n_dof_each * F.getMumpsInfo(17) + of_matrix,
        on_disk=factor,
        entries=n_dof_each**2 * count(F.getMumpsInfog(20)),
    )


def count(value: int) -> int:
    """Return a count that MUMPS gives in millions, as a negative number, where it exceeds 32 bits.  Local."""
    return value if value >= 0 else -value * 1_000_000


@lru_cache(maxsize=2)
def _function(name: str) -> Callable[..., int] | None:
    """Return a function of PETSc's library, None of a library without it.  Local."""
    function = getattr(ctypes.CDLL(PETSc.__file__), name, None)
    if function is not None:
        function.restype = ctypes.c_int
    return function
