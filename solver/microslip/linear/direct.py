"""The direct solver of a symmetric matrix: MUMPS, or the package that PETSc's options name."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from . import bridge, mumps, other_package
from .analysis import FactorMemory, scaled_memory
from .ordering import Elimination, Order


class DirectSolver(Protocol):
    """The factor of a matrix A (n_dof, n_dof), rows split over the ranks; every method is collective, answers are unchecked."""

    @property
    def order(self) -> Order | None:
        """The order of elimination; None, on every rank, if the package chose it."""

    def solve(self, B: np.ndarray | sp.csc_matrix) -> np.ndarray:
        """Return this rank's rows of A^-1 B, (n_owned, m), column-major; B is its rows, or sparse (n_dof, m), the same on all."""

    def inverse_entries(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray | None:
        """Return entries of A^-1 in rising rows and columns on rank 0, (0, 0) elsewhere; None if they are not available."""

    def destroy(self) -> None:
        """Free the factor."""


def factorise(
    A: PETSc.Mat,
    prefix: str,
    what: str,
    *,
    elimination: Elimination = Elimination(),  # noqa: B008  frozen
    shift: tuple[float, PETSc.Mat] | None = None,
    later: Callable[[FactorMemory], float] | None = None,
) -> tuple[DirectSolver, dict[str, Any]]:
    """Factor A by MUMPS, :func:`.mumps.factorise`, or by the package that the options of ``prefix`` name.  Collective.

    Without the bridge to MUMPS, PETSc calls it.
    """
    if other_package.is_requested(prefix) or not bridge.is_there(A.comm.tompi4py()):
        return other_package.factorise(A, prefix, what, shift)
    return mumps.factorise(A, prefix, what, elimination=elimination, shift=shift, later=later)


def foreseen(graph: PETSc.Mat, n_dof_each: int, entries_owned: int) -> FactorMemory | None:
    """Return the memory of a factor on this rank, from the coupling of nodes with ``n_dof_each`` unknowns each.

    Collective on the graph's communicator; nothing is solved.  ``entries_owned`` of the matrix lie on this rank.  None, on every
    rank, where the options name another package than MUMPS, or its analysis fails.
    """
    if other_package.is_requested("static_"):
        return None
    analysed: mumps.MumpsFactor | other_package.PackageFactor
    if bridge.is_there(graph.comm.tompi4py()):
        analysed = mumps.analysed(graph, "static_", "the coupling of nodes")
    else:
        analysed = other_package.PackageFactor(other_package.analyse(graph, "static_"))
    try:
        return scaled_memory(analysed.mumps, n_dof_each, entries_owned) if analysed.mumps.infog(20) else None
    finally:
        analysed.destroy()
