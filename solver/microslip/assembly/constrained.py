"""The system of the independent degrees of freedom, with ties, points and equations eliminated (docs/theory.md, section 2)."""

from dataclasses import replace

import numpy as np
from petsc4py import PETSc

from ..messages.errors import CaseError
from .constraints import Constraints, damping_of, mass_blocks, reduced, stiffness_blocks, tidy
from .system import System


def constrained(
    system: System, constraints: Constraints, part: np.ndarray, matrices: tuple[PETSc.Mat, PETSc.Mat] | None = None
) -> System:
    """Return the system of the independent DOFs: K' = T^H K T, M' = T^H M T, R' = R T and so on, eq. (2.5).

    Collective; destroys K and M of ``system`` unless the ``matrices`` K' and M' are given.  The maps of ``system`` have a column
    for each row of T.  ``part`` (n_nodes,) is that of each node.

    Raises
    ------
    CaseError : nothing can move, or a load moves nothing; on every rank
    """
    T = constraints.T
    if constraints.n_dof == 0:
        raise CaseError("[[supports]] fix every degree of freedom; nothing can move")
    loads = (T.conj().T @ system.loads).tocsc()
    for i in np.flatnonzero((np.diff(loads.indptr) == 0) & (np.diff(system.loads.indptr) > 0)):  # a shape may be none at all
        raise CaseError(f"[[loads]] {i + 1} acts only on degrees of freedom that a support fixes; it moves nothing")
    attached = constraints.attached
    K, M = matrices or reduced_matrices(system, constraints)
    return replace(
        system,
        K=K,
        M=M,
        C=None if attached is None or attached.C is None else damping_of(attached.C, constraints, system.comm),
        R=tidy(system.R @ T),
        loads=loads,
        outputs=tidy(system.outputs @ T),
        dof=constraints.free[: len(part)],
        parts=_parts(constraints, part, system.comm.rank),
        constraints=constraints,
    )


def reduced_matrices(system: System, constraints: Constraints) -> tuple[PETSc.Mat, PETSc.Mat]:
    """Return T^T K T and T^T M T of real T, with points, masses and springs.  Collective; destroys K and M of ``system``."""
    points, attached = constraints.points, constraints.attached
    M = reduced(system.M, constraints, mass_blocks(points), None if attached is None else attached.M)
    M.setOption(PETSc.Mat.Option.SPD, True)
    return reduced(system.K, constraints, stiffness_blocks(points), None if attached is None else attached.K), M


def _parts(constraints: Constraints, part: np.ndarray, rank: int) -> np.ndarray:
    """Return the connected part of each owned row, that of a point being the part of its group."""
    of_places = np.concatenate([part, np.repeat(part[list(constraints.group_nodes)], 2)])
    place, axis = np.nonzero(constraints.free >= 0)
    rows = np.empty(constraints.n_dof, dtype=part.dtype)
    rows[constraints.free[place, axis]] = of_places[place]
    return rows[slice(*constraints.row_ranges[rank : rank + 2])]
