"""Contexts of PETSc's Python types: functions as a shell matrix, a shell preconditioner, a shell solver."""

from collections.abc import Callable

from petsc4py import PETSc


class ShellMatrix:
    """A matrix given by its product: ``multiply(x, y)`` writes A x into y."""

    def __init__(self, multiply: Callable[[PETSc.Vec, PETSc.Vec], None]):
        self.multiply = multiply

    def mult(self, A: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write A x into y."""
        self.multiply(x, y)


class ShellPreconditioner:
    """``precondition(x, y)`` writes the preconditioned x into y."""

    def __init__(self, precondition: Callable[[PETSc.Vec, PETSc.Vec], None]):
        self.precondition = precondition

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write the preconditioned x into y."""
        self.precondition(x, y)


class ShellSolver:
    """``solve_into(b, x)`` writes the solution for b into x and returns the iterations and PETSc's reason."""

    def __init__(self, solve_into: Callable[[PETSc.Vec, PETSc.Vec], tuple[int, int]]):
        self.solve_into = solve_into

    def solve(self, ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Write the solution for b into x, and its reason into the solver."""
        iterations, reason = self.solve_into(b, x)
        ksp.setIterationNumber(iterations)
        ksp.setConvergedReason(reason)
