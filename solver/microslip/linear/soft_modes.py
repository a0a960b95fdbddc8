"""Static solutions of softly supported structures: exact contributions of modes far below the response's frequencies.

docs/theory.md, section 4, "Softly held structures".  A structure held at 1 Hz and excited at 400 Hz has static solutions that
are almost all rigid-body motion, 1 / omega_k^2, which the same mode's dynamic share takes away again.  Rounding in the factor
leaves an error of cond(K_L) eps in that direction, which is as large as the remainder.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc

from .dense import multiply

BELOW = 0.02  # of the lowest frequency of the response: modes below it are soft


@dataclass(frozen=True, eq=False)
class SoftModes:
    """M-normalised modes far below the response's frequencies.  This rank's rows."""

    comm: MPI.Comm
    omega_2: np.ndarray  # (n_soft,) [rad2/s2], as the modal sums take them
    phi_owned: np.ndarray  # (n_owned, n_soft)
    M_phi_owned: np.ndarray  # (n_owned, n_soft)

    @classmethod
    def of(cls, comm: MPI.Comm, M: PETSc.Mat, omega_n: np.ndarray, phi_owned: np.ndarray, lowest: float) -> SoftModes | None:
        """Return the soft ones of some modes for a response from ``lowest`` [rad/s] on; None where none is.  Collective."""
        is_soft = omega_n < BELOW * lowest
        if not is_soft.any():
            return None
        phi_owned = np.ascontiguousarray(phi_owned[:, is_soft])
        return cls(comm, omega_n[is_soft] ** 2, phi_owned, multiply(M, phi_owned))

    def corrected(self, X_owned: np.ndarray, forces_owned: np.ndarray | sp.spmatrix) -> np.ndarray:
        """Return solutions of K_L X = F, (n_owned, m), whose share of the soft modes is phi^T F / omega_n^2.

        Collective: one sum.
        """
        forced = np.asarray((forces_owned.T @ self.phi_owned).T)
        forced, moved = self.comm.allreduce(np.stack([forced, self.M_phi_owned.T @ X_owned]))
        return X_owned + self.phi_owned @ (forced / self.omega_2[:, None] - moved)
