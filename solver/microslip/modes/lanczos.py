"""Block Lanczos for the lowest modes, by the kept factor: whole blocks of vectors go through MUMPS together.

The operator is S = K_L^-1 M, symmetric in the M inner product, S phi = phi / omega_n^2; the basis V is M-orthonormal,
T = V^T M S V its projection.  A block of 16 solves costs about as much as two single ones (docs/validation.md), which
outweighs the somewhat larger basis that blocks need.  All of the basis is kept orthogonal, and a block as wide as an
eigenvalue is multiple finds all of its modes.
"""

from __future__ import annotations

import numpy as np

from ..linear.dense import gram, multiply
from ..parallel.errors import ConvergenceError

TOLERANCE = 1e-9                # |S phi - theta phi|_M / theta of a mode that counts as converged
_IN_BASIS = 1e-13               # |w|_M / |S v|_M of what orthogonalisation leaves of S v, if that is only rounding
_SHRINKS = 1e-4                 # |w|_M / |S v|_M below which a direction is orthogonalised again
_MAX_RESTARTS = 60


def block_lanczos(factor, M, n_wanted: int, block: int) -> tuple[np.ndarray, np.ndarray, dict]:
    """Return at least ``n_wanted`` of the largest (theta, phi) of K_L^-1 M, theta falling; fewer if M moves no more.

    Collective on M's communicator.

    Parameters
    ----------
    factor : of K_L
    M : PETSc.Mat (n_dof, n_dof) kg
    n_wanted : modes, fewer than n_dof
    block : vectors solved for together

    Returns
    -------
    theta : (n,) 1 / omega_n^2 [s2], converged
    phi_owned : (n_owned, n), phi^T M phi = I
    info : "basis" its largest size, "restarts", "block", "complete" if these are all motions with mass

    Raises
    ------
    ConvergenceError : not converged after ``_MAX_RESTARTS`` restarts; on every rank
    """
    n_dof = M.getSize()[0]
    block = min(block, n_dof)
    n_max = min(n_dof, max(4 * n_wanted, n_wanted + 12 * block))    # then restart
    basis = _Basis(factor, M, n_max + 2 * block)
    n_new = basis.append(factor.solve(multiply(M, basis.random(block))))
    n_largest = restarts = 0
    while True:
        coupling, n_new = basis.expand(n_new)                       # S V = V T + V_new coupling
        n_basis = basis.n - n_new
        n_largest = max(n_largest, n_basis)
        theta, Y = np.linalg.eigh(basis.T[:n_basis, :n_basis])
        theta, Y = theta[::-1], np.ascontiguousarray(Y[:, ::-1])
        error = np.linalg.norm(coupling @ Y[n_basis - coupling.shape[1]:], axis=0)
        is_good = (error <= TOLERANCE * np.abs(theta)) & (theta > 0.0)
        n_good = n_basis if is_good.all() else int(np.argmin(is_good))
        if n_good >= n_wanted or n_new == 0:
            break
        if n_basis >= n_max:
            restarts += 1
            if restarts > _MAX_RESTARTS:
                break
            basis.restart(Y[:, :n_wanted + (n_max - n_wanted) // 3], theta, n_new)
    is_complete = n_new == 0 and n_good == n_basis
    if n_good < n_wanted and not is_complete:
        raise ConvergenceError(
            f"modes: {n_good} of {n_wanted} converged to {TOLERANCE:.0e} after {restarts} restarts with a basis of {n_max}; "
            "ask for fewer [solver] modes, or try -modes_eps_type krylovschur")
    info = {"basis": n_largest, "restarts": restarts, "block": block, "complete": is_complete}
    return theta[:n_good], basis.combine(Y[:, :n_good]), info


class _Basis:
    """The M-orthonormal basis V, M V and the projection T, in arrays that are allocated once."""

    def __init__(self, factor, M, capacity: int):
        self.factor, self.M, self.comm = factor, M, factor.comm
        self.n, self.n_dof = 0, M.getSize()[0]
        n_owned = M.getLocalSize()[0]
        self._V, self._MV = (np.zeros((n_owned, capacity), order="F") for _ in range(2))
        self.T = np.zeros((capacity, capacity))
        self._generator = np.random.default_rng([self.comm.rank, n_owned])

    def random(self, m: int) -> np.ndarray:
        return np.asfortranarray(self._generator.standard_normal((self._V.shape[0], m)))

    def expand(self, n_last: int) -> tuple[np.ndarray, int]:
        """Apply S to the last ``n_last`` vectors, fill their columns of T and append what is new.  Collective.

        Returns (coupling (n_new, n_last), n_new): S V = V T + V_new coupling on these columns.
        """
        first, n = self.n - n_last, self.n
        W_owned = self.factor.solve(self._MV[:, first:n])
        C = self._orthogonalise(W_owned)
        self.T[:n, first:n] = C
        self.T[first:n, :n] = C.T
        n_new = self.append(W_owned, size=np.linalg.norm(C, axis=0).max())
        return gram(self.comm, self._MV[:, n:self.n], W_owned), n_new

    def append(self, W_owned: np.ndarray, size: float = 0.0) -> int:
        """Append an M-orthonormal basis of what W adds to V and return its size.  Collective.

        Directions smaller than rounding of ``size`` are replaced by random ones while there are any: V then spans an
        invariant subspace, which may lack copies of a multiple mode.
        """
        room = min(W_owned.shape[1], self.n_dof - self.n)
        X_owned, MX_owned = self._orthonormal(W_owned, size)
        if X_owned.shape[1] < room:
            fresh = self.factor.solve(multiply(self.M, self.random(room - X_owned.shape[1])))
            fresh = np.hstack([X_owned, fresh / np.sqrt(gram(self.comm, fresh, multiply(self.M, fresh)).diagonal())])
            self._orthogonalise(fresh)
            X_owned, MX_owned = self._orthonormal(fresh, 1.0)
        n, n_new = self.n, min(X_owned.shape[1], room)
        self._V[:, n:n + n_new], self._MV[:, n:n + n_new] = X_owned[:, :n_new], MX_owned[:, :n_new]
        self.n += n_new
        return n_new

    def _orthogonalise(self, W_owned: np.ndarray) -> np.ndarray:
        """Make W M-orthogonal to V in place, twice over, and return V^T M W of before.  Collective."""
        C = np.zeros((self.n, W_owned.shape[1]))
        for _ in range(2):
            part = gram(self.comm, self._MV[:, :self.n], W_owned)
            W_owned -= self._V[:, :self.n] @ part
            C += part
        return C

    def _orthonormal(self, W_owned: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Return (X, M X): an M-orthonormal basis of W, less what is rounding of ``size``.  Collective.

        W is M-orthogonal to V; where normalisation magnifies the rounding of that, it is made so again.
        """
        X_owned = W_owned
        for cut in (_IN_BASIS * size, 0.0, 0.0):
            MX_owned = multiply(self.M, X_owned)
            values, vectors = np.linalg.eigh(gram(self.comm, X_owned, MX_owned))
            keep = values > max(cut**2, 1e-14 * values.max(initial=0.0))
            S = vectors[:, keep] / np.sqrt(values[keep])
            X_owned, MX_owned = X_owned @ S, MX_owned @ S
            if np.all(values > _SHRINKS**2 * max(size**2, values.max(initial=0.0))):
                break
            self._orthogonalise(X_owned)
            size = 1.0
        return X_owned, MX_owned

    def restart(self, Y: np.ndarray, theta: np.ndarray, n_new: int) -> None:
        """Keep the Ritz vectors V Y and the last ``n_new`` vectors, which are orthogonal to V Y.  Local."""
        n, n_kept = self.n - n_new, Y.shape[1]
        for array in (self._V, self._MV):
            array[:, :n_kept] = array[:, :n] @ np.ascontiguousarray(Y)
            array[:, n_kept:n_kept + n_new] = array[:, n:n + n_new].copy()
        self.T[:] = 0.0
        self.T[:n_kept, :n_kept] = np.diag(theta[:n_kept])
        self.n = n_kept + n_new

    def combine(self, Y: np.ndarray) -> np.ndarray:
        """Return this rank's rows of V Y.  Local."""
        return np.asfortranarray(self._V[:, :len(Y)] @ np.ascontiguousarray(Y))
