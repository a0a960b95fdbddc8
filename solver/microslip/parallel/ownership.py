"""Who owns what where nothing but the count decides, which rows belong to what, and sums over all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mpi4py import MPI


def split_evenly(n: int, size: int) -> np.ndarray:
    """Return (size + 1,) limits that split n items over ``size`` ranks; a rank may get none.  Local."""
    return np.array([n * rank // size for rank in range(size + 1)])


def rows_of(those: np.ndarray) -> np.ndarray:
    """Return the three rows of each of some pairs or places (m,), (3 m,).  Local."""
    return (3 * np.asarray(those)[:, None] + np.arange(3)).ravel()


def summed(comm: MPI.Comm, partial: np.ndarray) -> np.ndarray:
    """Return the sum of ``partial`` over the ranks, on every rank.  Collective on ``comm``: one sum."""
    own = np.array(partial, dtype=float, order="C")
    total = np.empty_like(own)
    comm.Allreduce(own, total)
    return total
