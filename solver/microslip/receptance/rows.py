"""Products of chosen rows of a matrix with few vectors: one pass over what is stored, without a copy of it."""

from __future__ import annotations

import numpy as np

from ._row_products import combine, project


class ChosenRows:
    """The matrix A (m, n) that some rows of a stored matrix make, in double or single precision.  Local.

    Parameters
    ----------
    stored : (n_rows, n), its rows contiguous; not copied
    chosen : (m,) the rows; None: all, in their order
    """

    def __init__(self, stored: np.ndarray, chosen: np.ndarray | None = None):
        assert stored.size == 0 or stored.strides[1] == stored.itemsize, "rows are contiguous"
        self.stored, self.chosen = stored, chosen
        self.m = len(stored) if chosen is None else len(chosen)
        rows = np.arange(self.m) if chosen is None else np.asarray(chosen, dtype=np.intp)
        self._places: np.ndarray = (stored.ctypes.data + stored.strides[0] * rows).astype(np.intp)  # addresses

    @property
    def shape(self) -> tuple[int, int]:
        return self.m, self.stored.shape[1]

    def combined(self, p: np.ndarray) -> np.ndarray:
        """Return p^T A, (N, n), for p (m, N), in the precision of A.  Local."""
        y: np.ndarray = np.zeros((p.shape[1], self.shape[1]), dtype=self.stored.dtype)
        assert len(p) == self.m, "a row of p for each of A"
        if p.size and y.size:
            combine(self._places, self.shape[1], self._as_stored(p), y)
        return y

    def times(self, x: np.ndarray) -> np.ndarray:
        """Return A x, (m, N), for x (n, N), in the precision of A.  Local."""
        y: np.ndarray = np.zeros((self.m, x.shape[1]), dtype=self.stored.dtype)
        assert len(x) == self.shape[1], "a row of x for each column of A"
        if x.size and y.size:
            project(self._places, self.shape[1], self._as_stored(x.T), y)
        return y

    def _as_stored(self, values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values, dtype=self.stored.dtype)

    def columns_into(self, columns: np.ndarray, unit: float, out: np.ndarray) -> None:
        """Write some ``columns`` of A, over ``unit``, into ``out`` (m, n_columns), whatever its precision.  Local."""
        for start in range(0, self.m, _TOGETHER):
            block = slice(start, start + _TOGETHER)
            rows = self.stored[block] if self.chosen is None else self.stored[self.chosen[block]]
            out[block] = rows[:, columns] / unit


_TOGETHER = 96  # rows copied at a time
