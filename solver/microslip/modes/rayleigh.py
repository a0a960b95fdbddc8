"""Eigenvalues to the accuracy of the matrices themselves: Rayleigh quotients in extended precision, where it matters.

The first bending mode of a fine mesh has an eigenvalue some 1e9 times below the largest one.  Rounding in the factor, and
in K_L phi, which is a small difference of large numbers, then changes its frequency by 1e-9, and by another 1e-9 on another
number of ranks.  The vector is good enough: its error enters squared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
from petsc4py import PETSc

from ..linear.dense import gram, multiply, summed

if TYPE_CHECKING:
    from ..linear.joint_springs import Linearised

_NOISE = 1e-11  # of omega_n^2, expected from rounding, that is let pass
_CHUNK = 2_000_000  # matrix entries multiplied at a time


def orthonormalised(linearised: Linearised, phi_owned: np.ndarray) -> np.ndarray:
    """Return the modes with phi^T M phi = I to rounding, (n_owned, n): an eigensolver leaves as much as it iterated with.

    Collective: one product and one sum.  Gram and Schmidt in rising order, by the Cholesky factor.
    """
    overlap = gram(linearised.system.comm, phi_owned, multiply(linearised.M, phi_owned))
    factor = scipy.linalg.cholesky(0.5 * (overlap + overlap.T))
    return scipy.linalg.solve_triangular(factor, phi_owned.T, trans="T").T


def sharpened(linearised: Linearised, eigenvalues: np.ndarray, phi_owned: np.ndarray) -> np.ndarray:
    """Return omega_n^2 = phi^T K_L phi for the modes in which rounding shows, the given ones otherwise, (n,) [rad2/s2].

    Collective.  phi is M-normalised.  Rounding is taken as eps phi^T diag(K_L) phi / sqrt(n_dof), as for a sum of
    independent errors.
    """
    comm, n_dof = linearised.system.comm, linearised.M.getSize()[0]
    sizes = summed(comm, linearised.factor.diagonal_owned @ phi_owned**2)
    noisy = np.flatnonzero(np.finfo(float).eps * sizes > _NOISE * np.sqrt(n_dof) * eigenvalues)
    if len(noisy) == 0:
        return eigenvalues
    eigenvalues = eigenvalues.copy()
    rows = _owned_rows(linearised.K_L)
    for k in noisy:
        x_owned = phi_owned[:, k]
        x = np.concatenate(comm.allgather(x_owned))
        eigenvalues[k] = float(sum(comm.allgather(_energy(rows, x_owned, x))))
    return eigenvalues


def _energy(rows: tuple, x_owned: np.ndarray, x: np.ndarray) -> np.longdouble:
    """Return the owned rows' part of x^T A x.  Local."""
    indptr, columns, values = rows
    row = np.repeat(np.arange(len(x_owned)), np.diff(indptr))
    total = np.longdouble(0.0)
    for start in range(0, len(values), _CHUNK):
        chunk = slice(start, start + _CHUNK)
        product = values[chunk].astype(np.longdouble)
        product *= x[columns[chunk]]
        product *= x_owned[row[chunk]]
        total += product.sum()
    return total


def _owned_rows(A: PETSc.Mat) -> tuple:
    """Return (indptr, columns, values) of this rank's rows, columns global.  Collective."""
    row_start, row_end = A.getOwnershipRange()
    mine = PETSc.IS().createStride(row_end - row_start, row_start, 1, comm=PETSc.COMM_SELF)
    everything = PETSc.IS().createStride(A.getSize()[1], 0, 1, comm=PETSc.COMM_SELF)
    (local,) = A.createSubMatrices(mine, everything)
    rows = local.getValuesCSR()
    for created in (local, mine, everything):
        created.destroy()
    return rows
