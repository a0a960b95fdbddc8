"""Even distribution of items over ranks, rows of pairs, sums over ranks and gathers of rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mpi4py import MPI


def split_evenly(n: int, size: int) -> np.ndarray:
    """Return (size + 1,) limits that distribute n items over ``size`` ranks; a rank may have none.  Local."""
    return np.array([n * rank // size for rank in range(size + 1)])


def pairs_of_rank(comm: MPI.Comm, n_pairs: int) -> slice:
    """Return the pairs of this rank among ``n_pairs``.  Local."""
    return slice(*map(int, split_evenly(n_pairs, comm.size)[comm.rank : comm.rank + 2]))


def rows_of(pairs: np.ndarray) -> np.ndarray:
    """Return the three rows of each pair or place ``pairs`` (m,), (3 m,).  Local."""
    return (3 * np.asarray(pairs)[:, None] + np.arange(3)).ravel()


def summed(comm: MPI.Comm, partial: np.ndarray) -> np.ndarray:
    """Return the sum of ``partial`` over the ranks, on every rank.  Collective on ``comm``: one sum."""
    part = np.array(partial, dtype=complex if np.iscomplexobj(partial) else float, order="C")
    total = np.empty_like(part)
    comm.Allreduce(part, total)
    return total


def gathered_rows(comm: MPI.Comm, owned: np.ndarray, limits: np.ndarray, root: int | None = None) -> np.ndarray | None:
    """Return the rows of all ranks, (limits[-1], n); this rank owns the rows limits[rank] to limits[rank + 1].

    Collective on ``comm``: one gather.  Result on every rank, or on ``root`` only and None elsewhere.  No copy on one rank.
    """
    if comm.size == 1:
        return owned
    part, n = np.ascontiguousarray(owned, dtype=float), owned.shape[1]
    gathered = np.empty((limits[-1], n)) if root in (None, comm.rank) else None
    parts = [gathered, n * np.diff(limits)]
    if root is None:
        comm.Allgatherv(part, parts)
    else:
        comm.Gatherv(part, parts if comm.rank == root else None, root)
    return gathered
