"""The corrector: SNES on the harmonic-balance rows and one more row for the parameter, frequency or level.

Unknowns are scaled (docs/theory.md, section 7): xi = U / |U| of the last point, nu = parameter / its scale.  The
extra row is linear in (xi, nu): a plane normal to the predictor for arc-length steps, a fixed parameter otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from ..harmonic.preconditioner import HarmonicPreconditioner
from ..harmonic.residual import ContactForces, HarmonicBalance, ReceptanceColumns

MANY_KRYLOV = 50        # GMRES iterations a Newton step beyond which the preconditioner of wide slip is built, or built anew


@dataclass(frozen=True)
class Iterate:
    """A motion of this rank's pairs and the parameter of the family, unscaled."""

    U: np.ndarray       # (n_owned, 3, N_H) m
    parameter: float    # frequency rad/s, or level N


@dataclass(frozen=True)
class Scaling:
    """Units of the unknowns in SNES and in the arc-length norm."""

    U: float            # m
    parameter: float    # rad/s or N


@dataclass(frozen=True)
class ConstraintRow:
    """The row n_U . (xi - xi_0) + n_nu (nu - nu_0) = 0 about the iterate ``about``."""

    about: Iterate
    n_U: np.ndarray     # (n_owned, 3, N_H) -
    n_nu: float         # -

    @classmethod
    def fixed_parameter(cls, about: Iterate) -> ConstraintRow:
        return cls(about, np.zeros_like(about.U), 1.0)


@dataclass(frozen=True)
class Correction:
    """Outcome of one corrector solve; ``failure`` is None if it converged."""

    iterate: Iterate
    newton: int
    krylov: int
    residual: float             # scaled 2-norm
    failure: str | None


