"""A tuned disc in the coordinates of its sectors: data of the nodal diameters, transformed over the sectors.

Any linear map A of a disc of identical sectors is block circulant: from sector t to sector s it is

    A_st = 1/N sum_d exp(i d (s - t) alpha) A(d),                                                                    (17.1)

the inverse discrete Fourier transform of the maps of the diameters, and real.  ``of_diameters`` are the maps of d = 0, 1, ...,
N // 2; the map of N - d is the conjugate of that of d.  docs/theory.md, section 17.  NumPy only; everything is local.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from ..parallel.ownership import rows_of
from .modes import ProjectedModes
from .static_columns import StaticColumns


@dataclass(frozen=True)
class Waves:
    """Transforms over the sectors of a disc."""

    n_sectors: int

    @property
    def diameters(self) -> range:
        """The nodal diameters, each once."""
        return range(self.n_sectors // 2 + 1)

    @property
    def forward(self) -> np.ndarray:
        """Real and imaginary parts of the transform over the sectors for each diameter, (N // 2 + 1, 2, N)."""
        turns = 2.0 * np.pi / self.n_sectors * np.outer(self.diameters, np.arange(self.n_sectors))
        return np.stack([np.cos(turns), -np.sin(turns)], axis=1)

    @property
    def copies(self) -> np.ndarray:
        """How many of the N diameters each stands for, 1 or 2: itself, and its conjugate."""
        return np.array([1.0 if self.is_real(d) else 2.0 for d in self.diameters])

    @property
    def inverse(self) -> np.ndarray:
        """Factors of the real and imaginary parts for each diameter in the inverse transform, shape as ``forward``."""
        return self.forward * (self.copies / self.n_sectors)[:, None, None]

    def is_real(self, d: int) -> bool:
        """Return whether a diameter is its own conjugate: 0, and half the number of sectors."""
        return 2 * d % self.n_sectors == 0

    def blocks(self, of_diameters: Sequence[np.ndarray]) -> np.ndarray:
        """Return C, (N, a, b), eq. (17.1): the block from sector t to sector s is C[(s - t) mod N]."""
        return np.fft.irfft(np.array(of_diameters), n=self.n_sectors, axis=0)

    def response(self, of_diameters: Sequence[np.ndarray], weights: np.ndarray) -> np.ndarray:
        """Return motions (N a, k) of all sectors under k forces, multiplied by ``weights`` (N, k) in each sector; maps (a, k)."""
        spectrum = np.fft.rfft(weights, axis=0)
        product = np.fft.irfft(np.array(of_diameters) * spectrum[:, None, :], n=self.n_sectors, axis=0)
        return product.reshape(-1, product.shape[-1])

    def work(self, of_diameters: Sequence[np.ndarray], left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Return the work (j, k) of maps (j, k) between ``left`` (N, j) and ``right`` (N, k) weights of the sectors."""
        motion = self.response(of_diameters, right).reshape(self.n_sectors, *of_diameters[0].shape)
        return np.einsum("sj,sjk->jk", left, motion)

    def dense(self, of_diameters: Sequence[np.ndarray]) -> np.ndarray:
        """Return the map between rows and columns of all sectors, (N a, N b)."""
        C, N = self.blocks(of_diameters), self.n_sectors
        of_sectors = C[(np.arange(N)[:, None] - np.arange(N)) % N]  # (s, t, a, b)
        return of_sectors.swapaxes(1, 2).reshape(N * C.shape[1], N * C.shape[2])

    def rows(self, of_diameters: Sequence[np.ndarray]) -> np.ndarray:
        """Return rows of the real modes of the disc, (N a, M), from complex rows (a, m) of the modes of each diameter.

        Each complex mode gives two real ones, sqrt(2/N) times the real and imaginary part of exp(i d s alpha) phi, ordered by
        diameter: eq. (17.2).
        """
        return np.hstack([self._rows(d, rows) for d, rows in zip(self.diameters, of_diameters)])

    def _rows(self, d: int, rows: np.ndarray) -> np.ndarray:
        N = self.n_sectors
        turned = np.exp(2j * np.pi * d / N * np.arange(N))[:, None, None] * rows
        if self.is_real(d):
            return turned.real.reshape(-1, rows.shape[1]) / np.sqrt(N)
        turned = turned.reshape(-1, rows.shape[1]) * np.sqrt(2.0 / N)
        return np.hstack([turned.real, turned.imag])

    def counts(self, of_diameters: Sequence[int]) -> list[int]:
        """Return the number of real modes of each diameter, from the numbers of complex modes."""
        return [m if self.is_real(d) else 2 * m for d, m in zip(self.diameters, of_diameters)]

    def of_real_modes(self, of_diameters: Sequence[np.ndarray]) -> np.ndarray:
        """Return values of the complex modes of each diameter as those of the real modes."""
        return np.concatenate([np.tile(values, 1 if self.is_real(d) else 2) for d, values in zip(self.diameters, of_diameters)])

    def spectrum(self, q: np.ndarray, n_modes: Sequence[int]) -> list[np.ndarray]:
        """Return the coordinates (m, k) of the modes of each diameter that correspond to coordinates q (M, k) of the real modes.

        The motion of the sectors is the inverse transform of phi(d) times these coordinates.
        """
        parts = np.split(q, np.cumsum(self.counts(n_modes))[:-1])
        return [
            np.sqrt(self.n_sectors) * part if self.is_real(d) else np.sqrt(0.5 * self.n_sectors) * (part[:m] - 1j * part[m:])
            for d, m, part in zip(self.diameters, n_modes, parts)
        ]

    def modes(self, of_diameters: Sequence[ProjectedModes], weights: np.ndarray) -> ProjectedModes:
        """Return the real modes of the disc projected on pairs, loads and outputs of all sectors, ordered by diameter.

        ``weights`` (N, n_loads) are the factors of each load in each sector.
        """
        omega_n = self.of_real_modes([modes.omega_n for modes in of_diameters])
        forces = self.rows([modes.b.conj().T for modes in of_diameters]).reshape(self.n_sectors, -1, len(omega_n))
        return ProjectedModes(
            omega_n=omega_n,
            R_phi=self.rows([modes.R_phi for modes in of_diameters]),
            b=np.einsum("sl,slm->ml", weights, forces),
            o=self.rows([modes.o for modes in of_diameters]),
            C=self._damping(of_diameters),
        )

    def _damping(self, of_diameters: Sequence[ProjectedModes]) -> np.ndarray | None:
        """Return phi^T C phi between the real modes; None without a damping matrix."""
        if of_diameters[0].C is None:
            return None
        ends = np.concatenate([[0], np.cumsum(self.counts([len(modes.omega_n) for modes in of_diameters]))])
        C = np.zeros((ends[-1], ends[-1]))
        for d, modes, first, last in zip(self.diameters, of_diameters, ends, ends[1:]):
            assert modes.C is not None, "all diameters have dampers"
            of_d = modes.C
            if not self.is_real(d):
                of_d = np.block([[of_d.real, of_d.imag], [-of_d.imag, of_d.real]])
            C[first:last, first:last] = of_d.real
        return C


class CirculantColumns(StaticColumns):
    """G_static of a tuned disc, eq. (17.1): all columns are known; columns of sector t are those of sector 0, rotated.

    The rows of a column of sector 0 are stored for the sectors 0, 1, ..., N - 1, 0, 1, ..., N - 1; the column of sector t is a
    window of them that starts at sector N - t.  The memory is that of two columns instead of N.

    Parameters
    ----------
    blocks : (N, 3 n, 3 n) static response of sector k under forces in sector 0 [m/N]
    owned : the pairs of this rank, among the pairs of all sectors
    """

    def __init__(self, blocks: np.ndarray, owned: slice):
        N, n_rows, _ = blocks.shape
        super().__init__(N * n_rows // 3, owned.stop - owned.start, _no_solve)
        columns = np.empty((n_rows, 2 * N, n_rows))
        columns[:, :N] = columns[:, N:] = blocks.transpose(2, 0, 1)
        self._blocks, self._places = [columns], _windows(columns, owned)
        self._largest = np.tile(np.abs(blocks).max(axis=(0, 1), initial=0.0).reshape(-1, 3).max(axis=1), N)
        self.known[:] = self.stored[:] = True

    def of_rows(self, owned: slice) -> CirculantColumns:
        """Return the same columns, in the same memory, with the rows of the pairs ``owned``.  Local."""
        other = copy(self)
        other.n_owned, other._last = owned.stop - owned.start, None
        other._places = _windows(self._blocks[0], owned)
        return other

    def block(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return the static receptance between rows (k,) and columns (l,) of all sectors, (k, l) [m/N].  Local."""
        (of_sector_0,) = self._blocks
        n, N = len(of_sector_0), of_sector_0.shape[1] // 2
        between = rows // n - columns[:, None] // n + N  # N to 2 N - 1 sectors and those before: stored twice
        block: np.ndarray = of_sector_0[columns[:, None] % n, between, rows % n].T
        return block


class ColumnsOfOtherModes(StaticColumns):
    """G_static of a disc whose modes are combinations of the tuned modes, eq. (17.6); columns on demand, blocks without them.

    Parameters
    ----------
    truncated : G_static of the tuned disc without the part of its modes
    modes : of the disc
    owned : the rows of the pairs of this rank, among those of all sectors
    """

    def __init__(self, truncated: CirculantColumns, modes: ProjectedModes, owned: slice):
        self._truncated, self._modes, self._owned = truncated, modes, owned
        super().__init__(len(truncated.known), truncated.n_owned, self._columns_of, grows=False)

    def _columns_of(self, pairs: np.ndarray) -> np.ndarray:
        """Return this rank's rows of the columns of pairs."""
        total: np.ndarray = self._truncated.transposed(pairs).T + self._of_modes(self._owned, rows_of(pairs))
        return total

    def of_rows(self, owned: slice) -> ColumnsOfOtherModes:
        """Return the same columns with the rows of the pairs ``owned``.  Local."""
        return ColumnsOfOtherModes(self._truncated.of_rows(owned), self._modes, slice(3 * owned.start, 3 * owned.stop))

    def block(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return the static receptance as :meth:`CirculantColumns.block`.  Local."""
        return self._truncated.block(rows, columns) + self._of_modes(rows, columns)

    def _of_modes(self, rows: np.ndarray | slice, columns: np.ndarray) -> np.ndarray:
        """Return the part of the modes between rows and columns."""
        R_phi, omega_n = self._modes.R_phi, self._modes.omega_n
        return R_phi[rows] @ (R_phi[columns] / omega_n**2).T


def _windows(columns: np.ndarray, owned: slice) -> np.ndarray:
    """Return the addresses of the columns of all pairs, (n N, 3), from their first rows of the pairs ``owned``."""
    n_rows, N = len(columns), columns.shape[1] // 2
    start = (N - np.arange(N)) % N * n_rows + 3 * owned.start
    address = columns.ctypes.data + columns.strides[0] * np.arange(n_rows)
    return (8 * start[:, None] + address).astype(np.intp).reshape(-1, 3)


def _no_solve(pairs: np.ndarray) -> np.ndarray:
    raise AssertionError("all columns of a tuned disc are known")
