"""The static columns of pairs in a journal, in the order in which they are computed.  Rank 0 has the files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..parallel.agree import on_root
from ..parallel.ownership import split_evenly
from ..receptance.static_columns import StaticColumns
from .records import Arrays, Disk, Journal, checked_read, length_of, read_records, unpack

if TYPE_CHECKING:
    from mpi4py import MPI

BATCH = 64  # pairs per message of columns


class ColumnsFile:
    """Columns of G_static by pairs in a file; incomplete records are ignored.  All methods are collective on ``comm``.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written; on every rank
    """

    def __init__(self, comm: MPI.Comm, path: Path, disk: Disk | None = None):
        self.comm, self.path, self._disk = comm, path, disk or Disk()
        self._journal: Journal | None = None

    def restore(self, G_static: StaticColumns, is_known: bool) -> None:
        """Give the stored columns to ``G_static``, as known columns or for use when they are required."""
        records = on_root(self.comm, read_records, self.path, share=False)
        ends = 3 * split_evenly(len(G_static.known), self.comm.size)[self.comm.rank :][:2]
        for i in range(self.comm.bcast(len(records) if records is not None else None)):
            there = on_root(self.comm, checked_read, self.path, self._columns, records, i, len(G_static.known))
            (G_static.put if is_known else G_static.store)(there["pairs"], there["columns"][slice(*ends)])

    def _columns(self, records: Sequence[bytes], i: int, n_pairs: int) -> Arrays:
        """Return the pairs and the columns of a record.

        Raises
        ------
        ValueError : they are not columns of a joint with ``n_pairs`` pairs
        """
        arrays, _ = unpack(records[i])
        pairs, columns = arrays["pairs"], arrays["columns"]
        if pairs.dtype.kind != "i" or columns.dtype.kind not in "fc" or columns.shape != (3 * n_pairs, 3 * pairs.size):
            raise ValueError("no columns of this joint")
        if pairs.ndim != 1 or not ((pairs >= 0) & (pairs < n_pairs)).all():
            raise ValueError("columns of pairs that the joint does not have")
        return {"pairs": pairs, "columns": columns}

    def follow(self, G_static: StaticColumns) -> None:
        """Append the columns of ``G_static`` that the file lacks, now and whenever new ones are computed."""
        there = on_root(self.comm, checked_read, self.path, self._open)
        new = np.flatnonzero(G_static.known)
        new = new[~np.isin(new, there)]
        for start in range(0, len(new), BATCH):
            self._keep(G_static, new[start : start + BATCH])
        G_static.subscribe(lambda pairs: self._keep(G_static, pairs))

    def _open(self) -> np.ndarray:
        """Open the file after its complete records; return their pairs."""
        records = read_records(self.path)
        self._journal = Journal(self.path, keep=length_of(records), disk=self._disk)
        return np.concatenate([np.empty(0, dtype=int), *(unpack(record)[0]["pairs"] for record in records)])

    def _keep(self, G_static: StaticColumns, pairs: np.ndarray) -> None:
        rows = self.comm.gather(G_static.transposed(pairs).T)
        on_root(self.comm, self._append, pairs, rows, share=False)

    def _append(self, pairs: np.ndarray, rows: list[np.ndarray]) -> None:
        self._journal.append({"pairs": pairs, "columns": np.concatenate(rows)})  # rank order is row order


def n_pairs_in(path: Path) -> int:
    """Return the number of pairs with columns in a file.  Rank 0."""
    return len(
        np.unique(np.concatenate([np.empty(0, dtype=int), *(unpack(record)[0]["pairs"] for record in read_records(path))]))
    )
