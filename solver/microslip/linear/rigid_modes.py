"""Rigid-body modes of a structure without supports, and its static solutions by inertia relief (docs/theory.md, section 4).

With the rigid-body modes phi_r, phi_r^T M phi_r = 1, and P = 1 - phi_r phi_r^T M, the static solution of a free structure is

    x = K_L^+ f:    P^T K_L x = P^T f,    phi_r^T M x = 0.                                                          (4.8)

P^T f are the loads less the inertia forces of the rigid-body motion that they cause.  K_L gets springs at as many DOFs as there
are rigid-body modes, chosen so that they hold the structure without constraint: under loads in balance they carry nothing.  Where
K_L phi_r is not exactly zero, because contact and stress at rest do not turn with the structure, a small linear system removes
what springs and rigid-body motion would carry.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from petsc4py import PETSc

from ..parallel.ownership import summed
from .dense import diagonal_owned, gram, multiply
from .ordering import Order

if TYPE_CHECKING:
    from collections.abc import Callable

    from mpi4py import MPI

    from .direct import DirectSolver

STRAINS = 1e-6  # z^T K_L z / z^T diag(K_L) z of a rigid motion of a free structure beyond which something holds it
_INDEPENDENT = 1e-10  # eigenvalue of the motions' scaled Gram matrix above which they are independent


@dataclass(frozen=True, eq=False)
class RigidModes:
    """Rigid-body modes of (K_L, M), phi^T M phi = 1.  This rank's rows."""

    comm: MPI.Comm
    phi_owned: np.ndarray  # (n_owned, n)
    M_phi_owned: np.ndarray  # (n_owned, n)

    @property
    def n(self) -> int:
        """Their number."""
        return self.phi_owned.shape[1]

    def balanced(self, forces_owned: np.ndarray | sp.spmatrix) -> np.ndarray:
        """Return P^T f, (n_owned, m): forces less the inertia forces of their rigid-body motion.  Collective: one sum."""
        dense = forces_owned.toarray() if sp.issparse(forces_owned) else forces_owned
        return dense - self.M_phi_owned @ self.resultants(forces_owned)

    def elastic(self, X_owned: np.ndarray) -> np.ndarray:
        """Return P x, (n_owned, m): motions less their rigid-body part.  Collective: one sum."""
        return X_owned - self.phi_owned @ gram(self.comm, self.M_phi_owned, X_owned)

    def resultants(self, forces_owned: np.ndarray | sp.spmatrix) -> np.ndarray:
        """Return phi^T f, (n, m).  Collective: one sum."""
        return summed(self.comm, np.asarray((forces_owned.T @ self.phi_owned).T))


def rigid_modes(A: PETSc.Mat, M: PETSc.Mat, motions_owned: np.ndarray) -> RigidModes | None:
    """Return the motions (n_owned, m) without strain as M-orthonormal modes; None where there is none.

    Collective.  Dependent motions count once.
    """
    if motions_owned.shape[1] == 0:
        return None
    comm, diagonal = A.comm.tompi4py(), diagonal_owned(A)
    Z_owned = _independent(comm, motions_owned, gram(comm, motions_owned, diagonal[:, None] * motions_owned))
    strains, q = comm.bcast(np.linalg.eigh(gram(comm, Z_owned, multiply(A, Z_owned))))
    is_free = np.abs(strains) <= STRAINS
    if not is_free.any():
        return None
    if not is_free.all():  # else in the order of the motions, which no rounding changes
        Z_owned = Z_owned @ q[:, is_free]
    phi_owned = _independent(comm, Z_owned, gram(comm, Z_owned, multiply(M, Z_owned)))
    return RigidModes(comm, phi_owned, multiply(M, phi_owned))


def _independent(comm: MPI.Comm, Z_owned: np.ndarray, G: np.ndarray) -> np.ndarray:
    """Return a basis of the columns of Z, orthonormal in the product of which G (m, m) is their Gram matrix.  Local.

    The columns one after the other (Gram and Schmidt), without those that depend on earlier ones.
    """
    size = np.sqrt(np.maximum(np.diag(G), 0.0))
    chosen: list[int] = []
    for k in np.flatnonzero(size > 0.0):
        tried = [*chosen, int(k)]
        scaled = G[np.ix_(tried, tried)] / np.outer(size[tried], size[tried])
        if np.linalg.eigvalsh(scaled)[0] > _INDEPENDENT:
            chosen = tried
    if not chosen:
        return Z_owned[:, :0]
    lower = comm.bcast(np.linalg.cholesky(G[np.ix_(chosen, chosen)]))
    return np.asfortranarray(scipy.linalg.solve_triangular(lower, Z_owned[:, chosen].T, lower=True).T)


def isostatic_rows(rigid: RigidModes, A: PETSc.Mat) -> np.ndarray:
    """Return rows at which springs hold the rigid-body modes without constraint, (n,) global, rising.  Collective.

    One after the other where the remainder of the modes is largest, measured by the root of the diagonal of A.
    """
    comm, first = rigid.comm, A.getOwnershipRange()[0]
    left = np.sqrt(np.maximum(diagonal_owned(A), 0.0))[:, None] * rigid.phi_owned
    left = left / np.sqrt(np.maximum(gram(comm, left, left).diagonal(), np.finfo(float).tiny))
    rows = []
    for _ in range(rigid.n):
        sizes = np.linalg.norm(left, axis=1)
        here = int(np.argmax(sizes)) if len(sizes) else 0
        best = (-float(sizes[here]), first + here, left[here]) if len(sizes) else (0.0, first, np.zeros(rigid.n))
        _, row, direction = min(comm.allgather(best), key=lambda each: each[:2])
        direction = direction / np.linalg.norm(direction)
        left = left - np.outer(left @ direction, direction)
        rows.append(row)
    return np.sort(np.array(rows))


