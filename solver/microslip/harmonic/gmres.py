"""Right-preconditioned GMRES of PETSc for a matrix given by its product with vectors."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..parallel.petsc import free
from .petsc_contexts import ShellMatrix, ShellPreconditioner

Product = Callable[[np.ndarray, np.ndarray], None]  # (x, out): writes the product into out, this rank's rows


@dataclass(frozen=True)
class Outcome:
    """Iterations and reason of convergence or divergence of a solve."""

    iterations: int
    reason: int  # PETSc's; negative for divergence


class Gmres:
    """GMRES on vectors with ``n_owned`` rows on this rank.  Collective on ``comm``; options -hb_ksp_."""

    def __init__(self, comm: MPI.Comm, n_owned: int, multiply: Product, precondition: Product, rtol: float):
        self.n_owned = n_owned
        sizes = (n_owned, PETSc.DETERMINE)
        self._A = PETSc.Mat().createPython((sizes, sizes), context=ShellMatrix(_on_arrays(multiply)), comm=comm)
        self._A.setUp()
        self._x, self._b = self._A.createVecs()
        self._ksp = PETSc.KSP().create(comm)
        self._ksp.setOptionsPrefix("hb_")
        self._ksp.setOperators(self._A)
        self._ksp.setType(PETSc.KSP.Type.GMRES)
        self._ksp.setGMRESRestart(100)
        self._ksp.setPCSide(PETSc.PC.Side.RIGHT)  # the convergence test then uses the true residual
        self._ksp.setTolerances(rtol=rtol, atol=0.0, max_it=300)
        self._preconditioner = ShellPreconditioner(_on_arrays(precondition))
        self._is_preconditioned = False
        self._ksp.getPC().setType(PETSc.PC.Type.NONE)
        self._ksp.setFromOptions()
        self.rtol: float = self._ksp.getTolerances()[0]  # from the options

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        free(self._ksp, self._A, self._b, self._x)

    def solve(self, b: np.ndarray, is_preconditioned: bool, rtol: float | None = None) -> tuple[np.ndarray, Outcome]:
        """Return x (n_owned,), read-only and valid until the next solve, and its outcome.  Collective."""
        if rtol is not None:
            self._ksp.setTolerances(rtol=rtol)
        if is_preconditioned != self._is_preconditioned:
            self._switch(is_preconditioned)
        self._b.getArray()[:] = b
        self._ksp.solve(self._b, self._x)
        return self._x.getArray(readonly=True), Outcome(self._ksp.getIterationNumber(), self._ksp.getConvergedReason())

    def _switch(self, is_preconditioned: bool) -> None:
        """Switch the preconditioner on or off: a call of an identity costs as much as a product of a small joint."""
        self._is_preconditioned, pc = is_preconditioned, self._ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON if is_preconditioned else PETSc.PC.Type.NONE)
        if is_preconditioned:
            pc.setPythonContext(self._preconditioner)

    def reached(self, rtol: float) -> bool:
        """Return whether the last residual is at most ``rtol`` times the right-hand side.  Collective."""
        return self._ksp.getResidualNorm() <= rtol * self._b.norm()


def reuse(gmres: Gmres | None, comm: MPI.Comm, n_owned: int, make: Callable[[], Gmres]) -> Gmres:
    """Return a solver of this size: the existing one if it fits on all ranks, otherwise a new one.  Collective: one reduction."""
    is_right = gmres is not None and gmres.n_owned == n_owned
    if gmres is not None and comm.allreduce(is_right, op=MPI.LAND):
        return gmres
    if gmres is not None:
        gmres.destroy()
    return make()


def _on_arrays(product: Product) -> Callable[[PETSc.Vec, PETSc.Vec], None]:
    return lambda x, y: product(x.getArray(readonly=True), y.getArray())
