"""Columns of the static receptance G_static = R K_L^-1 R^T, computed when a pair first slips or opens."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np

from .rows import Rows, places_of

BATCH = 24  # pairs per solve: additional right-hand sides cost little compared with another pass over the factor
FROM_DISK = 96  # the same if each pass reads the factor from disk
_PART_BYTES = 2.5e8  # of columns per solve, over all ranks: these are temporarily in memory twice


class StaticColumns:
    """G_static by columns: p vanishes where a pair sticks, so that only the columns of other pairs are needed.

    A solve for missing pairs includes pairs that are likely to slip next, in the order of ``likely``: up to ``batch`` pairs,
    later as many as are already known, so that a joint with growing slip needs few passes.

    Parameters
    ----------
    n_pairs, n_owned : number of all pairs, and of pairs whose rows this rank stores
    solve : collective; takes pair numbers (m,) and returns this rank's rows of their columns, (3 n_owned, 3 m) [m/N]
    batch : smallest number of pairs per solve
    is_complex : whether columns are complex, G_static = R K_L^-1 R^H
    grows : whether batches become as large as the number of known pairs; of no use where columns are products
    """

    def __init__(
        self,
        n_pairs: int,
        n_owned: int,
        solve: Callable[[np.ndarray], np.ndarray],
        batch: int = BATCH,
        is_complex: bool = False,
        grows: bool = True,
    ):
        self.solve, self.batch, self.is_complex, self.grows = solve, batch, is_complex, grows
        self.n_owned = n_owned
        # transposed, so that the columns of a pair are contiguous; stored in the order of computation, without spare memory
        self._blocks: list[np.ndarray] = []
        self._places = np.zeros((n_pairs, 3), dtype=np.intp)  # addresses of the columns of each pair
        self.known = np.zeros(n_pairs, dtype=bool)  # required pairs
        self.stored = np.zeros(n_pairs, dtype=bool)  # stored pairs, from an earlier run if not required
        self._largest = np.zeros(n_pairs)  # magnitude of the columns' entries, on this rank
        self.likely = np.empty(0, dtype=int)
        self.batches, self.seconds = 0, 0.0  # number of solved batches, and their time
        self.on_new: Callable[[np.ndarray], None] = lambda pairs: None  # collective; called with pairs that have become known
        self._last: tuple[np.ndarray, ChosenColumns] | None = None  # pairs chosen last, and their columns

    def expect(self, pairs: np.ndarray) -> None:
        """Set the order in which batches are filled with missing pairs.  Local; the same on every rank."""
        self.likely = pairs

    def subscribe(self, listener: Callable[[np.ndarray], None]) -> None:
        """Call ``listener``, which is collective, with pairs whose columns become known from now on.  Local."""
        self.on_new = listener

    def require(self, pairs: np.ndarray) -> None:
        """Compute the missing columns of ``pairs`` (m,).  Collective; the same pairs on every rank."""
        missing = pairs[~self.known[pairs]]
        if len(missing) == 0:
            return
        expected = self.likely[~self.known[self.likely] & ~np.isin(self.likely, missing)]
        together = max(int(_PART_BYTES / (72 * len(self.known))), self.batch)
        wanted = min(max(self.batch, self.grows * np.count_nonzero(self.known)), together)
        missing = np.concatenate([missing, expected[: max(wanted - len(missing), 0)]])
        start = perf_counter()
        for first in range(0, len(missing), together):
            part = missing[first : first + together]
            new = part[~self.stored[part]]
            if len(new):
                self.store(new, self.solve(new))
            self.known[part] = True
            self.on_new(part)
        self.batches, self.seconds = self.batches + 1, self.seconds + perf_counter() - start

    def put(self, pairs: np.ndarray, columns: np.ndarray) -> None:
        """Store this rank's rows of the columns of ``pairs`` (m,), (3 n_owned, 3 m) [m/N], as known.  Local."""
        self.store(pairs, columns)
        self.known[pairs] = True

    def store(self, pairs: np.ndarray, columns: np.ndarray) -> None:
        """Store columns without marking them as known, since the points of a curve depend on the order of required columns.

        Local.  Raises ValueError: they are not those of the pairs on this rank's rows.
        """
        if columns.shape != (3 * self.n_owned, 3 * len(pairs)):  # products read by address, and past the end of shorter columns
            raise ValueError(f"columns of {len(pairs)} pairs in {self.n_owned} rows of pairs have the shape {columns.shape}")
        block = np.ascontiguousarray(columns.T, dtype=complex if self.is_complex else float)
        self._blocks.append(block)
        self._places[pairs] = places_of(block).reshape(-1, 3)
        self._largest[pairs] = np.abs(block).reshape(len(pairs), -1).max(axis=1, initial=0.0)
        self.stored[pairs], self._last = True, None

    def chosen(self, pairs: np.ndarray) -> ChosenColumns:
        """Return the columns of ``pairs`` (m,), without a copy.  Collective if some are missing."""
        self.require(pairs)
        return self.of_stored(pairs)

    def of_stored(self, pairs: np.ndarray) -> ChosenColumns:
        """Return the columns of ``pairs`` (m,), all of them stored, without a copy.  Local."""
        if self._last is None or not np.array_equal(self._last[0], pairs):
            largest = float(self._largest[pairs].max(initial=0.0))
            kind = ComplexColumns if self.is_complex else ChosenColumns
            self._last = pairs, kind(self._places[pairs].ravel(), 3 * self.n_owned, self._blocks, largest)
        return self._last[1]

    def transposed(self, pairs: np.ndarray) -> np.ndarray:
        """Return a copy of the columns of ``pairs``, transposed, (3 m, 3 n_owned) [m/N].  Collective if some are missing."""
        return self.chosen(pairs).columns(np.arange(3 * self.n_owned))

    def conjugated(self) -> StaticColumns:
        """Return a view of the complex conjugate of G_static: no column is copied or computed twice.  Local."""
        return ConjugateStaticColumns(self) if self.is_complex else self


