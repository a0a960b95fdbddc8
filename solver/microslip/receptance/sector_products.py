"""Products with the receptance of a disc by transforms over its sectors.

G_n of a disc whose modes are combinations X of those of the tuned disc is, with F the transform over the sectors, eq. (17.7),

    G_n = F^-1 (A'(d) + w_d phi_d Y_d D_n^-1 Re(Y^H phi^H)) F,        A'(d) = G_static(d) - phi_d Omega_d^-2 phi_d^H,

where Y_d are the rows of X of diameter d, scaled, w_d is N / 2, or N for d = 0 and N / 2, and D_n the dynamic stiffness of the
combined modes.  docs/theory.md, section 17.  The diameters are distributed over the ranks.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING

import numpy as np

from ..parallel.ownership import split_evenly
from .circulant import Waves
from .damping import Flexibility

if TYPE_CHECKING:
    from mpi4py import MPI


class SectorProducts:
    """G_n of the pairs of all sectors, applied to forces on all of them: the cost does not depend on the number of forces.

    Forces are without unit, motions in ``unit``.  Products are collective on ``comm``; a rank stores A' of its diameters.

    Parameters
    ----------
    G : (3 n, 3 n) static receptance of the tuned disc at the diameters 0, 1, ..., N // 2 [m/N]
    R_phi, omega_n : (3 n, m) modes of these diameters at the pairs of a sector [kg^-1/2], and their frequencies [rad/s]
    X : (M, M) the modes of the disc in coordinates of the real tuned modes, which are ordered by diameter
    squares : (M,) squared frequencies of the modes of the disc [1/s2]
    """

    def __init__(
        self,
        comm: MPI.Comm,
        waves: Waves,
        G: Sequence[np.ndarray],
        R_phi: Sequence[np.ndarray],
        omega_n: Sequence[np.ndarray],
        X: np.ndarray,
        squares: np.ndarray,
    ):
        N, n_rows, m = waves.n_sectors, len(G[0]), max(R.shape[1] for R in R_phi)
        D, self.comm, self.n_sectors, self.squares = len(waves.diameters), comm, N, squares
        first, last = (int(d) for d in split_evenly(D, comm.size)[comm.rank : comm.rank + 2])
        self.owned = slice(first, last)
        self.unit = max(float(np.abs(each).max(initial=0.0)) for each in G) or 1.0  # m/N
        self.R_unit = max(float(np.abs(R).max(initial=0.0)) for R in R_phi) or 1.0  # kg^-1/2
        self.forward, self.backward, copies = waves.forward, waves.inverse.transpose(2, 0, 1), waves.copies
        self.columns = np.zeros((last - first, n_rows + m, n_rows), dtype=complex)  # A'(d), then phi^H
        self.R = np.zeros((D, n_rows, m), dtype=complex)  # w_d phi_d
        self.Y = np.zeros((D, 2, m, len(X)))  # of real and imaginary parts
        ends = np.cumsum([0, *waves.counts([R.shape[1] for R in R_phi])])
        for d, (of_d, R, omega) in enumerate(zip(G, R_phi, omega_n)):
            k, rows, root = R.shape[1], X[ends[d] : ends[d + 1]], np.sqrt(copies[d] / N)
            if first <= d < last:
                self.columns[d - first, :n_rows] = (of_d - (R / omega**2) @ R.conj().T) / self.unit
                self.columns[d - first, n_rows : n_rows + k] = R.conj().T / self.R_unit
            self.R[d, :, :k] = R * (N / copies[d] / self.R_unit)
            self.Y[d, 0, :k] = root * rows[:k]
            self.Y[d, 1, : len(rows) - k] = -root * rows[k:]
        self._in_single: SectorProducts | None = None

    @property
    def n_rows(self) -> int:
        """The number of rows of the pairs of all sectors."""
        return self.n_sectors * self.R.shape[1]

    def n_products(self, n_ranks: int) -> int:
        """Return the number of real products of a rank for each column of forces."""
        D, n_rows, m = self.R.shape
        n_all = 4 * (D * (n_rows + m) * n_rows + self.R.size) + 2 * self.Y.size + 2 * self.forward.size * n_rows
        return n_all * -(-D // n_ranks) // D

    def on_ranks(self, comm: MPI.Comm) -> SectorProducts:
        """Return the same products on a subset of the ranks.  Collective on the present ranks: a gather."""
        columns = np.concatenate(self.comm.allgather(self.columns))
        other = copy(self)
        other.comm, other._in_single = comm, None
        other.owned = slice(*map(int, split_evenly(len(columns), comm.size)[comm.rank : comm.rank + 2]))
        other.columns = columns[other.owned].copy()
        return other

    def in_precision(self, precision: type) -> SectorProducts:
        """Return the same products in single or double precision; a copy in single precision is made once."""
        if precision is np.float64:
            return self
        if self._in_single is None:
            self._in_single = copy(self)
            for name, kind in _SINGLE.items():
                setattr(self._in_single, name, getattr(self, name).astype(kind))
        return self._in_single

    def flexibility(self, c: Flexibility) -> Flexibility:
        """Return D_n^-1 without unit, from c_n, which is D_n^-1 - Omega^-2."""
        static = np.diag(1.0 / self.squares) if c.couples_modes else 1.0 / self.squares[:, None]
        return self.rate(Flexibility(c.c + static))

    def rate(self, rate: Flexibility) -> Flexibility:
        """Return a rate of D_n^-1, which is that of c_n, without unit."""
        return Flexibility(rate.c * (self.R_unit * (self.R_unit / self.unit)))

    def apply(self, p: np.ndarray, flexibility: Flexibility, of_modes_only: bool = False, is_part: bool = False) -> np.ndarray:
        """Return the motions of all pairs in ``unit``, (3 n N, ..., N_H), under forces p (3 n N, ..., N_H): eq. (17.7).

        Collective: two sums; the ranks have the same forces.  ``flexibility`` is that of the combined modes, without unit; only
        their part of G_n is applied if ``of_modes_only``.  With ``is_part`` the sum over the ranks is the motion.
        """
        n_rows, N, owned = self.R.shape[1], self.n_sectors, self.owned
        first = n_rows if of_modes_only else 0
        forces = p.reshape(N, n_rows, -1).swapaxes(1, 2)  # in rows: products with a few rows are twice as fast as with columns
        parts = (self.forward[owned].reshape(-1, N) @ forces.reshape(N, -1)).reshape(-1, 2, forces.shape[1], n_rows)
        product = _complex(parts, self.R.dtype) @ self.columns[:, first:].swapaxes(1, 2)
        motion, q = product[..., : n_rows - first], product[..., n_rows - first :]
        q_owned = _parts(q).transpose(2, 0, 1, 3).reshape(q.shape[1], -1)
        modal = _total(self.comm, q_owned @ self.Y[owned].reshape(-1, len(self.squares)))
        eta = flexibility.apply(modal.T.reshape(-1, *p.shape[1:])).astype(self.Y.dtype, copy=False)
        moved = self._moved(eta.reshape(modal.T.shape), owned)
        of_owned = self._in_sectors(moved if of_modes_only else motion + moved, owned).reshape(p.shape)
        return of_owned if is_part else _total(self.comm, of_owned)

    def of_modes(self, eta: np.ndarray) -> np.ndarray:
        """Return R phi eta of all pairs, (3 n N, k) [m], for coordinates eta (M, k) of the modes of the disc.  Local."""
        every = slice(None)
        return self.R_unit * self._in_sectors(self._moved(eta, every), every)

    def _moved(self, eta: np.ndarray, owned: slice) -> np.ndarray:
        """Return the transform of the motion of modes with coordinates eta (M, k), of some diameters, (d, k, 3 n)."""
        of_diameters = eta.T @ self.Y[owned].reshape(-1, len(eta)).T
        parts = of_diameters.reshape(eta.shape[1], -1, 2, self.R.shape[2]).transpose(1, 2, 0, 3)
        return _complex(parts, self.R.dtype) @ self.R[owned].swapaxes(1, 2)

    def _in_sectors(self, spectrum: np.ndarray, owned: slice) -> np.ndarray:
        """Return motions (3 n N, k) from their transform for some diameters, (d, k, 3 n)."""
        (_, k, n_rows), N = spectrum.shape, self.n_sectors
        of_sectors = self.backward[:, owned].reshape(N, -1) @ _parts(spectrum).reshape(-1, k * n_rows)
        return of_sectors.reshape(N, k, n_rows).swapaxes(1, 2).reshape(-1, k)


_SINGLE = {"forward": np.float32, "backward": np.float32, "columns": np.complex64, "R": np.complex64, "Y": np.float32}


def _complex(parts: np.ndarray, kind: np.dtype) -> np.ndarray:
    """Return complex numbers (d, ...) of real and imaginary parts (d, 2, ...)."""
    values: np.ndarray = np.empty((len(parts), *parts.shape[2:]), dtype=kind)
    values.real, values.imag = parts[:, 0], parts[:, 1]
    return values


def _parts(values: np.ndarray) -> np.ndarray:
    """Return the real and imaginary parts (d, 2, ...) of complex numbers (d, ...)."""
    return np.stack([values.real, values.imag], axis=1)


def _total(comm: MPI.Comm, part: np.ndarray) -> np.ndarray:
    """Return the sum over the ranks, in the precision of the parts.  Collective."""
    if comm.size == 1:
        return part
    total = np.empty(part.shape, dtype=part.dtype)
    comm.Allreduce(np.ascontiguousarray(part), total)
    return total
