"""The bodies without their joint: free-interface modes, including rigid-body modes, and residual attachment modes.

Only the joint connects the bodies, so that one eigenproblem of (K, M) gives the modes of all bodies.  If a body is free, K is
singular; K + alpha M is factored instead, with alpha far below the first elastic eigenvalue.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..linear.dense import column_norms, gram, multiply
from ..linear.factor import Factor
from ..linear.joint_springs import Linearised
from ..messages.errors import CaseError, ConvergenceError
from ..modes.eigen import Modes, lowest_modes
from .settings import ReductionSettings
from .stuck import StuckStructure

SHIFT = 1e-2  # alpha relative to the lowest eigenvalue of the stuck structure
RIGID = 1e-6  # eigenvalue, relative to the lowest one of the stuck structure, below which a mode is a rigid-body mode
_CONVERGED = 1e-12  # estimated relative remaining change of the attachment modes
_MOST_ROUNDS = 40
_BATCH = 128
_MOST_PARTS_UNNAMED = 3  # assumed number of parts of matrices without a mesh


@dataclass(frozen=True)
class FreeBodies:
    """The structure without joint springs: its factor is that of K + alpha M."""

    linearised: Linearised
    alpha: float  # 1/s2
    omega_2: np.ndarray  # (n,) eigenvalues of (K, M) [rad2/s2], about 0 for rigid-body modes
    phi_owned: np.ndarray  # (n_owned, n) phi^T M phi = I

    def destroy(self) -> None:
        """Free the shifted matrix and its factor.  Collective."""
        self.linearised.destroy()


def free_bodies(stuck: StuckStructure, settings: ReductionSettings) -> FreeBodies:
    """Return the lowest modes of the bodies without their joint, as many as the stuck structure has.

    Collective: one factorisation, and another one to prove the modes complete.

    Raises
    ------
    CaseError : fewer modes requested than rigid-body modes; on every rank
    """
    system, modes, n_modes = stuck.system, stuck.modes, len(stuck.modes.omega_n)
    alpha = SHIFT * modes.omega_n[0] ** 2
    A = system.K.duplicate(copy=True)
    A.axpy(alpha, system.M, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    A.setOption(PETSc.Mat.Option.SPD, True)
    shifted = Linearised(system, A, system.M, Factor(A, system, what="K + alpha M"))
    free = lowest_modes(shifted, n_modes, settings.verify_modes, allows_fewer=True)
    n_rigid = _count_rigid(free, alpha, modes)
    if n_rigid == len(free.omega_n) < system.n_dof:  # there may be more
        most = min(n_modes + 6 * max(len(system.part_names), 1), system.n_dof)
        n_rigid = _count_rigid(lowest_modes(shifted, most, settings.verify_modes, allows_fewer=True), alpha, modes)
    if n_rigid > n_modes:
        shifted.destroy()
        raise CaseError(
            f"{settings.where}: [solver] modes = {n_modes}: without their joint the bodies have {n_rigid} rigid-body "
            f'modes, all of which method = "{settings.method}" needs; state {n_rigid} modes at least'
        )
    return FreeBodies(shifted, alpha, free.omega_n**2 - alpha, free.phi_owned)


def check_rigid(stuck: StuckStructure, settings: ReductionSettings) -> None:
    """Refuse fewer modes than the number of rigid-body modes, before the modes are used.  Collective.

    Costs as much as :func:`free_bodies`, and nothing if there are at least six modes per part.

    Raises
    ------
    CaseError : as :func:`free_bodies`; on every rank
    """
    n_parts = max(len(stuck.system.part_names), _MOST_PARTS_UNNAMED)
    if len(stuck.modes.omega_n) < 6 * n_parts:
        free_bodies(stuck, settings).destroy()


def _count_rigid(free: Modes, alpha: float, modes: Modes) -> int:
    return int(np.count_nonzero(free.omega_n**2 - alpha < RIGID * modes.omega_n[0] ** 2))


def residual_attachment_modes(free: FreeBodies, forces: sp.csc_matrix) -> np.ndarray:
    """Return Z = sum of phi_k phi_k^T F / omega_k^2 over the truncated modes, this rank's rows (n_owned, n_forces).

    Collective.  docs/theory.md, eq. (8.3).  Inertia relief is inherent: Z is M-orthogonal to the computed modes, including
    rigid-body modes, and the load P F = F - M phi phi^T F is orthogonal to them.  K Z = P F is solved with the shifted factor,

        (K + alpha M) Z_new = P F + alpha M Z,

    with the convergence rate alpha / (omega_k^2 + alpha) of the first truncated mode.

    Raises
    ------
    ConvergenceError : no convergence within ``_MOST_ROUNDS``; on every rank
    """
    Z_owned = np.zeros((len(free.phi_owned), forces.shape[1]), order="F")
    for start in range(0, forces.shape[1], _BATCH):
        columns = slice(start, start + _BATCH)
        Z_owned[:, columns] = _batch_of_attachment_modes(free, forces[:, columns])
    return Z_owned


def _batch_of_attachment_modes(free: FreeBodies, forces: sp.csc_matrix) -> np.ndarray:
    system, factor, phi_owned = free.linearised.system, free.linearised.factor, free.phi_owned
    comm = system.comm
    first, last = system.M.getOwnershipRange()
    participation = gram(comm, phi_owned, forces.tocsr()[first:last].toarray())
    first_Z = factor.solve(forces) - phi_owned @ (participation / (free.omega_2 + free.alpha)[:, None])
    Z_owned = first_Z = _without(free, first_Z)
    if len(free.omega_2) >= system.n_dof:  # all modes are computed: the rest is roundoff
        return Z_owned
    size = change = np.maximum(column_norms(comm, Z_owned), 1e-300)
    for _ in range(_MOST_ROUNDS):
        before, new = change, first_Z + _without(free, factor.solve(free.alpha * multiply(system.M, Z_owned)))
        change = column_norms(comm, new - Z_owned)
        Z_owned = new
        to_come = change * np.minimum(change / np.maximum(before, 1e-300), 1.0)  # estimate of the next change from the last rate
        if np.all(to_come <= _CONVERGED * size):
            return Z_owned
    raise ConvergenceError(
        f"attachment modes: change {np.max(change / size):.1e} after {_MOST_ROUNDS} rounds, limit "
        f"{_CONVERGED:.0e}; state more [solver] modes"
    )


def _without(free: FreeBodies, Z_owned: np.ndarray) -> np.ndarray:
    """Return the M-orthogonal projection of Z on the complement of the computed modes.  Collective: one product, one sum."""
    system = free.linearised.system
    return Z_owned - free.phi_owned @ gram(system.comm, free.phi_owned, multiply(system.M, Z_owned))