class ConjugateStaticColumns(StaticColumns):
    """The complex conjugate of G_static, as a view of the columns of ``base``, which computes them and counts its solves.

    The groups of nodal diameters d and N - d have conjugate receptances.
    """

    def __init__(self, base: StaticColumns):
        super().__init__(0, base.n_owned, lambda pairs: base.solve(pairs).conj(), base.batch, is_complex=True)
        self._base, self.known, self.stored = base, base.known, base.stored

    def expect(self, pairs: np.ndarray) -> None:
        """Set the order of missing pairs for both, as :meth:`StaticColumns.expect`.  Local."""
        self._base.expect(pairs)

    def subscribe(self, listener: Callable[[np.ndarray], None]) -> None:
        """Subscribe to the columns of both, as :meth:`StaticColumns.subscribe`.  Local."""
        self._base.subscribe(listener)

    def require(self, pairs: np.ndarray) -> None:
        """Compute missing columns of both, as :meth:`StaticColumns.require`.  Collective."""
        self._base.require(pairs)

    def store(self, pairs: np.ndarray, columns: np.ndarray) -> None:
        """Store the conjugates of ``columns`` in the base, as :meth:`StaticColumns.store`.  Local."""
        self._base.store(pairs, columns.conj())

    def of_stored(self, pairs: np.ndarray) -> ChosenColumns:
        """Return the conjugates of stored columns of ``pairs`` (m,), without a copy.  Local."""
        return ConjugateColumns.of_columns(self._base.of_stored(pairs))

    def conjugated(self) -> StaticColumns:
        """Return the columns of ``base``.  Local."""
        return self._base


