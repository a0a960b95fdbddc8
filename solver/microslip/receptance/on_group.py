"""A reduced model for a group of ranks that goes on without the others."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..parallel.ownership import split_evenly
from .reduced_structure import ReducedStructure
from .static_columns import StaticColumns

if TYPE_CHECKING:
    from mpi4py import MPI

Reduced = TypeVar("Reduced", bound=ReducedStructure)
_BATCH = 128  # pairs whose columns travel together


def on_group(model: Reduced, comm: MPI.Comm) -> Reduced:
    """Return the same model, or structure, with its pairs split over the ranks of ``comm``, a part of those of ``model.comm``.

    Collective on ``model.comm``: the static columns of *all* pairs are solved for.  The factor is spread over all ranks, so
    that a group by itself cannot solve for a pair that leaves sticking later.
    """
    pair_ranges = split_evenly(model.n_pairs, comm.size)
    first, last = (int(pair) for pair in pair_ranges[comm.rank : comm.rank + 2])
    wanted = model.comm.allgather((first, last))
    G_static = StaticColumns(model.n_pairs, last - first, _no_solve)
    for start in range(0, model.n_pairs, _BATCH):
        pairs = np.arange(start, min(start + _BATCH, model.n_pairs))
        rows = model.G_static.transposed(pairs).T  # of the pairs owned in model.comm
        shares = [_rows_between(rows, model.owned, *ends) for ends in wanted]
        G_static.put(pairs, np.concatenate(model.comm.alltoall(shares)))  # rank order is row order
    return replace(model, comm=comm, pair_ranges=pair_ranges, G_static=G_static)


def _rows_between(rows: np.ndarray, owned: slice, first: int, last: int) -> np.ndarray:
    """Return those of ``rows``, of the pairs ``owned``, that belong to the pairs ``first`` to ``last`` - 1.  Local."""
    start = max(first, owned.start)
    stop = max(start, min(last, owned.stop))
    return rows[3 * (start - owned.start) : 3 * (stop - owned.start)]


def _no_solve(pairs: np.ndarray) -> np.ndarray:
    raise AssertionError(f"the columns of all pairs were solved for before the ranks parted, but {len(pairs)} are missing")
