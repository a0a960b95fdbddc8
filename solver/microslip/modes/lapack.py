"""All modes of a small structure by LAPACK on rank 0."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from petsc4py import PETSc

from ..linear.dense import explicit
from ..linear.rigid_modes import RigidModes
from ..messages.errors import CaseError
from ..parallel.agree import on_root

_MASSLESS = 1e-13  # eigenvalue of M, scaled to a unit diagonal, of a motion without mass


def dense_modes(
    K_L: PETSc.Mat, M: PETSc.Mat, rigid: RigidModes | None, n_wanted: int, n_least: int
) -> tuple[np.ndarray, np.ndarray, dict]:
    """Return the ``n_wanted`` largest (theta, phi) of K_L^-1 M, theta = 1 / omega_n^2 descending, phi^T M phi = I.

    If fewer motions have mass, all of them are returned.  ``rigid`` are the rigid-body modes of a free structure, which are not
    among the modes.

    Collective: K_L and M are gathered on rank 0, the modes broadcast.  The problem is solved as M phi = theta K_L phi, so that M
    may be singular and the low modes are accurate in the presence of very stiff springs.

    Raises
    ------
    CaseError : M is indefinite, or fewer motions than ``n_least`` have mass; on every rank
    """
    comm = K_L.comm.tompi4py()
    M_phi_r = None if rigid is None else comm.gather(rigid.M_phi_owned)
    dense = gathered(K_L), gathered(M), None if M_phi_r is None else np.concatenate(M_phi_r)
    theta, phi = on_root(comm, _solve, *dense, n_wanted, n_least)
    row_start, row_end = M.getOwnershipRange()
    return theta, np.asfortranarray(phi[row_start:row_end]), {"method": "LAPACK", "basis": M.getSize()[0]}


def _solve(
    K_L: np.ndarray, M: np.ndarray, M_phi_r: np.ndarray | None, n_wanted: int, n_least: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the modes; for a free structure, only motions x with phi_r^T M x = 0.  Local, rank 0."""
    if M_phi_r is not None:
        Q = scipy.linalg.qr(M_phi_r)[0][:, M_phi_r.shape[1] :]
        theta, y = _solve(Q.T @ K_L @ Q, Q.T @ M @ Q, None, n_wanted, n_least)
        return theta, Q @ y
    theta, x = scipy.linalg.eigh(0.5 * (M + M.T), 0.5 * (K_L + K_L.T))
    theta, x = theta[::-1], x[:, ::-1]
    if theta[-1] < -1e-12 * theta[0]:
        raise CaseError(
            f"the mass matrix is indefinite: z^T M z = {theta[-1]:.1e} z^T K_L z s2 for some motion; it must not be negative"
        )
    n_modes = _rank(M)
    if n_modes < n_least:
        raise CaseError(
            f"[solver] modes = {n_least}, but the structure has only {n_modes}: its mass matrix leaves "
            f"{len(theta) - n_modes} motions without mass"
        )
    x = x[:, : min(n_wanted, n_modes)]
    mass, stiffness = (np.einsum("ij,ij->j", x, A @ x) for A in (M, K_L))
    theta = mass / stiffness  # the small ones to full relative accuracy
    order = np.argsort(-theta)
    return theta[order], (x / np.sqrt(mass))[:, order]


def _rank(M: np.ndarray) -> int:
    """Return the number of motions with mass, independent of the units and sizes of the masses."""
    mass = M.diagonal()
    size = np.sqrt(mass[mass > 0.0])
    scaled = M[np.ix_(mass > 0.0, mass > 0.0)] / np.outer(size, size)
    return int(np.count_nonzero(np.linalg.eigvalsh(scaled) > _MASSLESS)) if len(size) else 0


def gathered(A: PETSc.Mat) -> np.ndarray | None:
    """Return a small matrix as a full array on rank 0, None elsewhere.  Collective."""
    A_with_entries = explicit(A)
    n = A.getSize()[0]
    everything = np.arange(n if A.comm.rank == 0 else 0, dtype=PETSc.IntType)
    rows = PETSc.IS().createGeneral(everything, comm=PETSc.COMM_SELF)
    (local,) = A_with_entries.createSubMatrices(rows, rows)
    indptr, columns, values = local.getValuesCSR()
    full = np.zeros((len(everything), len(everything)))
    full[np.repeat(np.arange(len(everything)), np.diff(indptr)), columns] = values
    local.destroy()
    rows.destroy()
    if A_with_entries is not A:
        A_with_entries.destroy()
    return full if A.comm.rank == 0 else None