class ChosenColumns(Rows):
    """Columns of some pairs on this rank, stored transposed, (3 m, 3 n_owned) [m/N]."""

    def __init__(self, places: np.ndarray, n: int, blocks: object, largest: float):
        super().__init__(places, n, np.float64, blocks)
        self.largest = largest  # largest magnitude of the entries
        self._adjoint: tuple[np.ndarray, np.ndarray] | None = None  # the last x and its product

    def part(self, chosen: np.ndarray) -> ChosenColumns:
        """Return the columns ``chosen`` (k,), in the same memory."""
        return type(self)(self._places[chosen], self.n_rows, self._owner, self.largest)

    @property
    def n_rows(self) -> int:
        """The number of this rank's rows."""
        return self.shape[1]

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return the real coefficients of G p, (n_rows, N_H) [m], for forces p (3 m, N_H) [N]."""
        return self.combined(p).T

    def apply_adjoint(self, x: np.ndarray) -> np.ndarray:
        """Return this rank's part of the real coefficients of G^H x, (3 m, N_H), for x (n_rows, N_H).

        Cached for the last x: a row of continuation by arc length is the same in all Newton iterations of a point.
        """
        if self._adjoint is None or not np.array_equal(x, self._adjoint[0]):
            self._adjoint = x.copy(), self._adjoint_times(x)
        return self._adjoint[1]

    def _adjoint_times(self, x: np.ndarray) -> np.ndarray:
        return self.times(x)


class ComplexColumns(ChosenColumns):
    """Complex columns, stored as a real matrix with alternating real and imaginary parts of the rows."""

    def __init__(self, places: np.ndarray, n: int, blocks: object, largest: float):
        super().__init__(places, 2 * n, blocks, largest)

    @property
    def n_rows(self) -> int:
        """The number of complex rows."""
        return self.shape[1] // 2

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return G p as the base class; amplitudes are cos - i sin, and there is no mean."""
        product = self.combined(p).view(complex)  # (N_H, n_rows), of cosines and of sines
        cos, sin = product[0::2], product[1::2]
        y = np.empty((self.n_rows, p.shape[1]))
        y[:, 0::2], y[:, 1::2] = (cos.real + sin.imag).T, (sin.real - cos.imag).T
        return y

    def _adjoint_times(self, x: np.ndarray) -> np.ndarray:
        """Return G^H x; amplitudes are cos - i sin, and there is no mean."""
        sides = np.empty((self.n_rows, 2, x.shape[1]))
        cos, sin = x[:, 0::2], x[:, 1::2]
        sides[:, 0, 0::2], sides[:, 1, 0::2] = cos, -sin
        sides[:, 0, 1::2], sides[:, 1, 1::2] = sin, cos
        return self.times(sides.reshape(2 * self.n_rows, -1))

    def columns(self, wanted: np.ndarray) -> np.ndarray:
        """Return a copy of the rows ``wanted`` (k,) of G, transposed, complex (3 m, k)."""
        columns = np.empty((self.shape[0], len(wanted)), dtype=complex)
        self.write_columns(wanted, 1.0, columns)
        return columns

    def write_columns(self, wanted: np.ndarray, unit: float, out: np.ndarray) -> None:
        """Write these rows of G, transposed and divided by ``unit``, into ``out`` (3 m, k), complex of any precision."""
        both = (2 * np.asarray(wanted)[:, None] + np.arange(2)).ravel()
        super().write_columns(both, unit, out.view(out.real.dtype))


class ConjugateColumns(ComplexColumns):
    """The complex conjugates of complex columns, in the same memory: conj(G) p is the conjugate of G conj(p)."""

    @classmethod
    def of_columns(cls, base: ChosenColumns) -> ConjugateColumns:
        """Return the conjugates of ``base``, which is complex.  Local."""
        return cls(base._places, base.n_rows, base._owner, base.largest)

    def apply(self, p: np.ndarray) -> np.ndarray:
        """Return the real coefficients of conj(G) p, (n_rows, N_H) [m]; there is no mean."""
        return _conjugate(super().apply(_conjugate(p)))

    def _adjoint_times(self, x: np.ndarray) -> np.ndarray:
        """Return this rank's part of the real coefficients of G^T x, (3 m, N_H); there is no mean."""
        return _conjugate(super()._adjoint_times(_conjugate(x)))

    def write_columns(self, wanted: np.ndarray, unit: float, out: np.ndarray) -> None:
        """Write rows of conj(G) as the base class those of G."""
        super().write_columns(wanted, unit, out)
        np.conjugate(out, out=out)


def _conjugate(q: np.ndarray) -> np.ndarray:
    """Return the coefficients (n, N_H) of conjugate amplitudes cos + i sin, for harmonics without a mean."""
    return q * np.where(np.arange(q.shape[1]) % 2, -1.0, 1.0)
