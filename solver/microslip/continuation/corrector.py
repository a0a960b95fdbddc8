"""The corrector: SNES on the harmonic-balance rows and one more row for the parameter, frequency or level.

Unknowns are scaled (docs/theory.md, section 7): xi = U / |U| of the last point, nu = parameter / its scale.  The
extra row is linear in (xi, nu): a plane normal to the predictor for arc-length steps, a fixed parameter otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..harmonic.direct import LARGEST, WholeInverse
from ..harmonic.newton import Gatherer, Linearisation, NewtonStep
from ..harmonic.petsc_contexts import ShellMatrix, ShellSolver
from ..harmonic.preconditioner import HarmonicPreconditioner
from ..harmonic.residual import HarmonicBalance

PATIENCE, LEAST_PROGRESS = 4, 0.5  # Newton gives up where so many iterations leave more than this share of the residual
MOST_ITERATIONS = 20
PATIENT, MOST_PATIENT_ITERATIONS = 25, 80  # the same where there is no other way left
SOFT = 100.0  # k |U| over the contact forces beyond which a residual counts as force
ROUNDING = 1e-2  # share of the tolerance that rounding may take up in a weighted row
MANY_IN_STIFF = 10  # the same where rows are weighted
MANY_KRYLOV = 50  # GMRES iterations a Newton step beyond which the preconditioner of wide slip is built, or built anew
_NAMES = {value: name for name, value in vars(PETSc.SNES.ConvergedReason).items() if name.startswith("DIVERGED")}


@dataclass(frozen=True)
class Iterate:
    """A motion of this rank's pairs and the parameter of the family, unscaled."""

    U: np.ndarray  # (n_owned, 3, N_H) m
    parameter: float  # frequency rad/s, or level N


@dataclass(frozen=True)
class Scaling:
    """Units of the unknowns in SNES and in the arc-length norm, and weights of the rows of the residual."""

    U: float  # m
    parameter: float  # rad/s or N
    rows: np.ndarray | float = 1.0  # (n_owned, 3, 1) -, at least 1; see ``row_weights``
    weight: float = 1.0  # the largest of all ranks' rows


