"""Eigenvalues to the accuracy of the matrices: Rayleigh quotients in extended precision, where needed.

The first bending mode of a fine mesh has an eigenvalue about 1e9 times below the largest one.  Rounding in the factor, and in
K_L phi, a small difference of large numbers, then changes its frequency by 1e-9, differently for each number of ranks.  The
eigenvector is accurate enough, since the error of a Rayleigh quotient is of second order in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
from petsc4py import PETSc

from ..assembly._rows import energies
from ..assembly.real_form import complex_columns, real_columns
from ..linear.dense import gram, multiply, wave_matrix
from ..linear.lockstep import at_once
from ..parallel.ownership import summed

if TYPE_CHECKING:
    from ..linear.joint_springs import Linearised

_DEPENDENT = 0.5  # squared M-norm of a combination of vectors below which there is none: 1, or 2 of v and i v together
_NOISE = 1e-11  # of omega_n^2: expected rounding error that is accepted

Forces = tuple[np.ndarray, np.ndarray]  # K_L phi and M phi of modes, (n_owned, n) each


def orthonormalised(linearised: Linearised, phi_owned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (phi, M phi) of modes with phi^H M phi = I to roundoff, (n_owned, n); an eigensolver reaches only its tolerance.

    Collective: one product and one sum.  Gram-Schmidt in ascending order, by the Cholesky factor.
    """
    M_phi_owned = multiply(linearised.M, phi_owned)
    overlap = gram(linearised.system.comm, phi_owned, M_phi_owned)
    factor = scipy.linalg.cholesky(0.5 * (overlap + overlap.conj().T))
    phi_owned, M_phi_owned = (
        scipy.linalg.solve_triangular(factor, each.T, trans="T", check_finite=False).T for each in (phi_owned, M_phi_owned)
    )
    return phi_owned, M_phi_owned


def iterated_once(
    linearised: Linearised, phi_owned: np.ndarray, solve: Callable[[np.ndarray], np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray, Forces]:
    """Return (eigenvalues, phi, forces) after a step of subspace iteration, omega_n^2 ascending [rad2/s2], phi^H M phi = I.

    Collective: one block of solves, by default checked and refined.  With joints much stiffer than the bodies, residuals after
    solves without refinement are above the limit.
    """
    comm, solve = linearised.system.comm, solve or linearised.factor.solve
    forces_owned = multiply(linearised.M, phi_owned)
    is_complex = np.iscomplexobj(forces_owned)
    X_owned = complex_columns(solve(real_columns(forces_owned))) if is_complex else solve(forces_owned)
    X_owned, M_X_owned = orthonormalised(linearised, X_owned)
    K_X_owned = multiply(linearised.K_L, X_owned)
    eigenvalues, rotation = comm.bcast(np.linalg.eigh(gram(comm, X_owned, K_X_owned)))
    return eigenvalues, X_owned @ rotation, (K_X_owned @ rotation, M_X_owned @ rotation)


def smoothed(
    linearised: Linearised, theta: np.ndarray, phi_owned: np.ndarray, next_owned: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Forces]:
    """Return (eigenvalues, phi, forces) of Ritz vectors multiplied by K_L^-1 M, as :func:`iterated_once`, without a solve.

    Collective: a product with K_L, one with M, and sums.  docs/theory.md, section 14: K_L^-1 M phi = theta (phi + delta v), with
    ``next_owned`` (n_owned, 1) the next vector v of the Krylov space, or 0, where delta minimises
    |K_L (phi + delta v) - M phi / theta|.  Of vectors that depend on each other, as phi and i phi, one is returned.
    """
    comm, m = linearised.system.comm, len(theta)
    Z_owned = np.hstack([phi_owned, next_owned])
    K_Z_owned, M_Z_owned = (multiply(A, Z_owned) for A in (linearised.K_L, linearised.M))
    elastic, inertia = (gram(comm, K_Z_owned[:, m:], each) for each in (K_Z_owned, M_Z_owned))
    of_K, of_M = (gram(comm, Z_owned, each) for each in (K_Z_owned, M_Z_owned))
    delta = (inertia[:, :m] / theta - elastic[:, :m]) / np.maximum(elastic[:, m:].real, np.finfo(float).tiny)
    T = np.vstack([np.eye(m), delta])
    sizes, X = comm.bcast(np.linalg.eigh(T.conj().T @ of_M @ T))
    T = T @ (X[:, sizes > _DEPENDENT] / np.sqrt(sizes[sizes > _DEPENDENT]))
    eigenvalues, Q = comm.bcast(np.linalg.eigh(T.conj().T @ of_K @ T))
    T = T @ Q
    return eigenvalues, Z_owned @ T, (K_Z_owned @ T, M_Z_owned @ T)


def sharpened(linearised: Linearised, eigenvalues: np.ndarray, phi_owned: np.ndarray) -> np.ndarray:
    """Return omega_n^2 = phi^H K_L phi for the modes with visible rounding errors, the given values otherwise, (n,) [rad2/s2].

    Collective.  phi is M-normalised.  The rounding error is estimated as eps phi^H diag(K_L) phi / sqrt(n_dof), as for a sum of
    independent errors.
    """
    comm, n_dof = linearised.system.comm, linearised.M.getSize()[0]
    is_complex = np.iscomplexobj(phi_owned)
    sizes = summed(comm, linearised.factor.diagonal_owned[:: 1 + is_complex] @ np.abs(phi_owned) ** 2)
    noisy = np.flatnonzero(np.finfo(float).eps * sizes > _NOISE * np.sqrt(n_dof) * eigenvalues)
    if len(noisy) == 0:
        return eigenvalues
    eigenvalues = eigenvalues.copy()
    X_owned = phi_owned[:, noisy]
    wave = wave_matrix(linearised.K_L)
    if wave is None:
        X_owned = real_columns(X_owned) if is_complex else X_owned
        eigenvalues[noisy] = _energies_of_all([(linearised.K_L, X_owned)])[0]
        return eigenvalues
    Z_owned = X_owned if is_complex or not wave.is_complex else complex_columns(X_owned)
    of_parts = at_once(_energies_of_all, (wave.A, wave.unfolded(Z_owned)))
    eigenvalues[noisy] = of_parts.reshape(-1, len(noisy)).sum(axis=0)
    added = wave.of_added(Z_owned)
    if added is not None:
        B, X = added
        eigenvalues[noisy] += np.sum(X * (B.astype(np.longdouble) @ X), axis=0)
    return eigenvalues


def _energies_of_all(requests: Sequence[tuple[PETSc.Mat, np.ndarray]]) -> list[np.ndarray]:
    """Return x^T A x for every column of each X, of which these are the owned rows, (m,) each, in extended precision.

    Collective.  All requests have the same A.
    """
    A, X_owned = requests[0][0], np.hstack([X_owned for _, X_owned in requests])
    comm, X_owned = A.comm.tompi4py(), np.ascontiguousarray(X_owned)
    of_rows = energies(A, X_owned, np.concatenate(comm.allgather(X_owned)))
    return np.split(np.sum(comm.allgather(of_rows), axis=0), np.cumsum([X_owned.shape[1] for _, X_owned in requests[:-1]]))
