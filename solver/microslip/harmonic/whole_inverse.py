"""The inverse of a small Jacobian I + G P with coupled harmonics: an exact preconditioner.

With a joint much stiffer or softer than its structure, I + G P is so ill-conditioned that GMRES needs as many iterations as a
small system has unknowns, or breaks down.  The matrix of a small system is therefore assembled and factored; that of a larger one
where GMRES fails, as near lift-off of most pairs.
"""

import warnings

import numpy as np
import scipy.linalg

from .linearisation import Linearisation
from .preconditioner import rows_of_rank

LARGEST = 400  # rows of the active pairs, all harmonics, up to which the matrix is assembled
LARGEST_AT_LAST = 2000  # the same after GMRES has failed: about as expensive as its 300 iterations


class WholeInverse:
    """The factored matrix I + G P of the active pairs at one linearisation; on every rank.  Collective."""

    def __init__(self, at: Linearisation):
        self.made_at, self.active_owned, equation = at, at.forces.active_owned, at.equation
        P, columns, N_H = equation.gather(at.P), at.G.matrix(), equation.model.N_H
        blocks = columns.reshape(len(columns), len(P), 3 * N_H).swapaxes(0, 1)  # (n_active, rows, 3 N_H)
        G_P = np.matmul(blocks, P).swapaxes(0, 1).reshape(columns.shape)
        G_P[np.diag_indices_from(G_P)] += 1.0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)  # singular: no finite step, which the caller detects
            self.factor = scipy.linalg.lu_factor(G_P, check_finite=False)
        self.local_rows = rows_of_rank(at)

    def apply(self, b: np.ndarray) -> np.ndarray:
        """Return (I + G P)^-1 b for this rank's active pairs, (m, 3, N_H) each.  Collective: one gather."""
        return self.solve(b[None])[0]

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return (I + G P)^-1 b for several right-hand sides, (n, m, 3, N_H) each, m active pairs of this rank.  Collective."""
        by_row = self.made_at.equation.gather(
            b.reshape(len(b), 3 * b.shape[1], b.shape[-1]).swapaxes(0, 1)
        )  # (3 n_active, n, N_H)
        columns = by_row.swapaxes(1, 2).reshape(-1, len(b))
        x = scipy.linalg.lu_solve(self.factor, columns, check_finite=False)
        rows = x.reshape(len(by_row), -1, len(b))[self.local_rows]
        return np.moveaxis(rows, -1, 0).reshape(b.shape)
