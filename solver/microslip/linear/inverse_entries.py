"""Some entries of the inverse of a factored matrix: MUMPS then passes only the branches of its elimination tree that they need.

petsc4py does not offer what PETSc has for it, so its library is asked itself.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

_INVERSE_ENTRIES, _DISTRIBUTED_SOLUTION, _AT_ONCE = 30, 21, 27  # ICNTL that PETSc changes and leaves so, and columns at once
_ON_DISK = 22
_FROM_DISK = 1024  # columns at once: each time the factor is read again


def inverse_entries(F: PETSc.Mat, rows: np.ndarray, columns: np.ndarray) -> np.ndarray | None:
    """Return the entries of A^-1 in some rows and columns, (n_rows, n_columns) on rank 0, (0, 0) elsewhere.

    Collective.  Of a pair of entries that are equal by symmetry one is asked for.  Unchecked.

    Parameters
    ----------
    F : factor by MUMPS of a symmetric matrix A
    rows, columns : different global rows of A each, rising; the same on every rank

    Returns
    -------
    entries : None, on every rank, where PETSc does not offer them or MUMPS refuses: too little memory
    """
    function = _function()
    if function is None:
        return None
    comm, n_dof = F.comm.tompi4py(), F.getSize()[0]
    here = comm.rank == 0
    if not here:
        rows = columns = np.empty(0, dtype=int)
    is_asked = ~_known_by_symmetry(rows, columns)
    indptr, indices = _wanted(rows, columns, is_asked, n_dof * here)
    wanted = PETSc.Mat().createAIJ(
        ((n_dof * here, n_dof), (n_dof * here, n_dof)), csr=(indptr, indices, np.zeros(len(indices))), comm=comm
    )
    has_answered = _answered(function, F, wanted)
    values = wanted.getValuesCSR()[2] if here else np.empty(0)
    wanted.destroy()
    if not comm.allreduce(has_answered, MPI.LAND):
        return None
    entries = np.zeros(is_asked.shape)
    entries[is_asked] = values
    k, i = np.nonzero(~is_asked)
    entries[k, i] = entries[np.searchsorted(columns, rows[i]), np.searchsorted(rows, columns[k])]
    return entries.T


def _known_by_symmetry(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return (n_columns, n_rows) bool: entries whose mirror image below the diagonal is among the others.  Local."""
    in_both = np.isin(columns, rows)[:, None] & np.isin(rows, columns)
    return in_both & (rows < columns[:, None])


def _wanted(rows: np.ndarray, columns: np.ndarray, is_asked: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (indptr, indices) of the transposed pattern, with ``n`` rows.  Local."""
    counts = np.zeros(n, dtype=int)
    counts[columns] = np.count_nonzero(is_asked, axis=1)
    indptr = np.concatenate([[0], np.cumsum(counts)])
    indices = np.broadcast_to(rows, is_asked.shape)[is_asked]
    return indptr.astype(PETSc.IntType), indices.astype(PETSc.IntType)


def _answered(function: Callable[[int, int], int], F: PETSc.Mat, wanted: PETSc.Mat) -> bool:
    """Put the entries of the inverse into the transposed pattern ``wanted``; return whether MUMPS did.  Collective."""
    pattern = PETSc.Mat().createTranspose(wanted)
    before = {which: F.getMumpsIcntl(which) for which in (_INVERSE_ENTRIES, _DISTRIBUTED_SOLUTION, _AT_ONCE)}
    if F.getMumpsIcntl(_ON_DISK) == 1:
        F.setMumpsIcntl(_AT_ONCE, _FROM_DISK)
    try:
        return function(F.handle, pattern.handle) == 0
    finally:
        for which, value in before.items():
            F.setMumpsIcntl(which, value)
        pattern.destroy()


@lru_cache(maxsize=1)
def _function() -> Callable[[int, int], int] | None:
    """Return PETSc's MatMumpsGetInverse, None of a library without it.  Local."""
    function = getattr(ctypes.CDLL(PETSc.__file__), "MatMumpsGetInverse", None)
    if function is not None:
        function.argtypes, function.restype = [ctypes.c_void_p, ctypes.c_void_p], ctypes.c_int
    return function
