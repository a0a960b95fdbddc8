"""The corrector: SNES on the harmonic-balance rows and one constraint row for each parameter (docs/theory.md, section 7).

Unknowns are scaled: xi = U / |U| of the last point, nu = parameters / their scales.  Each rank has the motion of its pairs, the
parameters and their rows on the last rank.  SNES is an adapter: residual and linearisation are those of ``harmonic/``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..harmonic.balance import HarmonicBalance
from ..harmonic.few_pairs import eliminated, with_most_of
from ..harmonic.linearisation import Border, Exactness, Linearisation, Step
from ..harmonic.newton_solver import RTOL, NewtonSolver
from ..harmonic.operating_point import ContactForces
from ..harmonic.petsc_contexts import ShellMatrix, ShellSolver
from ..parallel.petsc import free
from ..system.watchdog import moved
from .constraint_rows import Constraint, Place, Scaling
from .iterate import Iterate
from .problems import Problem

PATIENCE, LEAST_PROGRESS = 4, 0.5  # Newton stops if this number of iterations leaves more than this share of the residual
MOST_ITERATIONS = 20
PATIENT, MOST_PATIENT_ITERATIONS = 25, 80  # the same where there is no other way left
SHARP = 5.0  # tolerances: allowed error of the motion of a point, by its last Newton step
SOFT = 100.0  # k |U| over the contact forces beyond which a residual counts as force
EXACT = 10.0  # tolerances of GMRES: up to this residual of a Newton system single precision is not the cause of a failure
POOR, ROUNDS = 0.2, 4  # of the residual left by a Newton step, beyond which the rows of a few pairs are solved separately
ROUNDING = 1e-2  # share of the tolerance that rounding may take up in a weighted row
_NAMES = {value: name for name, value in vars(PETSc.SNES.ConvergedReason).items() if name.startswith("DIVERGED")}


def row_weights(stiffness: np.ndarray, size: float, force: float, tolerance: float) -> np.ndarray:
    """Return weights of the residual's rows, shaped as ``stiffness``, that bound the force a residual stands for.  Local.

    A residual r [m] in a spring k is a force k r.  Where k |U| is far above the contact forces, in a joint much stiffer than
    what moves it, |r| <= tolerance |U| alone would leave them without a digit.  With w = k |U| / (SOFT |f_nl|), where that is
    above 1, w |r| <= tolerance |U| keeps k |r| below SOFT tolerance |f_nl|, within rounding.

    Parameters
    ----------
    stiffness : of the pairs' springs [N/m]
    size, force : |U| [m] and |f_nl| [N] over all ranks
    """
    most = max(ROUNDING * tolerance / float(np.finfo(float).eps), 1.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        weights = np.nan_to_num(stiffness * np.divide(size, SOFT * force), nan=1.0, posinf=most)
    return np.minimum(np.maximum(weights, 1.0), most)


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Neighbours of a maximum by the phase of an output, from which the search for the next one along the branch begins."""

    distance: float  # rad
    bend: float  # 1/rad2, of the amplitude over the phase: 1 for one mode
    sides: tuple[Iterate, Iterate]  # the solutions before and after, turned to the phase of the maximum, less it; U over its size


@dataclass(frozen=True, eq=False)
class Correction:
    """Result of one corrector solve; ``failure`` is None if it converged."""

    iterate: Iterate
    newton: int
    krylov: int
    residual: float  # scaled 2-norm
    failure: str | None
    bound: float = 0.0  # the requested tolerance
    gap: float = 0.0  # m, the most that the motion of the stiffest pairs and that under their forces differ by
    is_linear: bool = False  # the linear response, without a solve
    neighbours: tuple[Iterate, ...] = ()  # solutions before and after a maximum by the phase, where the curve may have a corner
    within: float = 0.0  # rad/s: of a maximum that is a corner, the width of its bracket; 0 where the slope is

    def with_effort_of(self, other: Correction) -> Correction:
        """Return it with the iterations of another solve added.  Local."""
        return replace(self, newton=self.newton + other.newton, krylov=self.krylov + other.krylov)