class Gatherer:
    """Gathers the rows of all ranks in rank order and sums a few floats, in one call.  Sizes are agreed on once."""

    def __init__(self, comm, n_owned: int, n_extras: int):
        self.comm, self.n_extras = comm, n_extras
        if comm.size > 1:
            self.counts = np.array(comm.allgather(n_owned)) + n_extras
            self.starts = np.concatenate([[0], np.cumsum(self.counts)])
            self.buffer = np.empty(self.starts[-1])
            self.rows = np.concatenate([np.arange(a + n_extras, b) for a, b in zip(self.starts, self.starts[1:])])
            self.heads = self.starts[:-1, None] + np.arange(n_extras)

    def __call__(self, owned: np.ndarray, extras: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of all ranks and the sums of the extras.  Collective."""
        if self.comm.size == 1:
            return owned, np.array(extras)
        self.comm.Allgatherv(np.concatenate([extras, owned]), [self.buffer, self.counts])
        return self.buffer[self.rows], self.buffer[self.heads].sum(axis=0)


@dataclass(frozen=True)
class Linearisation:
    """What one Newton step holds fixed."""

    forces: ContactForces
    G: ReceptanceColumns
    r_nu: np.ndarray            # (n_owned, 3, N_H) d r / d nu, scaled
    gatherer: Gatherer


class _ShellJacobian:
    """What PETSc calls for a product with the Jacobian."""

    def __init__(self, corrector: Corrector):
        self.corrector = corrector

    def mult(self, J, x, y) -> None:
        self.corrector.apply_jacobian(x, y)


class _ShellPreconditioner:
    """What PETSc calls to apply the preconditioner."""

    def __init__(self, corrector: Corrector):
        self.corrector = corrector

    def apply(self, pc, x, y) -> None:
        self.corrector.apply_preconditioner(x, y)


class Corrector:
    """SNES with a matrix-free Jacobian, kept over the points of a level.  Collective on ``problem.comm``."""

    def __init__(self, problem: HarmonicBalance, tolerance: float):
        self.problem, self.comm = problem, problem.comm
        self.last = self.comm.rank == self.comm.size - 1            # owns the row of the parameter
        self.n_U = int(np.prod(problem.shape))
        self.tolerance = tolerance
        self._preconditioner: HarmonicPreconditioner | None = None
        self._wants_preconditioner = False
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
        ksp.setTolerances(rtol=1e-3, atol=0.0, max_it=300)      # Newton makes up for it; fewer products in all
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(_ShellPreconditioner(self))
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
        if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE and self._preconditioner is None:
            self._wants_preconditioner = True
            self._pack(guess, self._x)
            self._snes.solve(None, self._x)
            reason = self._snes.getConvergedReason()
        self._weigh_preconditioner()
        failure = None
        if reason <= 0:
            failure = f"SNES reason {reason}, scaled residual {self._snes.getFunctionNorm():.1e} (bound {self.tolerance:.1e})"
        return Correction(
            self._unpack(self._x), self._snes.getIterationNumber(), self._snes.getLinearSolveIterations(),
            self._snes.getFunctionNorm(), failure,
        )

    def residual_at(self, iterate: Iterate, row: ConstraintRow, scaling: Scaling, selected: np.ndarray) -> np.ndarray:
        """Return this rank's rows of the scaled residual.  Collective."""
        self._row, self._scaling, self._selected = row, scaling, selected
        self._pack(iterate, self._x)
        self._snes.computeFunction(self._x, self._r)
        return self._r.getArray().copy()

    def jacobian_times(self, iterate: Iterate, row: ConstraintRow, scaling: Scaling, selected: np.ndarray,
                       d_xi: np.ndarray, d_nu: float) -> np.ndarray:
        """Return this rank's rows of the scaled Jacobian at ``iterate`` times (d_xi, d_nu).  Collective."""
        self._row, self._scaling, self._selected = row, scaling, selected
        self._pack(iterate, self._x)
        self._linearise(self._snes, self._x, self._J, self._J)
        self._pack(Iterate(d_xi * scaling.U, d_nu * scaling.parameter), self._x)
        self._J.mult(self._x, self._r)
        return self._r.getArray().copy()

    def _weigh_preconditioner(self) -> None:
        """Ask for a (new) preconditioner at the next linearisation where GMRES needed many iterations a Newton step."""
        newton = self._snes.getIterationNumber()
        if newton > 0 and self._snes.getLinearSolveIterations() > MANY_KRYLOV * newton:
            self._wants_preconditioner = True

    # -- scaled unknowns in PETSc's vectors ------------------------------------------------------------------

    def _pack(self, iterate: Iterate, x) -> None:
        values = x.getArray()
        values[: self.n_U] = iterate.U.ravel() / self._scaling.U
        if self.last:
            values[self.n_U] = iterate.parameter / self._scaling.parameter

    def _unpack(self, x) -> Iterate:
        values = x.getArray(readonly=True)
        return Iterate(self._motion(values), self._from_last(self._nu(values)) * self._scaling.parameter)

    def _motion(self, values: np.ndarray) -> np.ndarray:
        return (values[: self.n_U] * self._scaling.U).reshape(self.problem.shape)

    def _nu(self, values: np.ndarray) -> float:
        """Return the scaled parameter where its row lives and 0 elsewhere, so that a sum over ranks gives it."""
        return float(values[self.n_U]) if self.last else 0.0

    def _from_last(self, value: float) -> float:
        return value if self.comm.size == 1 else self.comm.bcast(value, root=self.comm.size - 1)

    # -- SNES callbacks: one gather each --------------------------------------------------------------------

    def _residual(self, snes, x, r) -> None:
        problem, row, scaling, values = self.problem, self._row, self._scaling, x.getArray(readonly=True)
        U = self._motion(values)
        plane_U = float(np.vdot(row.n_U, U - row.about.U)) / scaling.U
        forces = problem.contact_forces(U, self._selected, tangents=False, extras=(plane_U, self._nu(values)))
        plane_U, nu = forces.extras
        out, parameter = r.getArray(), nu * scaling.parameter
        out[: self.n_U] = np.nan                    # what a parameter below zero gets: a failed step, on every rank
        if parameter > 0.0:
            U_lin, _ = problem.linear_motion(parameter)
            rows = U - U_lin + problem.receptance_at(parameter, forces.active).apply(forces.p)
            out[: self.n_U] = rows.ravel() / scaling.U
        if self.last:
            out[self.n_U] = plane_U + row.n_nu * (nu - row.about.parameter / scaling.parameter)

    def _linearise(self, snes, x, J, B) -> None:
        values = x.getArray(readonly=True)
        forces = self.problem.contact_forces(self._motion(values), self._selected, tangents=True, extras=(self._nu(values),))
        parameter = forces.extras[0] * self._scaling.parameter
        G = self.problem.receptance_at(parameter, forces.active)
        _, dU_lin = self.problem.linear_motion(parameter)
        r_nu = (self.problem.force_derivative(G, forces.p) - dU_lin) * (self._scaling.parameter / self._scaling.U)
        gatherer = Gatherer(self.comm, 3 * len(forces.active_owned) * self.problem.model.N_H, 2)
        self._linear = Linearisation(forces, G, r_nu, gatherer)
        if self._wants_preconditioner:
            self._preconditioner = HarmonicPreconditioner(self.problem, forces, G)
            self._wants_preconditioner = False
        J.assemble()

    def apply_preconditioner(self, x, y) -> None:
        """Apply the preconditioner, the identity in micro-slip.  Collective."""
        values, out = x.getArray(readonly=True), y.getArray()
        out[:] = values
        if self._preconditioner is not None:
            d_xi = values[: self.n_U].reshape(self.problem.shape)
            out[: self.n_U] = self._preconditioner.apply(d_xi).ravel()

    def apply_jacobian(self, x, y) -> None:
        """Apply [I + G P, dr/dnu; n_U, n_nu] in scaled unknowns.  Collective: one gather."""
        values, at, N_H = x.getArray(readonly=True), self._linear, self.problem.model.N_H
        d_xi = values[: self.n_U].reshape(self.problem.shape)
        m = len(at.forces.active_owned)
        assert at.forces.P is not None, "made of a linearisation"
        dp = np.matmul(at.forces.P, d_xi[at.forces.active_owned].reshape(m, 3 * N_H, 1))
        dp_all, (plane_U, d_nu) = at.gatherer(dp.ravel(), (float(np.vdot(self._row.n_U, d_xi)), self._nu(values)))
        out = y.getArray()
        out[: self.n_U] = (d_xi + at.G.apply(dp_all.reshape(-1, N_H)) + d_nu * at.r_nu).ravel()
        if self.last:
            out[self.n_U] = plane_U + self._row.n_nu * d_nu
