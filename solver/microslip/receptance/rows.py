"""Products of a matrix with few vectors; its rows may be anywhere in memory, and are read once without a copy."""

from __future__ import annotations

import numpy as np

from ._row_products import combine, pick, project


class Rows:
    """A matrix A (m, n) given by the addresses of its rows, in double or single precision.  Local.

    Parameters
    ----------
    places : (m,) addresses of the rows, each with ``n`` contiguous numbers
    precision : of the numbers, np.float64 or np.float32
    owner : the object that owns the memory of the rows, referenced to keep it alive
    """

    def __init__(self, places: np.ndarray, n: int, precision: type, owner: object):
        self._places, self.shape, self.precision, self._owner = places, (len(places), n), precision, owner

    @classmethod
    def of(cls, A: np.ndarray) -> Rows:
        """Return the rows of an array, which is not copied."""
        return cls(places_of(A), A.shape[1], A.dtype.type, A)

    def part(self, chosen: np.ndarray) -> Rows:
        """Return the rows ``chosen`` (k,), in the same memory."""
        return Rows(self._places[chosen], self.shape[1], self.precision, self._owner)

    def combined(self, p: np.ndarray) -> np.ndarray:
        """Return p^T A, (N, n), for p (m, N), in the precision of A."""
        assert len(p) == self.shape[0], "a row of p for each of A"
        y: np.ndarray = np.zeros((p.shape[1], self.shape[1]), dtype=self.precision)
        if p.size and y.size:
            combine(self._places, self.shape[1], np.ascontiguousarray(p, dtype=self.precision), y)
        return y

    def times(self, x: np.ndarray) -> np.ndarray:
        """Return A x, (m, N), for x (n, N), in the precision of A."""
        assert len(x) == self.shape[1], "a row of x for each column of A"
        y: np.ndarray = np.zeros((self.shape[0], x.shape[1]), dtype=self.precision)
        if x.size and y.size:
            project(self._places, self.shape[1], np.ascontiguousarray(x.T, dtype=self.precision), y)
        return y

    def columns(self, wanted: np.ndarray) -> np.ndarray:
        """Return a copy of the columns ``wanted`` (k,), (m, k), of A in double precision."""
        columns = np.empty((self.shape[0], len(wanted)))
        self.write_columns(wanted, 1.0, columns)
        return columns

    def write_columns(self, wanted: np.ndarray, unit: float, out: np.ndarray) -> None:
        """Write the columns ``wanted`` (k,), divided by ``unit``, into ``out`` (m, k) of any precision; A must be double."""
        assert self.precision is np.float64 and out.shape == (self.shape[0], len(wanted))
        if out.size:
            pick(self._places, np.ascontiguousarray(wanted, dtype=np.intp), unit, out)


def places_of(A: np.ndarray) -> np.ndarray:
    """Return the addresses of the rows of an array, (m,)."""
    assert A.size == 0 or A.strides[1] == A.itemsize, "rows are contiguous"
    return A.ctypes.data + A.strides[0] * np.arange(len(A), dtype=np.intp)
