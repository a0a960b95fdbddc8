"""The result of assembly, or of matrices given by the user: K, M and the sparse maps R, loads, outputs."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..parallel.petsc import free
from .constraints import Constraints
from .real_form import real_matrix

if TYPE_CHECKING:
    from mpi4py import MPI


class Disc(Protocol):
    """What makes the systems of all nodal diameters of a disc: :class:`.sectors.Sectors`."""

    @property
    def n_sectors(self) -> int:
        """The number of sectors."""

    @property
    def blades(self) -> tuple[PETSc.Mat, PETSc.Mat] | None:
        """K and M of the bodies that differ alone, on the rows of nodes."""

    def system(self, d: int, explicit: bool = True) -> System:
        """Return the system of nodal diameter d; its matrices have no entries if complex or not ``explicit``.  Collective."""

    def at_nodes(self, w: np.ndarray) -> np.ndarray:
        """Return the motion of the sector's nodes, (n_nodes, 3, N_H), from coefficients of all rows, (n_dof, N_H).  Local."""

    def rest_at_nodes(self, w: np.ndarray) -> np.ndarray:
        """Return the displacement of the sector's nodes at rest, (n_nodes, 3), from the rows of nodal diameter 0.  Local."""

    def destroy(self, other: Any = None) -> None:
        """Free the matrices of the sector, but for those that an ``other`` disc shares.  Collective."""


@dataclass(frozen=True)
class System:
    """``M u'' + C u' + K u + R^T f_nl = f_ex`` on the free DOFs, rows split over the ranks of ``comm``.

    docs/theory.md, eq. (1.2).  The sparse maps are small and the same on every rank; their DOF axis counts the global PETSc rows.
    Of a disc at a nodal diameter d the maps are complex, loads R^H f and so on, and K, M and C are in real form (real_form.py):
    row j of the maps are rows 2 j and 2 j + 1 of these.
    """

    comm: MPI.Comm
    K: PETSc.Mat  # (n_dof, n_dof) N/m, without the joint springs; null if it was freed
    M: PETSc.Mat  # (n_dof, n_dof) kg
    C: PETSc.Mat | None  # N s/m, where the user gives one or has dampers; otherwise damping is modal
    R: sp.csr_matrix  # (3 n_pairs, n_dof) relative displacement, du = R u
    loads: sp.csc_matrix  # (n_dof, n_loads) real shapes of the loads, one or two each, per unit level [N/N]
    outputs: sp.csr_matrix  # (n_outputs, n_dof) rows o of the outputs, of displacements
    dof: np.ndarray | None  # (n_nodes, 3) row of each node of Mesh.points, -1 where fixed or dependent; None without a mesh
    parts: np.ndarray | None = None  # (n_dof_owned,) connected part of each owned row, for messages on free bodies
    part_names: tuple[str, ...] = ()  # name of each part: its bodies
    split_by: str = "one part"  # the method of the distribution to ranks, for the log
    output_orders: np.ndarray | None = None  # (n_outputs,) derivatives of o u by time; None: all outputs are displacements
    output_pairs: np.ndarray | None = None  # (n_outputs, 3 n_pairs) contribution of p to contact forces; None: zero
    output_base: np.ndarray | None = None  # (n_outputs, n_loads) acceleration of the base along absolute outputs; None: none
    constraints: Constraints | None = None  # displacements that follow by ties and points; None where there are none
    rest_owned: np.ndarray | None = (
        None  # (n_dof_owned,) m, displacement at rest, of a disc at nodal diameter 0; None: no statics
    )
    notes: tuple[str, ...] = ()  # on pairs that supports fix on both sides, for the log
    rigid_owned: np.ndarray | None = None  # (n_dof_owned, 6) rigid-body motions; (n_dof_owned, 0) with supports; None: not known
    moved: np.ndarray | None = None  # (n_nodes, 3) m, how far supports are moved at rest, in the order of dof; None: they rest
    sectors: Disc | None = None  # where it is one nodal diameter of a disc
    phase: complex = 1.0  # exp(i d alpha) of it

    @property
    def n_dof(self) -> int:
        """The number of degrees of freedom, complex ones where the maps are."""
        return self.R.shape[1]

    @property
    def is_complex(self) -> bool:
        """Whether the maps are complex, and K, M and C in real form."""
        return np.iscomplexobj(self.R)

    @property
    def in_real_form(self) -> System:
        """The same with real maps, which fit K and M: of a real system itself."""
        return RealForm.of_complex(self) if self.is_complex else self

    @property
    def maps(self) -> System:
        """The system with its own maps: of a real form the complex ones."""
        return self

    @property
    def rows(self) -> slice:
        """The rows of the degrees of freedom of this rank."""
        first, last = self.M.getOwnershipRange()
        return slice(first // 2, last // 2) if self.is_complex else slice(first, last)

    def with_conjugate_maps(self) -> System:
        """Return the system of the conjugate matrices, but for these themselves: K, M and C are shared.  Local."""
        constraints = self.constraints
        if constraints is not None:
            constraints = replace(constraints, T=constraints.T.conj())
        return replace(self, R=self.R.conj(), loads=self.loads.conj(), outputs=self.outputs.conj(), constraints=constraints)

    def destroy(self, other: System | None = None) -> None:
        """Free K, M and C, except those that an ``other`` system shares; a second call does nothing.  Collective.

        With an ``other`` one of a disc the matrices of the sector, too, unless both are about one state of rest.
        """
        shared = () if other is None else (other.K, other.M, other.C)
        for matrix in (self.K, self.M, self.C):
            if matrix is not None and not any(matrix is other_matrix for other_matrix in shared):
                free(matrix)
        if other is not None and self.sectors is not None:
            self.sectors.destroy(other.sectors)

    def at_nodes(self, u: np.ndarray) -> np.ndarray:
        """Return the displacements of the nodes, (n_nodes, 3, ...), from those of all rows, (n_dof, ...).  Local.

        Zero where fixed; dependent DOFs follow.
        """
        assert self.dof is not None, "a structure with a mesh"
        if self.constraints is not None:
            return self.constraints.at_nodes(u)
        return np.concatenate([u, np.zeros((1, *u.shape[1:]))])[self.dof]  # row -1: fixed


@dataclass(frozen=True)
class RealForm(System):
    """A complex system with real maps of twice the size, for factor and eigensolver."""

    complex_maps: System | None = None

    @classmethod
    def of_complex(cls, system: System) -> RealForm:
        """Return the real form of a complex system, which shares its matrices.  Local."""
        given = {item.name: getattr(system, item.name) for item in fields(System)}
        maps = {name: real_matrix(given[name]) for name in ("R", "loads", "outputs")}
        given |= {"R": maps["R"], "loads": maps["loads"].tocsc(), "outputs": maps["outputs"], "dof": None, "constraints": None}
        if system.parts is not None:
            given["parts"] = np.repeat(system.parts, 2)
        return cls(**given, complex_maps=system)

    @property
    def maps(self) -> System:
        """The complex system."""
        assert self.complex_maps is not None, "made of it"
        return self.complex_maps
