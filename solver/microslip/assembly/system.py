"""What assembly (or matrices given by the user) hands on: K, M and the sparse maps R, loads, outputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from .constraints import Constraints

if TYPE_CHECKING:
    from mpi4py import MPI
    from petsc4py import PETSc


@dataclass(frozen=True)
class System:
    """``M u'' + C u' + K u + R^T f_nl = f_ex`` on the free DOFs, rows split over the ranks of ``comm``.

    docs/theory.md, eq. (1.2).  The sparse maps are small and the same on every rank; their DOF axis counts the global PETSc rows.
    """

    comm: MPI.Comm
    K: PETSc.Mat  # (n_dof, n_dof) N/m, without the joint springs; null where it was let go
    M: PETSc.Mat  # (n_dof, n_dof) kg
    C: PETSc.Mat | None  # N s/m, where the user gives one or has dampers; otherwise damping is modal
    R: sp.csr_matrix  # (3 n_pairs, n_dof) relative displacement, du = R u
    loads: sp.csc_matrix  # (n_dof, n_loads) real shapes of the loads, one or two each, per unit level [N/N]
    outputs: sp.csr_matrix  # (n_outputs, n_dof) rows o of the outputs, of displacements
    dof: np.ndarray | None  # (n_nodes, 3) row of each node of Mesh.points, -1 where fixed or dependent; None without a mesh
    parts: np.ndarray | None = None  # (n_dof_owned,) connected part of each owned row, for messages on free bodies
    part_names: tuple[str, ...] = ()  # what to call each part: its bodies
    split_by: str = "one part"  # what chose each rank's rows, for the log
    output_orders: np.ndarray | None = None  # (n_outputs,) derivatives of o u by time; None: all outputs are displacements
    output_pairs: np.ndarray | None = None  # (n_outputs, 3 n_pairs) what p adds to contact forces; None: nothing
    output_base: np.ndarray | None = None  # (n_outputs, n_loads) acceleration of the base along absolute outputs; None: none
    constraints: Constraints | None = None  # what ties and points make follow; None where there are none
    rest_owned: np.ndarray | None = None  # (n_dof_owned,) m, this rank's rows of the displacement at rest; None without statics
    notes: tuple[str, ...] = ()  # on pairs that supports fix on both sides, for the log
    moved: np.ndarray | None = None  # (n_nodes, 3) m, how far supports are moved at rest, in the order of dof; None: they rest

    @property
    def n_dof(self) -> int:
        """The number of degrees of freedom."""
        return self.R.shape[1]

    def destroy(self, other: System | None = None) -> None:
        """Free K, M and C, but for those that an ``other`` system shares; once more does nothing.  Collective."""
        shared = () if other is None else (other.K, other.M, other.C)
        for matrix in (self.K, self.M, self.C):
            if matrix is not None and not any(matrix is other_matrix for other_matrix in shared):
                matrix.destroy()

    def at_nodes(self, u: np.ndarray) -> np.ndarray:
        """Return the displacements of the nodes, (n_nodes, 3, ...), from those of all rows, (n_dof, ...).  Local.

        Zero where fixed; what is dependent follows.
        """
        assert self.dof is not None, "a structure with a mesh"
        if self.constraints is not None:
            return self.constraints.at_nodes(u)
        return np.concatenate([u, np.zeros((1, *u.shape[1:]))])[self.dof]  # row -1: what is fixed
