"""`craig-bampton`: fixed-interface modes and constraint modes of the bodies (Craig and Bampton 1968), coupled by the joint.

docs/theory.md, eq. (8.4).  The matrices have the layout of the system; rows and columns of the interface DOFs b are replaced by a
diagonal in K and by zero in M: their modes are the modes with fixed interface.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from ...linear.dense import diagonal_owned, multiply
from ...linear.factor import Factor
from ...linear.joint_springs import Linearised
from ...modes.eigen import lowest_modes
from ...parallel.ownership import summed
from ..facts import Facts
from ..galerkin import reduce_on_basis
from ..interface_dofs import interface_dofs, unit_columns
from ..reduction import Reduction
from ..settings import ReductionSettings
from ..stuck import StuckStructure

if TYPE_CHECKING:
    from ...assembly.system import System

_BATCH = 128

FACTS = Facts(lambda _, n: n.modes + 6 * n.pairs, makes_basis=True)


def reduce(stuck: StuckStructure, settings: ReductionSettings) -> Reduction:
    """Return the reduction.  Collective: a factorisation, modes, and one solve per interface DOF."""
    system = stuck.system
    b = interface_dofs(system.R)
    fixed, k = fix_interface(system, b)
    psi_owned = constraint_modes(system, fixed, b, k)
    n_modes = min(len(stuck.modes.omega_n), system.n_dof - len(b))
    phi_owned = psi_owned[:, :0]
    if n_modes:
        phi_owned = lowest_modes(fixed, n_modes, settings.verify_modes, allows_fewer=True).phi_owned
    fixed.destroy()
    fixed.M.destroy()
    return reduce_on_basis(stuck, np.hstack([phi_owned, psi_owned]), settings)


def fix_interface(system: System, b: np.ndarray) -> tuple[Linearised, float]:
    """Return the structure with the DOFs ``b`` fixed, factored, and the diagonal k of the rows b [N/m].  Collective."""
    first, last = system.M.getOwnershipRange()
    local_dofs = b[(b >= first) & (b < last)].astype(PETSc.IntType)
    K, M = system.K.duplicate(copy=True), system.M.duplicate(copy=True)
    k = float(summed(system.comm, np.array([diagonal_owned(K).sum()]))[0]) / system.n_dof
    K.zeroRowsColumns(local_dofs, diag=k)
    M.zeroRowsColumns(local_dofs, diag=0.0)
    for matrix in (K, M):
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    K.setOption(PETSc.Mat.Option.SPD, True)
    return Linearised(system, K, M, Factor(K, system, what="K with the interface held")), k


def constraint_modes(system: System, fixed: Linearised, b: np.ndarray, k: float) -> np.ndarray:
    """Return psi, this rank's rows (n_owned, n_b): the static shape for a unit motion of one interface DOF, the others fixed.

    Collective: a product with K and a solve for each.  docs/theory.md, eq. (8.4).
    """
    first, last = system.M.getOwnershipRange()
    is_local = (b >= first) & (b < last)
    psi_owned = np.zeros((last - first, len(b)), order="F")
    for start in range(0, len(b), _BATCH):
        columns = slice(start, start + _BATCH)
        unit = unit_columns(b[columns], system.n_dof).tocsr()[first:last].toarray()
        force = -multiply(system.K, unit)
        force[b[is_local] - first] = k * unit[b[is_local] - first]
        psi_owned[:, columns] = fixed.factor.solve(force)
    return psi_owned
