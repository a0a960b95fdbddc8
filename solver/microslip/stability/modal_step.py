"""A step of the free modes under forces that change linearly within it, exact (docs/theory.md, section 16)."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from ..receptance.damping import Damping


class ModalStep:
    """eta'' + C eta' + Omega^2 eta = q over a step ``h`` [s], in the scaled coordinates x = (Omega eta, eta') (2, m, n).

    With modal damping every mode steps by itself: the matrices are (.., .., m), otherwise (.., .., m, m).
    """

    def __init__(self, omega_n: np.ndarray, damping: Damping, h: float):
        self.omega_n, m = omega_n, len(omega_n)
        if damping.couples_modes:
            one, none, squares = np.eye(m), np.zeros((m, m)), np.diag(omega_n)
            rows = [[none, squares, none, none], [-squares, -damping.C, one, none], [none, none, none, one / h], [none] * 4]
            E = expm(h * np.block(rows)).reshape(4, m, 4, m).transpose(0, 2, 1, 3)
        else:
            rates = np.zeros((m, 4, 4))
            rates[:, 0, 1], rates[:, 1, 0], rates[:, 1, 1], rates[:, 1, 2] = omega_n, -omega_n, -damping.C, 1.0
            rates[:, 2, 3] = 1.0 / h
            E = np.moveaxis(expm(h * rates), 0, -1)
        self.free, self.by_last = E[:2, :2], E[:2, 3]  # by x; by q at the end, (2, ...)
        self.by_first = E[:2, 2] - self.by_last  # by q at the begin

    def take(self, x: np.ndarray) -> np.ndarray:
        """Return x after a step without forces, (2, m, n).  Local."""
        (a, b), (c, d) = self.free
        return np.stack([_times(a, x[0]) + _times(b, x[1]), _times(c, x[0]) + _times(d, x[1])])

    def forced(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Return what forces q, ``first`` at the begin and ``last`` at the end (m, n), add to x.  Local."""
        return np.stack([_times(a, first) + _times(b, last) for a, b in zip(self.by_first, self.by_last)])

    def multipliers(self) -> np.ndarray:
        """Return the eigenvalues of a step without forces, (2 m,) complex.  Local."""
        step = np.moveaxis(self.free, (0, 1), (-2, -1)) if self.free.ndim == 3 else np.block([list(row) for row in self.free])
        return np.linalg.eigvals(step).ravel()

    def between(self, R_phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return R d eta / d q R^T at the end of a step, by q at its begin and at its end, (k, k) each.  Local."""
        R = R_phi / self.omega_n
        both = self.by_first[0], self.by_last[0]
        return tuple((R * c if c.ndim == 1 else R @ c) @ R_phi.T for c in both)  # type: ignore[return-value]


def _times(c: np.ndarray, y: np.ndarray) -> np.ndarray:
    return c @ y if c.ndim == 2 else c[:, None] * y