def row_weights(stiffness: np.ndarray, size: float, force: float, tolerance: float) -> np.ndarray:
    """Return weights of the residual's rows, shaped as ``stiffness``, that bound the force a residual stands for.  Local.

    A residual r [m] in a spring k is a force k r.  Where k |U| is far above the contact forces, in a joint much stiffer than
    what moves it, |r| <= tolerance |U| alone would leave them without a digit.  With w = k |U| / (SOFT |f_nl|), where that is
    above 1, w |r| <= tolerance |U| keeps k |r| below SOFT tolerance |f_nl|, as far as rounding lets it.

    Parameters
    ----------
    stiffness : of the pairs' springs [N/m]
    size, force : |U| [m] and |f_nl| [N] over all ranks
    """
    most = max(ROUNDING * tolerance / float(np.finfo(float).eps), 1.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        weights = np.nan_to_num(stiffness * np.divide(size, SOFT * force), nan=1.0, posinf=most)
    return np.minimum(np.maximum(weights, 1.0), most)


@dataclass(frozen=True)
class ConstraintRow:
    """The row n_U . (xi - xi_0) + n_nu (nu - nu_0) = 0 about the iterate ``about``."""

    about: Iterate
    n_U: np.ndarray  # (n_owned, 3, N_H) -
    n_nu: float  # -

    @classmethod
    def fixed_parameter(cls, about: Iterate) -> ConstraintRow:
        return cls(about, np.zeros_like(about.U), 1.0)


@dataclass(frozen=True)
class Correction:
    """Outcome of one corrector solve; ``failure`` is None if it converged."""

    iterate: Iterate
    newton: int
    krylov: int
    residual: float  # scaled 2-norm
    failure: str | None
    bound: float = 0.0  # the tolerance that was asked for
    gap: float = 0.0  # m, the most that the motion of the stiffest pairs and that under their forces differ by


class Corrector:
    """SNES with a matrix-free Jacobian, kept over the points of a level.  Collective on ``problem.comm``."""

    def __init__(self, problem: HarmonicBalance, tolerance: float):
        self.problem, self.comm = problem, problem.comm
        self.last = self.comm.rank == self.comm.size - 1  # owns the row of the parameter
        self.n_U = int(np.prod(problem.shape))
        self.tolerance, self.patience = tolerance, PATIENCE
        self._step = NewtonStep(problem)
        self._wants_preconditioner = False
        self._history: list[float] = []
        self._stepped = np.empty(0)
        n_local = self.n_U + int(self.last)
        self._x = PETSc.Vec().createMPI((n_local, PETSc.DETERMINE), comm=self.comm)
        self._r = self._x.duplicate()
        sizes = (n_local, PETSc.DETERMINE)
        self._J = PETSc.Mat().createPython((sizes, sizes), context=ShellMatrix(self.apply_jacobian), comm=self.comm)
        self._J.setUp()
        self._snes = self._configure(PETSc.SNES().create(self.comm))

    def _configure(self, snes):
        snes.setOptionsPrefix("hb_")
        snes.setFunction(self._residual, self._r)
        snes.setJacobian(self._linearise, self._J)
        snes.setTolerances(rtol=0.0, atol=self.tolerance, stol=0.0, max_it=MOST_ITERATIONS)
        snes.setConvergenceTest(self._converged)
        ksp = snes.getKSP()
        ksp.setOptionsPrefix("hb_newton_")  # the options -hb_ksp_ are those of the GMRES inside
        ksp.setType(PETSc.KSP.Type.PYTHON)
        ksp.setPythonContext(ShellSolver(self.solve_step))
        ksp.getPC().setType(PETSc.PC.Type.NONE)
        snes.setFromOptions()
        return snes

    def _converged(self, snes, iteration: int, norms) -> PETSc.SNES.ConvergedReason | None:
        """Tell SNES when to stop: at the tolerance, or where the residual has fallen too little for some iterations.  Local."""
        reasons, norm = PETSc.SNES.ConvergedReason, norms[2]
        del self._history[iteration:]
        self._history.append(norm)
        if norm <= snes.getTolerances()[1]:
            return reasons.CONVERGED_FNORM_ABS
        if not np.isfinite(norm):
            return reasons.DIVERGED_FUNCTION_DOMAIN
        if iteration >= self.patience and norm > LEAST_PROGRESS * self._history[iteration - self.patience]:
            return reasons.DIVERGED_LOCAL_MIN
        return None

    @contextmanager
    def patient(self) -> Iterator[None]:
        """Go on while the residual falls at all, by however short steps.  Local."""
        usual = self._snes.getTolerances()[3]
        self.patience = PATIENT
        self._snes.setTolerances(max_it=max(usual, MOST_PATIENT_ITERATIONS))
        try:
            yield
        finally:
            self.patience = PATIENCE
            self._snes.setTolerances(max_it=usual)

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        self._step.destroy()
        for thing in (self._snes, self._J, self._x, self._r):
            thing.destroy()

    def correct(self, guess: Iterate, row: ConstraintRow, scaling: Scaling, selected: np.ndarray) -> Correction:
        """Solve from ``guess``.  Collective; never raises for divergence, which comes back as ``failure``."""
        with np.errstate(all="ignore"):  # what is not finite is a failed step, which SNES tells
            return self._correct(guess, row, scaling, selected)

    def _correct(self, guess: Iterate, row: ConstraintRow, scaling: Scaling, selected: np.ndarray) -> Correction:
        self._row, self._scaling, self._selected = row, scaling, selected
        self._step.weight = scaling.weight
        self._pack(guess, self._x)
        self._snes.solve(None, self._x)
        reason = self._snes.getConvergedReason()
        if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:  # with a preconditioner made here and now
            self._wants_preconditioner = True
            self._pack(guess, self._x)
            self._snes.solve(None, self._x)
            reason = self._snes.getConvergedReason()
        if reason <= 0 and self._step.is_single:
            self._step.in_double = True
            self._pack(guess, self._x)
            self._snes.solve(None, self._x)
            reason, self._step.in_double = self._snes.getConvergedReason(), False
        self._weigh_preconditioner()
        failure = None
        if reason <= 0:
            failure = (
                f"SNES {_NAMES.get(reason, reason)}, scaled residual {self._snes.getFunctionNorm():.1e} "
                f"(bound {self.tolerance:.1e})"
            )
        return Correction(
            self._unpack(self._x),
            self._snes.getIterationNumber(),
            self._snes.getLinearSolveIterations(),
            self._snes.getFunctionNorm(),
            failure,
            self.tolerance,
            self._snes.getFunctionNorm() * scaling.U / scaling.weight,
        )

    def residual_at(self, iterate: Iterate, row: ConstraintRow, scaling: Scaling, selected: np.ndarray) -> np.ndarray:
        """Return this rank's rows of the scaled residual.  Collective."""
        self._row, self._scaling, self._selected = row, scaling, selected
        self._pack(iterate, self._x)
        self._snes.computeFunction(self._x, self._r)
        return self._r.getArray().copy()

    def tangent(self, iterate: Iterate, row: ConstraintRow, scaling: Scaling, selected: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the direction (d_xi, d_nu) in which the linearisation at ``iterate`` goes on, d_xi of this rank.  Collective.

        Scaled so that its product with ``row`` is 1.
        """
        self.residual_at(iterate, row, scaling, selected)
        self._linearise(self._snes, self._x, self._J, self._J)
        d_xi, d_nu, _, _ = self._step.solve(self._linear, np.zeros(self.problem.shape), 1.0 if self.last else 0.0)
        return d_xi, self._from_last(d_nu)

    def _weigh_preconditioner(self) -> None:
        """Ask for a (new) preconditioner at the next linearisation where GMRES needed many iterations a Newton step."""
        newton = self._snes.getIterationNumber()
        many = MANY_KRYLOV if self._scaling.weight == 1.0 else MANY_IN_STIFF
        if newton > 0 and self._snes.getLinearSolveIterations() > many * newton:
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
        out[: self.n_U] = np.nan  # what a parameter below zero gets: a failed step, on every rank
        if parameter > 0.0:
            U_lin, _ = problem.linear_motion(parameter)
            rows = U - U_lin + problem.receptance_at(parameter, forces.active).apply(forces.p)
            out[: self.n_U] = (rows * scaling.rows).ravel() / scaling.U
        if self.last:
            out[self.n_U] = plane_U + row.n_nu * (nu - row.about.parameter / scaling.parameter)

    def _linearise(self, snes, x, J, B) -> None:
        values = x.getArray(readonly=True)
        forces = self.problem.contact_forces(self._motion(values), self._selected, tangents=True, extras=(self._nu(values),))
        parameter = forces.extras[0] * self._scaling.parameter
        G = self.problem.receptance_at(parameter, forces.active)
        _, dU_lin = self.problem.linear_motion(parameter)
        r_nu = (self.problem.force_derivative(parameter, G, forces.p) - dU_lin) * (self._scaling.parameter / self._scaling.U)
        gatherer = Gatherer(self.comm, 3 * len(forces.active_owned) * self.problem.model.N_H, 2)
        self._stepped = np.empty(0)
        self._linear = Linearisation(forces, G, r_nu, self._row.n_U, self._row.n_nu, gatherer)
        n_rows = 3 * len(forces.active) * self.problem.model.N_H
        is_small = n_rows <= LARGEST
        wanted = self._wants_preconditioner or (is_small and isinstance(self._step.preconditioner, WholeInverse))
        if wanted and n_rows > 0:
            self._step.preconditioner = (WholeInverse if is_small else HarmonicPreconditioner)(self.problem, forces, G)
            self._wants_preconditioner = False
        J.assemble()

    def solve_step(self, b, x) -> tuple[int, int]:
        """Solve a Newton system; return GMRES iterations and PETSc's reason.  Collective."""
        values, out = b.getArray(readonly=True), x.getArray()
        b_U, b_nu = values[: self.n_U].reshape(self.problem.shape) / self._scaling.rows, self._nu(values)
        d_xi, d_nu, iterations, reason = self._step.solve(self._linear, b_U, b_nu)
        out[: self.n_U] = d_xi.ravel()
        if self.last:
            out[self.n_U] = d_nu
        self._stepped = out.copy()
        return iterations, reason

    def apply_jacobian(self, x, y) -> None:
        """Apply [I + G P, dr/dnu; n_U, n_nu] in scaled unknowns.  Collective: one gather.

        The line search asks for the product with the step that was solved for last, which is known.
        """
        values, out = x.getArray(readonly=True), y.getArray()
        d_xi, d_nu = values[: self.n_U].reshape(self.problem.shape), self._nu(values)
        if self.comm.allreduce(np.array_equal(values, self._stepped), op=MPI.LAND):
            rows, of_row = self._step.product, self._linear.constraint(self.comm, d_xi, d_nu)
        else:
            rows, of_row = self._linear.product(d_xi, d_nu)
        out[: self.n_U] = (rows * self._scaling.rows).ravel()
        if self.last:
            out[self.n_U] = of_row
