"""The corrector: SNES on the harmonic-balance rows and one more row for the frequency.

Unknowns are scaled (docs/theory.md, section 7): xi = U / |U| of the last point, nu = omega / omega_scale.  The extra row is
linear in (xi, nu): a plane normal to the predictor for arc-length steps, a fixed frequency otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from ..harmonic.residual import ContactForces, HarmonicBalance


@dataclass(frozen=True)
class Iterate:
    """A motion of this rank's pairs and the frequency, unscaled."""

    U: np.ndarray       # (n_owned, 3, N_H) m
    omega: float        # rad/s


@dataclass(frozen=True)
class Scaling:
    """Units of the unknowns in SNES and in the arc-length norm."""

    U: float            # m
    omega: float        # rad/s


@dataclass(frozen=True)
class ConstraintRow:
    """The row n_U . (xi - xi_0) + n_omega (nu - nu_0) = 0 about the iterate ``about``."""

    about: Iterate
    n_U: np.ndarray     # (n_owned, 3, N_H) -
    n_omega: float      # -

    @classmethod
    def fixed_frequency(cls, about: Iterate) -> ConstraintRow:
        return cls(about, np.zeros_like(about.U), 1.0)


@dataclass(frozen=True)
class Correction:
    """Outcome of one corrector solve; ``failure`` is None if it converged."""

    iterate: Iterate
    newton: int
    krylov: int
    residual: float             # scaled 2-norm
    failure: str | None


class _ShellJacobian:
    """What PETSc calls for a product with the Jacobian."""

    def __init__(self, corrector: Corrector):
        self.corrector = corrector

    def mult(self, J, x, y) -> None:
        self.corrector.apply_jacobian(x, y)


class Corrector:
    """SNES with a matrix-free Jacobian, kept over the points of a level.  Collective on ``problem.comm``."""

    def __init__(self, problem: HarmonicBalance, tolerance: float):
        self.problem, self.comm = problem, problem.comm
        self.last = self.comm.rank == self.comm.size - 1            # owns the row of the frequency
        self.n_U = int(np.prod(problem.shape))
        self.tolerance = tolerance
        n_local = self.n_U + int(self.last)
        self._x = PETSc.Vec().createMPI((n_local, PETSc.DETERMINE), comm=self.comm)
        self._r = self._x.duplicate()
        self._J = PETSc.Mat().createPython(((n_local, PETSc.DETERMINE),) * 2, context=_ShellJacobian(self), comm=self.comm)
        self._J.setUp()
        self._snes = self._configure(PETSc.SNES().create(self.comm))

    def _configure(self, snes):
        snes.setOptionsPrefix("hb_")
        snes.setFunction(self._residual, self._r)
        snes.setJacobian(self._linearise, self._J)
        snes.setTolerances(rtol=0.0, atol=self.tolerance, stol=0.0, max_it=20)
        ksp = snes.getKSP()
        ksp.setType(PETSc.KSP.Type.GMRES)
        ksp.setGMRESRestart(100)
        ksp.setTolerances(rtol=1e-5, atol=0.0, max_it=300)
        ksp.getPC().setType(PETSc.PC.Type.NONE)
        snes.setFromOptions()
        return snes

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        for thing in (self._snes, self._J, self._x, self._r):
            thing.destroy()

    def correct(self, guess: Iterate, row: ConstraintRow, scaling: Scaling, selected: np.ndarray) -> Correction:
        """Solve from ``guess``.  Collective; never raises for divergence, which comes back as ``failure``."""
        self._row, self._scaling, self._selected = row, scaling, selected
        self._pack(guess, self._x)
        self._snes.solve(None, self._x)
        reason = self._snes.getConvergedReason()
        failure = None
        if reason <= 0:
            failure = f"SNES reason {reason}, scaled residual {self._snes.getFunctionNorm():.1e} (bound {self.tolerance:.1e})"
        return Correction(
            self._unpack(self._x), self._snes.getIterationNumber(), self._snes.getLinearSolveIterations(),
            self._snes.getFunctionNorm(), failure,
        )

    # -- scaled unknowns in PETSc's vectors ------------------------------------------------------------------

    def _pack(self, iterate: Iterate, x) -> None:
        values = x.getArray()
        values[: self.n_U] = iterate.U.ravel() / self._scaling.U
        if self.last:
            values[self.n_U] = iterate.omega / self._scaling.omega

    def _unpack(self, x) -> Iterate:
        values = x.getArray(readonly=True)
        nu = self._from_last(float(values[self.n_U]) if self.last else 0.0)
        U = (values[: self.n_U] * self._scaling.U).reshape(self.problem.shape)
        return Iterate(U, nu * self._scaling.omega)

    def _from_last(self, value: float) -> float:
        return value if self.comm.size == 1 else self.comm.bcast(value, root=self.comm.size - 1)

    def _sum(self, value: float) -> float:
        return value if self.comm.size == 1 else self.comm.allreduce(value)

    # -- SNES callbacks --------------------------------------------------------------------------------------

    def _residual(self, snes, x, r) -> None:
        iterate = self._unpack(x)
        rows, row = self._evaluate(iterate)
        values = r.getArray()
        values[: self.n_U] = rows.ravel() / self._scaling.U
        if self.last:
            values[self.n_U] = row

    def _evaluate(self, iterate: Iterate) -> tuple[np.ndarray, float]:
        problem, row, scaling = self.problem, self._row, self._scaling
        d_nu = (iterate.omega - row.about.omega) / scaling.omega
        d_xi = (iterate.U - row.about.U) / scaling.U
        plane = self._sum(float(np.vdot(row.n_U, d_xi))) + row.n_omega * d_nu
        if not iterate.omega > 0.0:                                 # a line search may try it: a failed step, on every rank
            return np.full(problem.shape, np.nan), plane
        forces = problem.contact_forces(iterate.U, self._selected, tangents=False)
        U_lin, _ = problem.linear_motion(iterate.omega)
        G = problem.receptance_at(iterate.omega, forces.active)
        return iterate.U - U_lin + G.apply(forces.p), plane

    def _linearise(self, snes, x, J, B) -> None:
        iterate = self._unpack(x)
        self._forces: ContactForces = self.problem.contact_forces(iterate.U, self._selected, tangents=True)
        self._G = self.problem.receptance_at(iterate.omega, self._forces.active)
        _, dU_lin = self.problem.linear_motion(iterate.omega)
        self._r_omega = self._G.apply_derivative(self._forces.p) - dU_lin
        J.assemble()

    def apply_jacobian(self, x, y) -> None:
        """Apply [I + G P, dr/domega; n_U, n_omega] in scaled unknowns.  Collective."""
        values, forces, N_H = x.getArray(readonly=True), self._forces, self.problem.model.N_H
        d_xi = values[: self.n_U].reshape(self.problem.shape)
        m = len(forces.active_owned)
        dp = np.einsum("mij,mj->mi", forces.P, d_xi[forces.active_owned].reshape(m, 3 * N_H))
        d_nu = self._from_last(float(values[self.n_U]) if self.last else 0.0)
        dp_gathered = self.problem._gather(dp.reshape(3 * m, N_H))
        rows = d_xi + self._G.apply(dp_gathered) + self._r_omega * (d_nu * self._scaling.omega / self._scaling.U)
        plane = self._sum(float(np.vdot(self._row.n_U, d_xi))) + self._row.n_omega * d_nu
        out = y.getArray()
        out[: self.n_U] = rows.ravel()
        if self.last:
            out[self.n_U] = plane
