"""Memory of structures that a script dropped without closing them: freed at the next collective call.

PETSc and MUMPS free memory collectively, so that no rank may free an object when its Python name is deleted.
"""

from __future__ import annotations

import gc
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from weakref import ref

from petsc4py import PETSc

from ..linear.factor import Factor

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..linear.direct import DirectSolver


@dataclass(frozen=True, eq=False)
class _Open:
    """A factor and its ranks; its attributes outlive it and hold its solver until it is freed."""

    comm: MPI.Comm
    factor: ref[Factor]
    attributes: dict[str, Any]

    @property
    def solver(self) -> DirectSolver | None:
        return self.attributes["_solver"]

    @property
    def is_dropped(self) -> bool:
        return self.factor() is None


_open: list[_Open] = []


def free_if_dropped(comm: MPI.Comm, factor: Factor) -> None:
    """Register a factor that the next :func:`free_dropped` frees if nothing refers to it.  Local; on every rank of ``comm``."""
    _open.append(_Open(comm, ref(factor), vars(factor)))


def free_dropped(comm: MPI.Comm) -> None:
    """Free the factors and the PETSc objects that were dropped on all ranks of ``comm``.  Collective on ``comm``."""
    of_comm = [structure for structure in _open if structure.comm == comm]
    if not of_comm:
        return
    if any(structure.solver is not None and not structure.is_dropped for structure in of_comm):
        gc.collect()  # it may hang in a circle of references
    everywhere = zip(*comm.allgather([structure.is_dropped for structure in of_comm]))
    for structure, is_dropped in zip(of_comm, everywhere):
        if all(is_dropped):
            if structure.solver is not None:
                structure.solver.destroy()
            structure.attributes.clear()  # its matrix, too
            _open.remove(structure)
    if hasattr(PETSc, "garbage_cleanup"):  # before petsc4py 3.18 an object is freed with its Python name
        PETSc.garbage_cleanup(comm)  # after MUMPS, which works on a communicator that PETSc frees with its last matrix
