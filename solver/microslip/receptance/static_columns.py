"""Columns of the static receptance G_static = R K_L^-1 R^T, solved for when a pair first leaves sticking."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np

from .rows import ChosenRows

BATCH = 24  # pairs solved for together: a few more right-hand sides cost little beside another pass
_BLOCK = 64  # pairs looked at together where all columns are gone through


class StaticColumns:
    """G_static by columns: p vanishes where a pair sticks, so only the others' columns are ever needed.

    Pairs that are likely to follow the missing ones are solved for with them, ``BATCH`` at a time, in the order of ``likely``.

    Parameters
    ----------
    n_pairs, n_owned : pairs in all, and those whose rows this rank keeps
    solve : collective; takes pair numbers (m,) and returns this rank's rows of their columns, (3 n_owned, 3 m) [m/N]
    """

    def __init__(self, n_pairs: int, n_owned: int, solve: Callable[[np.ndarray], np.ndarray]):
        self.solve = solve
        # transposed, so that a pair's columns lie together; pages that no pair needs are never touched
        self._columns = np.empty((3 * n_pairs, 3 * n_owned))
        self.known = np.zeros(n_pairs, dtype=bool)
        self._largest = np.zeros(n_pairs)  # of the columns' entries, on this rank
        self.likely = np.empty(0, dtype=int)
        self.batches, self.seconds = 0, 0.0  # solved for, and the time that took
        self.on_new: Callable[[np.ndarray], None] = lambda pairs: None  # collective; hears of pairs whose columns were solved for
        self._last: tuple[np.ndarray, ChosenColumns] | None = None  # pairs chosen last, and their columns

    def require(self, pairs: np.ndarray) -> None:
        """Solve for the columns of ``pairs`` (m,) that are not known yet.  Collective; the same pairs on every rank."""
        missing = pairs[~self.known[pairs]]
        if len(missing) == 0:
            return
        others = self.likely[~self.known[self.likely] & ~np.isin(self.likely, missing)]
        missing = np.concatenate([missing, others[: max(BATCH - len(missing), 0)]])
        start = perf_counter()
        self.put(missing, self.solve(missing))
        self.batches, self.seconds = self.batches + 1, self.seconds + perf_counter() - start
        self.on_new(missing)

    def put(self, pairs: np.ndarray, columns: np.ndarray) -> None:
        """Take in this rank's rows of the columns of ``pairs`` (m,), (3 n_owned, 3 m) [m/N].  Local."""
        by_pair = columns.T.reshape(len(pairs), 3, -1)
        for start in range(0, len(pairs), _BLOCK):
            block = slice(start, start + _BLOCK)
            self._columns[rows_of(pairs[block])] = by_pair[block].reshape(-1, columns.shape[0])
            self._largest[pairs[block]] = np.abs(by_pair[block]).max(axis=(1, 2), initial=0.0)
        self.known[pairs] = True

    def chosen(self, pairs: np.ndarray) -> ChosenColumns:
        """Return the columns of ``pairs`` (m,), which are not copied.  Collective where some are new."""
        self.require(pairs)
        if self._last is None or not np.array_equal(self._last[0], pairs):
            rows = None if len(pairs) == len(self.known) and np.array_equal(pairs, np.arange(len(pairs))) else rows_of(pairs)
            self._last = pairs, ChosenColumns(self._columns, rows, float(self._largest[pairs].max(initial=0.0)))
        return self._last[1]

    def transposed(self, pairs: np.ndarray) -> np.ndarray:
        """Return the columns of ``pairs``, transposed, (3 m, 3 n_owned) [m/N]; a copy unless they are all there are, in order.

        Collective where some are new.
        """
        chosen = self.chosen(pairs)
        return self._columns if chosen.chosen is None else self._columns[chosen.chosen]


class ChosenColumns(ChosenRows):
    """This rank's rows of the columns of some pairs, as the rows of the transposed matrix, (3 m, 3 n_owned) [m/N]."""

    def __init__(self, stored: np.ndarray, chosen: np.ndarray | None, largest: float):
        super().__init__(stored, chosen)
        self.largest = largest  # of its entries, in size


def rows_of(pairs: np.ndarray) -> np.ndarray:
    """Return the three rows of each of the ``pairs`` (m,), (3 m,)."""
    return (3 * np.asarray(pairs)[:, None] + np.arange(3)).ravel()
