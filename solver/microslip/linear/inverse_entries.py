"""Entries of the inverse of a factored matrix: MUMPS then passes only those branches of its elimination tree that they need."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from ..system.watchdog import patient
from .bridge import within_int32

if TYPE_CHECKING:
    from ._mumps import Instance

_INVERSE_ENTRIES, _SIDES, _DISTRIBUTED_SOLUTION, _AT_ONCE = 30, 20, 21, 27  # ICNTL, the last that of columns at once
_SOLVE = 3
_ON_DISK = 22
_COLUMNS, _FROM_DISK = 512, 1024  # at once; on disk the factor is read again each time


def inverse_entries(mumps: Instance, comm: MPI.Comm, n: int, rows: np.ndarray, columns: np.ndarray) -> np.ndarray | None:
    """Return the entries of A^-1 in some rows and columns, (n_rows, n_columns) on rank 0, (0, 0) elsewhere.

    Collective.  Of two entries that are equal by symmetry one is computed.  Unchecked.

    Parameters
    ----------
    mumps : with the factor of a symmetric matrix A (n, n)
    rows, columns : different global rows of A each, rising; the same on every rank

    Returns
    -------
    entries : None, on every rank, where MUMPS refuses: too little memory

    Raises
    ------
    ResourceError : more entries than MUMPS can count; on every rank
    """
    within_int32(len(rows) * len(columns) + 1, "entries of the inverse at once")
    here = comm.rank == 0
    if not here:
        rows = columns = np.empty(0, dtype=int)
    is_requested = ~_known_by_symmetry(rows, columns)
    starts, indices = _wanted(rows, columns, is_requested, n)
    values = np.zeros(len(indices))
    if here:
        mumps.set_sparse(n, starts, indices, values)
    has_answered = _has_answered(mumps)
    mumps.drop()
    if not has_answered:
        return None
    entries = np.zeros(is_requested.shape)
    entries[is_requested] = values
    k, i = np.nonzero(~is_requested)
    entries[k, i] = entries[np.searchsorted(columns, rows[i]), np.searchsorted(rows, columns[k])]
    return entries.T


def _known_by_symmetry(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return (n_columns, n_rows) bool: entries whose mirror image below the diagonal is among the others.  Local."""
    in_both = np.isin(columns, rows)[:, None] & np.isin(rows, columns)
    return in_both & (rows < columns[:, None])


def _wanted(rows: np.ndarray, columns: np.ndarray, is_requested: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the starts of ``n`` columns and the rows wanted in them, both from 1.  Local."""
    counts = np.zeros(n, dtype=int)
    counts[columns] = np.count_nonzero(is_requested, axis=1)
    starts = np.concatenate([[0], np.cumsum(counts)])
    indices = np.broadcast_to(rows, is_requested.shape)[is_requested]
    return (starts + 1).astype(np.int32), (indices + 1).astype(np.int32)


def _has_answered(mumps: Instance) -> bool:
    """Let MUMPS find the entries that were stated; return whether it did.  Collective; the same on every rank."""
    before = {control: mumps.icntl(control) for control in (_INVERSE_ENTRIES, _SIDES, _DISTRIBUTED_SOLUTION, _AT_ONCE)}
    mumps.set_icntl(_INVERSE_ENTRIES, 1)
    mumps.set_icntl(_SIDES, 0)
    mumps.set_icntl(_DISTRIBUTED_SOLUTION, 0)
    mumps.set_icntl(_AT_ONCE, _FROM_DISK if mumps.icntl(_ON_DISK) == 1 else _COLUMNS)
    with patient():
        code = mumps.run(_SOLVE)
    for control, value in before.items():
        mumps.set_icntl(control, value)
    return code >= 0
