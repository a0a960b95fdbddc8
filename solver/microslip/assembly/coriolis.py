"""The matrix of Coriolis forces of a structure that turns, skew-symmetric (docs/theory.md, section 12)."""

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from .. import elements
from ..mesh.data import DistributedMesh
from ..parallel.petsc import free
from ..tables.structure_tables import StructureTables
from .node_blocks import BlockSum, element_chunks, node_pattern
from .prestress import of_point_masses, on_rows_of
from .sectors import Sectors
from .spin import angular_velocity
from .system import System


@dataclass(frozen=True, eq=False)
class Coriolis:
    """G of eq. (12.16); of a disc on the rows of the sector with both faces, for all nodal diameters."""

    G: PETSc.Mat  # [kg/s]

    def of(self, system: System) -> PETSc.Mat:
        """Return G on the rows of a system, of a disc at its nodal diameter; :func:`free_of` frees it.  Collective."""
        if not isinstance(system.sectors, Sectors):
            return self.G
        matrix = system.sectors.at_diameter(self.G, system.phase)
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, False)
        return matrix

    def free_of(self, matrix: PETSc.Mat) -> None:
        """Free the matrices of :meth:`of`.  Collective."""
        if matrix is not self.G:
            free(matrix)

    def destroy(self) -> None:
        """Free G.  Collective."""
        free(self.G)


def coriolis(dmesh: DistributedMesh, tables: StructureTables, system: System) -> Coriolis:
    """Return G = 2 M Omega x of eq. (12.16) on the free DOFs.  Collective on ``dmesh.comm``."""
    turning = 2.0 * _cross(angular_velocity(tables))
    pattern = node_pattern(dmesh)
    total = BlockSum(pattern, 3)
    for block in dmesh.blocks:
        body = tables.sections[block.body]
        for chunk in element_chunks(block):
            is_owned, positions = pattern.positions(block.nodes[chunk])
            mass = elements.mass(block.kind, block.points[chunk], body.density, body.integration)
            total.add(is_owned, positions, np.einsum("eab,ij->eaibj", mass, turning))
    constraints = system.constraints
    on_points = on_places = None
    if constraints is not None:
        on_points = of_point_masses(constraints, turning)
        on_places = None if constraints.attached is None else constraints.attached.weighted(turning)
    G = on_rows_of(dmesh, system, pattern, total, on_points, on_places)
    for option in (PETSc.Mat.Option.SYMMETRY_ETERNAL, PETSc.Mat.Option.SYMMETRIC):
        G.setOption(option, False)
    return Coriolis(G)


def _cross(a: np.ndarray) -> np.ndarray:
    """Return the matrix of a x, (3, 3)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