@dataclass(frozen=True, eq=False)
class BorderedSystem:
    """The equations of one solve: those of the problem, in which ``selected`` pairs may slip, and a constraint per parameter."""

    problem: Problem
    constraints: tuple[Constraint, ...]
    scaling: Scaling
    selected: np.ndarray  # (n_pairs,) bool

    @property
    def equation(self) -> HarmonicBalance:
        """The equation of the problem."""
        return self.problem.equation

    def residual(self, U: np.ndarray, nu_owned: np.ndarray, tangents: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Return this rank's rows of r(U, omega), scaled and weighted, and the k constraints.  Collective: one gather.

        ``nu_owned`` (k,) are the scaled parameters on the rank that owns them and 0 elsewhere.  Rows are NaN, a failed step on
        every rank, where the problem does not allow the parameters.  With ``tangents`` the derivatives of the contact forces,
        which are then known when they are requested, come from the same march.
        """
        scaling, k = self.scaling, len(nu_owned)
        parts = tuple(constraint.of_motion(U, scaling) for constraint in self.constraints)
        forces, nu = self._forces(U, nu_owned, tangents or self.takes_linearisation, parts)
        parameters, parts = tuple(map(float, nu * scaling.parameters)), forces.extras[:k]
        if not self.problem.allows(parameters):
            return np.full(U.shape, np.nan), np.full(k, np.nan)
        at, G = self.problem.at(parameters), None
        equation, linear = self.equation.under(at), None
        if self.takes_linearisation:
            linear = Linearisation.of(equation, at, forces)
            G = linear.G
        rows = equation.residual(U, at, forces, G) * scaling.rows / scaling.U
        place = Place(self.problem.at, scaling, U, nu, linear)
        return rows, np.array([c.value(part, place) for c, part in zip(self.constraints, parts)])

    def linearise(self, U: np.ndarray, nu_owned: np.ndarray) -> tuple[Linearisation, Border]:
        """Return the Jacobian, eq. (5.3), of the unweighted rows.  Collective: one gather, and new static columns."""
        forces, nu = self._forces(U, nu_owned, True, ())
        parameters = tuple(map(float, nu * self.scaling.parameters))
        at = self.problem.at(parameters)
        linear = Linearisation.of(self.equation.under(at), at, forces)
        units = (unit / self.scaling.U for unit in self.scaling.parameters)
        r_nu = tuple(linear.rate(rate) * unit for rate, unit in zip(self.problem.rates(parameters), units))
        place = Place(self.problem.at, self.scaling, U, nu, linear)
        n_U, n_nu = zip(*(constraint.gradient(place) for constraint in self.constraints))
        return linear, Border(r_nu, n_U, np.array(n_nu))

    @property
    def takes_linearisation(self) -> bool:
        """Whether a constraint requires the linearisation."""
        return any(constraint.takes_linearisation for constraint in self.constraints)

    def _forces(
        self, U: np.ndarray, nu_owned: np.ndarray, tangents: bool, parts: tuple[float, ...]
    ) -> tuple[ContactForces, np.ndarray]:
        """Return the contact forces, with sums of ``parts``, and the parameters nu of all ranks.  Collective: one gather.

        One sum more where parameters are those of the contact law, whose forces know them before they are gathered.
        """
        equation, comm, extras = self.equation, self.equation.comm, (*parts, *nu_owned)
        if self.problem.law_parameters:
            nu = nu_owned if comm.size == 1 else comm.allreduce(nu_owned)
            parameters = tuple(map(float, nu * self.scaling.parameters))
            equation = equation.under(self.problem.at(parameters)) if self.problem.allows(parameters) else equation
        forces = equation.contact_forces(U, self.selected, tangents, extras=extras)
        return forces, np.array(forces.extras[len(parts) :])


@dataclass(frozen=True, eq=False)
class NewtonSystem:
    """The linearisation at an iterate of Newton's method, and the step that was solved for with it last."""

    system: BorderedSystem
    linear: Linearisation
    border: Border
    exactness: Exactness
    step: Step | None = None
    right: np.ndarray | None = None  # (n_owned, 3, N_H) right-hand side of the step
    as_vector: np.ndarray | None = None  # the step as this rank's part of PETSc's vector

    @property
    def scaling(self) -> Scaling:
        """Units of the unknowns."""
        return self.system.scaling

    def is_step(self, values: np.ndarray) -> bool:
        """Return whether this rank's part of a vector is that of the step.  Local."""
        return self.as_vector is not None and np.array_equal(values, self.as_vector)


class Attempt(NamedTuple):
    """One run of SNES: PETSc's reason for its end, and the iterations it took."""

    reason: int
    newton: int
    krylov: int


class Corrector:
    """SNES with a matrix-free Jacobian, reused for the points of a branch.  Collective on ``comm``.

    Parameters
    ----------
    shape : (n_owned, 3, N_H) of this rank's motion
    n_parameters : k
    tangents_at_end : whether the derivatives of the contact forces are needed at a solution, too
    """

    def __init__(
        self, comm: MPI.Comm, shape: tuple[int, int, int], tolerance: float, n_parameters: int = 1, tangents_at_end: bool = False
    ):
        self.comm, self.shape, self.tolerance, self.k = comm, shape, tolerance, n_parameters
        self._tangents_at_end, self._is_first = tangents_at_end, False
        self.neighbours: Neighbours | None = None  # of the last maximum by its phase
        self.last = comm.rank == comm.size - 1  # owns the parameters and their rows
        self.n_U = int(np.prod(shape))
        self.newton_solver = NewtonSolver(comm)
        self._patience, self._history = PATIENCE, [0.0]
        self._newton: NewtonSystem | None = None
        self._trial: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None = None  # unknowns, their residual and constraints
        n_local = self.n_U + self.k * int(self.last)
        self._x = PETSc.Vec().createMPI((n_local, PETSc.DETERMINE), comm=comm)
        self._r = self._x.duplicate()
        sizes = (n_local, PETSc.DETERMINE)
        self._J = PETSc.Mat().createPython((sizes, sizes), context=ShellMatrix(self._multiply), comm=comm)
        self._J.setUp()
        self._snes = self._configure(PETSc.SNES().create(comm))

    def _configure(self, snes: PETSc.SNES) -> PETSc.SNES:
        snes.setOptionsPrefix("hb_")
        snes.setTolerances(rtol=0.0, atol=self.tolerance, stol=0.0, max_it=MOST_ITERATIONS)
        snes.setConvergenceTest(self._converged)
        ksp = snes.getKSP()
        ksp.setOptionsPrefix("hb_newton_")  # the options -hb_ksp_ are those of the GMRES inside
        ksp.setType(PETSc.KSP.Type.PYTHON)
        ksp.setPythonContext(ShellSolver(self._solve_step))
        ksp.getPC().setType(PETSc.PC.Type.NONE)
        snes.setFromOptions()
        self._max_it = snes.getTolerances()[3]
        return snes

    def _converged(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, ...]) -> PETSc.SNES.ConvergedReason | None:
        """Tell SNES when to stop: at the tolerance, or where the residual has fallen too little for some iterations.  Local.

        docs/theory.md, eq. (7.6): one more iteration follows where the last step says that the tolerance leaves more in U.
        """
        reasons, (_, step, norm), tolerance = PETSc.SNES.ConvergedReason, norms, snes.getTolerances()[1]
        del self._history[iteration:]
        self._history.append(norm)
        if norm <= tolerance:
            before = self._history[iteration - 1] if iteration > 0 else 0.0
            is_last = before <= tolerance or step * norm <= SHARP * tolerance * before
            return reasons.CONVERGED_FNORM_ABS if is_last else None
        if not np.isfinite(norm):
            return reasons.DIVERGED_FUNCTION_DOMAIN
        if iteration >= self._patience and norm > LEAST_PROGRESS * self._history[iteration - self._patience]:
            return reasons.DIVERGED_LOCAL_MIN
        return None

    @property
    def name(self) -> str:
        """SNES, and which of its solvers.  Local."""
        return f"SNES {self._snes.getType()}"

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        self.newton_solver.destroy()
        free(self._snes, self._J, self._x, self._r)

    def correct(
        self, system: BorderedSystem, guess: Iterate, is_patient: bool = False, tolerance: float | None = None
    ) -> Correction:
        """Solve from ``guess``.  Collective; never raises for divergence, which comes back as ``failure``.

        ``is_patient`` continues as long as the residual falls, however short the steps; ``tolerance`` is that of this solve.
        """
        moved()
        self._patience = PATIENT if is_patient else PATIENCE
        most = max(self._max_it, MOST_PATIENT_ITERATIONS) if is_patient else self._max_it
        tolerance = tolerance or self.tolerance
        self._snes.setTolerances(atol=tolerance, max_it=most)
        with np.errstate(all="ignore"):  # values that are not finite are a failed step, which SNES reports
            exactness = Exactness(system.scaling.weight)
            attempts = [self._solve(system, guess, exactness)]
            if attempts[-1].reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:  # with a preconditioner made here and now
                self.newton_solver.request_preconditioner()
                attempts.append(self._solve(system, guess, exactness))
            if attempts[-1].reason <= 0 and self.newton_solver.is_single and not self._is_exact():
                attempts.append(self._solve(system, guess, replace(exactness, in_double=True)))
        last = attempts[-1]
        self.newton_solver.weigh(last.newton, last.krylov, exactness.weight)
        newton, krylov = sum(attempt.newton for attempt in attempts), sum(attempt.krylov for attempt in attempts)
        residual, failure = self._snes.getFunctionNorm(), None
        if last.reason <= 0:
            failure = f"SNES {_NAMES.get(last.reason, last.reason)}, scaled residual {residual:.1e} (bound {tolerance:.1e})"
        gap = residual * system.scaling.U / system.scaling.weight
        return Correction(self._unpacked(system, guess), newton, krylov, residual, failure, tolerance, gap)

    def _solve(self, system: BorderedSystem, guess: Iterate, exactness: Exactness) -> Attempt:
        """Run SNES from ``guess``.  Collective."""
        self._snes.setFunction(self._residual, self._r, args=(system,))
        self._snes.setJacobian(self._linearise, self._J, args=(system, exactness))
        self._pack(guess, system.scaling)
        self._is_first, self._trial = True, None
        self._snes.solve(None, self._x)
        reason, norm = self._snes.getConvergedReason(), self._snes.getFunctionNorm()
        is_of_this_solve = self._snes.getIterationNumber() > 0  # where the first residual is not finite, SNES has the last norm
        if reason <= 0 and is_of_this_solve and norm <= self._snes.getTolerances()[1]:  # beyond the tolerance no progress is left
            reason = PETSc.SNES.ConvergedReason.CONVERGED_FNORM_ABS
        return Attempt(reason, self._snes.getIterationNumber(), self._snes.getLinearSolveIterations())

    def _is_exact(self) -> bool:
        """Return whether the last step solves its Newton system, by the residual in double precision.  Collective."""
        at = self._newton
        if at is None or at.step is None or at.right is None:
            return False
        error, size = self.comm.allreduce(np.array([np.sum((at.right - at.step.product) ** 2), np.sum(at.right**2)]))
        return bool(np.sqrt(error) <= EXACT * RTOL / at.exactness.weight * np.sqrt(size))

    def tangent(self, system: BorderedSystem, there: Iterate) -> tuple[np.ndarray, np.ndarray]:
        """Return the tangent (d_xi, d_nu) of the curve by the linearisation at ``there``, d_xi of this rank.  Collective.

        Scaled so that its product with the first constraint is 1, and with the others 0.
        """
        nu = np.divide(there.parameters, system.scaling.parameters)
        linear, border = system.linearise(there.U, nu if self.last else np.zeros(self.k))
        unit = np.zeros(self.k)
        unit[0] = 1.0
        b_nu, exactness = unit if self.last else np.zeros(self.k), Exactness(system.scaling.weight)
        step = linear.solve(np.zeros(self.shape), b_nu, border, self.newton_solver, exactness)
        return step.d_xi, self._from_last(step.d_nu_owned)

    # -- scaled unknowns in PETSc's vectors ------------------------------------------------------------------

    def _pack(self, iterate: Iterate, scaling: Scaling) -> None:
        values = self._x.getArray()
        values[: self.n_U] = iterate.U.ravel() / scaling.U
        if self.last:
            values[self.n_U :] = np.divide(iterate.parameters, scaling.parameters)

    def _unpacked(self, system: BorderedSystem, guess: Iterate) -> Iterate:
        values = self._x.getArray(readonly=True)
        parameters = self._from_last(self._nu(values)) * system.scaling.parameters
        return replace(guess, U=self._motion(values, system.scaling), parameters=tuple(map(float, parameters)))

    def _motion(self, values: np.ndarray, scaling: Scaling) -> np.ndarray:
        return (values[: self.n_U] * scaling.U).reshape(self.shape)

    def _nu(self, values: np.ndarray) -> np.ndarray:
        """Return the scaled parameters where their rows live and 0 elsewhere, so that a sum over ranks gives them."""
        return values[self.n_U :].copy() if self.last else np.zeros(self.k)

    def _from_last(self, values: np.ndarray) -> np.ndarray:
        return values if self.comm.size == 1 else self.comm.bcast(values, root=self.comm.size - 1)

    # -- SNES callbacks ----------------------------------------------------------------------------------------

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, r: PETSc.Vec, system: BorderedSystem) -> None:
        rows, constraints = self._rows(system, x.getArray(readonly=True))
        self._is_first = False
        self._write(r.getArray(), rows, constraints)

    def _rows(self, system: BorderedSystem, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residual and the constraints at unknowns; cached for the last ones.  Collective."""
        trial = self._trial
        if self.comm.allreduce(trial is not None and np.array_equal(values, trial[0]), op=MPI.LAND) and trial is not None:
            return trial[1]
        # Newton linearises at the guess, and after a step whose linear system leaves more than the tolerance
        follows = self._is_first or RTOL * self._history[-1] > self._snes.getTolerances()[1]
        rows = system.residual(self._motion(values, system.scaling), self._nu(values), follows or self._tangents_at_end)
        self._trial = values.copy(), rows
        return rows

    def _eliminate(self, x: np.ndarray, step: np.ndarray, size: float, n_active: int) -> np.ndarray:
        """Return a step from unknowns x, with the rows of few pairs solved for where these alone leave most of a residual.

        Collective.  ``size`` is the residual at x; eq. (5.9).
        """
        assert self._newton is not None, "linearised"
        system, best, pairs = self._newton.system, np.inf, np.zeros(0, dtype=int)
        tried = step
        for _ in range(ROUNDS):
            rows, constraints = self._rows(system, x - tried)
            left = np.sqrt(self.comm.allreduce(float(np.vdot(rows, rows))) + float(np.vdot(constraints, constraints)))
            if left < best:
                best, step = left, tried
            is_good = left <= max(POOR * size, self._snes.getTolerances()[1])
            if is_good or not np.isfinite(left) or system.equation.held is not None:
                break
            V, pairs = self._with_few_solved(system, x - tried, rows, pairs, n_active)
            if V is None:
                break
            tried = tried.copy()
            tried[: self.n_U] = x[: self.n_U] - V.ravel() / system.scaling.U
        return step

    def _with_few_solved(
        self, system: BorderedSystem, x: np.ndarray, rows: np.ndarray, before: np.ndarray, n_active: int
    ) -> tuple[np.ndarray | None, np.ndarray]:
        """Return the motion with the rows of the pairs ``before`` and of those with most of the residual solved for, and these.

        Collective.  None where they are many, or without success.
        """
        pairs = with_most_of(system.equation, rows, before, n_active)
        if pairs is None or not system.selected[pairs].all():
            return None, before
        at = system.problem.at(tuple(map(float, self._from_last(self._nu(x)) * system.scaling.parameters)))
        r = rows * system.scaling.U / system.scaling.rows
        return eliminated(system.equation.under(at), at, pairs, self._motion(x, system.scaling), r), pairs

    def _linearise(
        self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, B: PETSc.Mat, system: BorderedSystem, exactness: Exactness
    ) -> None:
        """Linearise for a step and for products with the Jacobian, until the next linearisation."""
        values = x.getArray(readonly=True)
        linear, border = system.linearise(self._motion(values, system.scaling), self._nu(values))
        self._newton = NewtonSystem(system, linear, border, exactness)
        J.assemble()

    def _solve_step(self, b: PETSc.Vec, x: PETSc.Vec) -> tuple[int, int]:
        """Solve a Newton system; return GMRES iterations and PETSc's reason.  Collective."""
        values, out, at = b.getArray(readonly=True), x.getArray(), self._newton
        assert at is not None, "linearised"
        b_U = values[: self.n_U].reshape(self.shape) / at.scaling.rows
        step = at.linear.solve(b_U, self._nu(values), at.border, self.newton_solver, at.exactness)
        self._write(out, step.d_xi, step.d_nu_owned)
        out[:] = self._eliminate(self._x.getArray(readonly=True), out.copy(), float(b.norm()), len(at.linear.forces.active))
        self._newton = replace(at, step=step, right=b_U, as_vector=out.copy())
        return step.iterations, step.reason

    def _multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Apply the Jacobian in scaled unknowns.  Collective: one gather.

        The line search requests the product with the last step, which is known; with few pairs solved for
        in addition, it takes the slope of the Newton step.
        """
        values, at = x.getArray(readonly=True), self._newton
        assert at is not None, "linearised"
        d_xi, d_nu = values[: self.n_U].reshape(self.shape), self._nu(values)
        if self.comm.allreduce(at.is_step(values), op=MPI.LAND):
            rows, of_rows = at.step.product, at.border.rows_times(self.comm, d_xi, d_nu)
        else:
            rows, of_rows = at.linear.product(d_xi, d_nu, at.border)
        self._write(y.getArray(), rows * at.scaling.rows, of_rows)

    def _write(self, out: np.ndarray, rows: np.ndarray, last: np.ndarray) -> None:
        out[: self.n_U] = rows.ravel()
        if self.last:
            out[self.n_U :] = last
