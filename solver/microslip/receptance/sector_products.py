"""Products with the receptance of a disc by transforms over its sectors.

G_n of a disc whose modes are combinations X of those of the tuned disc is, with F the transform over the sectors, eq. (17.7),

    G_n = F^-1 (A'(d) + w_d phi_d Y_d D_n^-1 Re(Y^H phi^H)) F,        A'(d) = G_static(d) - phi_d Omega_d^-2 phi_d^H,

where Y_d are the rows of X of diameter d, scaled, w_d is N / 2, or N for d = 0 and N / 2, and D_n the dynamic stiffness of the
combined modes.  docs/theory.md, section 17.  NumPy only; everything is local.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property

import numpy as np

from .circulant import Waves
from .damping import Flexibility


class SectorProducts:
    """G_n of the pairs of all sectors, applied to forces on all of them: the cost does not depend on the number of forces.

    Forces are without unit, motions in ``unit``.

    Parameters
    ----------
    G : (3 n, 3 n) static receptance of the tuned disc at the diameters 0, 1, ..., N // 2 [m/N]
    R_phi, omega_n : (3 n, m) modes of these diameters at the pairs of a sector [kg^-1/2], and their frequencies [rad/s]
    X : (M, M) the modes of the disc in coordinates of the real tuned modes, which are ordered by diameter
    squares : (M,) squared frequencies of the modes of the disc [1/s2]
    """

    def __init__(
        self,
        waves: Waves,
        G: Sequence[np.ndarray],
        R_phi: Sequence[np.ndarray],
        omega_n: Sequence[np.ndarray],
        X: np.ndarray,
        squares: np.ndarray,
    ):
        N, n_rows, m = waves.n_sectors, len(G[0]), max(R.shape[1] for R in R_phi)
        D, self.n_sectors, self.squares = len(waves.diameters), N, squares
        self.unit = max(float(np.abs(each).max(initial=0.0)) for each in G) or 1.0  # m/N
        self.R_unit = max(float(np.abs(R).max(initial=0.0)) for R in R_phi) or 1.0  # kg^-1/2
        turns = 2.0 * np.pi / N * np.outer(waves.diameters, np.arange(N))
        once = np.array([1.0 if waves.is_real(d) else 2.0 for d in waves.diameters])  # a diameter and its conjugate
        self.forward = np.concatenate([np.cos(turns), -np.sin(turns)])  # (2 D, N)
        self.backward = np.concatenate([np.cos(turns).T * once, -np.sin(turns).T * once], axis=1) / N  # (N, 2 D)
        self.columns = np.zeros((D, n_rows + m, n_rows), dtype=complex)  # A'(d), then phi^H
        self.R = np.zeros((D, n_rows, m), dtype=complex)  # w_d phi_d
        self.Y = np.zeros((2, D, m, len(X)))  # of real and imaginary parts
        ends = np.cumsum([0, *waves.counts([R.shape[1] for R in R_phi])])
        for d, (of_d, R, omega) in enumerate(zip(G, R_phi, omega_n)):
            k, rows, root = R.shape[1], X[ends[d] : ends[d + 1]], np.sqrt(once[d] / N)
            self.columns[d, :n_rows] = (of_d - (R / omega**2) @ R.conj().T) / self.unit
            self.columns[d, n_rows : n_rows + k], self.R[d, :, :k] = R.conj().T / self.R_unit, R * (N / once[d] / self.R_unit)
            self.Y[0, d, :k] = root * rows[:k]
            self.Y[1, d, : len(rows) - k] = -root * rows[k:]
        self.Y = self.Y.reshape(-1, len(X))
        self._in_single: SectorProducts | None = None

    @property
    def n_rows(self) -> int:
        """The number of rows of the pairs of all sectors."""
        return self.n_sectors * self.R.shape[1]

    @property
    def n_products(self) -> int:
        """The number of real products for each column of forces."""
        return 4 * (self.columns.size + self.R.size) + 2 * self.Y.size + 2 * self.forward.size * self.columns.shape[2]

    def in_precision(self, precision: type) -> SectorProducts:
        """Return the same products in single or double precision; a copy in single precision is made once."""
        if precision is np.float64:
            return self
        if self._in_single is None:
            self._in_single = copy(self)
            for name, kind in _SINGLE.items():
                setattr(self._in_single, name, getattr(self, name).astype(kind))
        return self._in_single

    def static_block(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return the static receptance without the part of the modes, (k, l) [m/N], between rows (k,) and (l,) of all sectors."""
        n = self.R.shape[1]
        between = (rows[:, None] // n - columns // n) % self.n_sectors
        return self._blocks[between, rows[:, None] % n, columns % n]

    @cached_property
    def _blocks(self) -> np.ndarray:
        """A' from sector t to sector t + k, (N, 3 n, 3 n) [m/N]."""
        return self.unit * Waves(self.n_sectors).blocks(list(self.columns[:, : self.R.shape[1]]))

    def flexibility(self, c: Flexibility) -> Flexibility:
        """Return D_n^-1 without unit, from c_n, which is D_n^-1 - Omega^-2."""
        static = np.diag(1.0 / self.squares) if c.couples_modes else 1.0 / self.squares[:, None]
        return self.rate(Flexibility(c.c + static))

    def rate(self, rate: Flexibility) -> Flexibility:
        """Return a rate of D_n^-1, which is that of c_n, without unit."""
        return Flexibility(rate.c * (self.R_unit * (self.R_unit / self.unit)))

    def apply(self, p: np.ndarray, flexibility: Flexibility, of_modes_only: bool = False) -> np.ndarray:
        """Return the motions of all pairs in ``unit``, (3 n N, ..., N_H), under forces p (3 n N, ..., N_H): eq. (17.7).

        ``flexibility`` is that of the combined modes, without unit; only their part of G_n is applied if ``of_modes_only``.
        """
        D, n_rows, _ = self.R.shape
        first = n_rows if of_modes_only else 0
        parts = (self.forward @ p.reshape(self.n_sectors, -1)).reshape(2, D, n_rows, -1)
        product = self.columns[:, first:] @ _complex(parts, self.R.dtype)
        q, motion = product[:, n_rows - first :], product[:, : n_rows - first]
        modal = self.Y.T @ _parts(q, (len(self.Y), -1))
        eta = flexibility.apply(modal.reshape(len(modal), *p.shape[1:])).astype(self.Y.dtype, copy=False)
        moved = self._moved(eta.reshape(modal.shape))
        return self._in_sectors(moved if of_modes_only else motion + moved).reshape(p.shape)

    def of_modes(self, eta: np.ndarray) -> np.ndarray:
        """Return R phi eta of all pairs, (3 n N, k) [m], for coordinates eta (M, k) of the modes of the disc."""
        return self.R_unit * self._in_sectors(self._moved(eta))

    def _moved(self, eta: np.ndarray) -> np.ndarray:
        """Return the transform of the motion of modes, (D, 3 n, k)."""
        D, _, m = self.R.shape
        return self.R @ _complex((self.Y @ eta).reshape(2, D, m, -1), self.R.dtype)

    def _in_sectors(self, spectrum: np.ndarray) -> np.ndarray:
        """Return motions (3 n N, k) from their transform (D, 3 n, k)."""
        D, _, k = spectrum.shape
        return (self.backward @ _parts(spectrum, (2 * D, -1))).reshape(-1, k)


_SINGLE = {"forward": np.float32, "backward": np.float32, "columns": np.complex64, "R": np.complex64, "Y": np.float32}


def _complex(parts: np.ndarray, kind: np.dtype) -> np.ndarray:
    """Return complex numbers of real and imaginary parts (2, ...)."""
    values: np.ndarray = np.empty(parts.shape[1:], dtype=kind)
    values.real, values.imag = parts
    return values


def _parts(values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return the real and imaginary parts of complex numbers, in this shape."""
    return np.array([values.real, values.imag]).reshape(shape)