class InertiaRelief:
    """K_L^+ of eq. (4.8) as a direct solver, on the factor of K_L with springs.  All methods but ``order`` are collective.

    Parameters
    ----------
    factorise : returns the factor of a matrix that meanwhile replaces A
    """

    def __init__(self, rigid: RigidModes, A: PETSc.Mat, factorise: Callable[[PETSc.Mat], DirectSolver]):
        self.rigid, self.comm = rigid, rigid.comm
        rows, diagonal = isostatic_rows(rigid, A), diagonal_owned(A)
        self._first = A.getOwnershipRange()[0]
        is_owned = (rows >= self._first) & (rows < self._first + len(diagonal))
        self._owned, self._columns = rows[is_owned] - self._first, np.flatnonzero(is_owned)
        springs = np.zeros_like(diagonal)
        springs[self._owned] = diagonal[self._owned]
        self.springs = summed(self.comm, self._on_rows(springs[:, None]))[:, 0]  # (n,) N/m
        _set_diagonal(A, diagonal + springs)
        try:
            self.solver = factorise(A)
        finally:
            _set_diagonal(A, diagonal)
        self._prepare(len(diagonal))

    def _prepare(self, n_owned: int) -> None:
        """Solve for unit forces at the springs and inertia forces, common to all right-hand sides."""
        n = self.rigid.n
        E_owned = np.zeros((n_owned, n))
        E_owned[self._owned, self._columns] = self.springs[self._columns]
        self.Y_owned = self.solver.solve(np.asfortranarray(np.hstack([E_owned, self.rigid.M_phi_owned])))
        seen = self._seen(self.Y_owned)  # (2 n, 2 n)
        self.S = np.block([[np.eye(n) - seen[:n, :n], seen[:n, n:]], [-seen[n:, :n], seen[n:, n:]]])
        self.V_inertia = seen[:, n:]

    def _on_rows(self, X_owned: np.ndarray) -> np.ndarray:
        """Return this rank's part of the rows at which springs act, (n, m).  Local."""
        part = np.zeros((self.rigid.n, X_owned.shape[1]))
        part[self._columns] = X_owned[self._owned]
        return part

    def _seen(self, X_owned: np.ndarray) -> np.ndarray:
        """Return motions at the springs, and phi^T M x, (2 n, m).  Collective: one sum."""
        return summed(self.comm, np.vstack([self._on_rows(X_owned), self.rigid.M_phi_owned.T @ X_owned]))

    def _weights(self, seen: np.ndarray) -> np.ndarray:
        """Return the weights of ``Y_owned`` with which springs and inertia forces vanish, (2 n, m), from :meth:`_seen`."""
        n, size = self.rigid.n, np.abs(self.S).max(axis=1, keepdims=True)
        weights = self.comm.bcast(np.linalg.solve(self.S / size, seen / size))
        return np.vstack([weights[:n], -weights[n:]])

    @property
    def order(self) -> Order | None:
        """The order of elimination."""
        return self.solver.order

    def solve(self, B: np.ndarray | sp.csc_matrix) -> np.ndarray:
        """Return this rank's rows of K_L^+ B, (n_owned, m); B is its rows, or sparse (n_dof, m), the same on every rank."""
        if not sp.issparse(B):
            return self._relieved(self.solver.solve(np.asfortranarray(self.rigid.balanced(B))))
        B_owned = B.tocsr()[self._first : self._first + len(self.Y_owned)]
        inertia = self.Y_owned[:, self.rigid.n :] @ self.rigid.resultants(B_owned)
        return self._relieved(self.solver.solve(B) - inertia)

    def _relieved(self, X_owned: np.ndarray) -> np.ndarray:
        """Return solutions without the contributions of the springs and of rigid-body motion."""
        X_owned = X_owned + self.Y_owned @ self._weights(self._seen(X_owned))
        return np.asfortranarray(self.rigid.elastic(X_owned))

    def inverse_entries(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray | None:
        """Return entries of K_L^+ in rising rows and columns on rank 0, (0, 0) elsewhere; None if they are not available."""
        entries, n = self.solver.inverse_entries(rows, columns), self.rigid.n
        if entries is None:
            return None
        Y_rows, Y_columns, phi = (
            self._global(X_owned, at)
            for X_owned, at in ((self.Y_owned, rows), (self.Y_owned, columns), (self.rigid.phi_owned, columns))
        )
        seen = (Y_columns / np.append(self.springs, np.ones(n))).T - self.V_inertia @ phi.T
        correction = Y_rows @ self._weights(seen) - Y_rows[:, n:] @ phi.T
        return entries + correction if self.comm.rank == 0 else entries

    def _global(self, X_owned: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return some global rows, on every rank."""
        part = np.zeros((len(rows), X_owned.shape[1]))
        is_owned = (rows >= self._first) & (rows < self._first + len(X_owned))
        part[is_owned] = X_owned[rows[is_owned] - self._first]
        return summed(self.comm, part)

    def destroy(self) -> None:
        """Free the factor."""
        self.solver.destroy()


def _set_diagonal(A: PETSc.Mat, diagonal: np.ndarray) -> None:
    """Set this rank's part of the diagonal.  Collective."""
    vector = A.createVecLeft()
    vector.setArray(diagonal)
    A.setDiagonal(vector)
    vector.destroy()
