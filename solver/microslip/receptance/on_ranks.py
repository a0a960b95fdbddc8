"""A reduced model for a subset of the ranks, which continue independently of the others."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..parallel.ownership import pairs_of_rank
from .circulant import CirculantColumns, ColumnsOfOtherModes
from .per_group import PerGroup
from .reduced_structure import ReducedStructure
from .static_columns import StaticColumns

if TYPE_CHECKING:
    from mpi4py import MPI

Reduced = TypeVar("Reduced", bound=ReducedStructure)
_BATCH = 128  # pairs whose columns are exchanged together


def on_ranks(model: Reduced, comm: MPI.Comm) -> Reduced:
    """Return the same model, or structure, with its pairs distributed over the ranks of ``comm``, a subset of ``model.comm``.

    Collective on ``model.comm``: computes the receptances of *all* groups of harmonics and the static columns of *all* pairs.
    The factor is distributed over all ranks, so that a subset cannot solve for a pair that slips later.
    """
    receptances = {}
    for group in model.receptances.groups:
        receptance = model.receptances.of_group(group)
        static = replace(receptance.static, G_static=_columns_on(model, receptance.static.G_static, comm))
        sectors = None if receptance.sectors is None else receptance.sectors.on_ranks(comm)
        receptances[group] = replace(receptance, static=static, sectors=sectors)
    per_group = PerGroup(receptances.__getitem__, model.receptances.group_of, model.receptances.groups)
    return replace(model, comm=comm, receptances=per_group)


def _columns_on(model: ReducedStructure, columns: StaticColumns, comm: MPI.Comm) -> StaticColumns:
    """Return the static columns of all pairs with the rows of this rank's pairs in ``comm``.  Collective on ``model.comm``."""
    owned = pairs_of_rank(comm, model.n_pairs)
    if isinstance(columns, (CirculantColumns, ColumnsOfOtherModes)):
        return columns.of_rows(owned)
    first, last = owned.start, owned.stop
    wanted = model.comm.allgather((first, last))
    moved = StaticColumns(model.n_pairs, last - first, _no_solve, is_complex=columns.is_complex)
    for start in range(0, model.n_pairs, _BATCH):
        pairs = np.arange(start, min(start + _BATCH, model.n_pairs))
        rows = columns.transposed(pairs).T  # of the pairs owned in model.comm
        parts = [_rows_between(rows, model.owned, *ends) for ends in wanted]
        moved.put(pairs, np.concatenate(model.comm.alltoall(parts)))  # rank order is row order
    return moved


def _rows_between(rows: np.ndarray, owned: slice, first: int, last: int) -> np.ndarray:
    """Return the part of ``rows`` of the pairs ``owned`` that belongs to the pairs ``first`` to ``last`` - 1.  Local."""
    start = max(first, owned.start)
    stop = max(start, min(last, owned.stop))
    return rows[3 * (start - owned.start) : 3 * (stop - owned.start)]


def _no_solve(pairs: np.ndarray) -> np.ndarray:
    raise AssertionError(f"the columns of all pairs were computed before the split of the ranks, but {len(pairs)} are missing")
