"""Solve single points of a branch, with any set of harmonics and number of samples (docs/theory.md, section 7)."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from ..error_estimate.sensitivities import exact_adjoints
from ..fourier.harmonics import Harmonics
from ..harmonic.adjoint_solver import AdjointSolver
from ..harmonic.balance import HarmonicBalance
from ..harmonic.mean_slip import is_held_by_its_joint_alone
from ..harmonic.newton_solver import NewtonSolver
from ..messages.errors import ConvergenceError
from ..points.selection import Selection
from ..points.sweep import Sweep
from .accuracy import Resolution
from .constraint_rows import Plane, Scaling
from .corrector import BorderedSystem, Correction, Corrector, row_weights
from .iterate import Iterate, PointState
from .maximum import EXACT, Maximum
from .maximum_by_phase import MaximumByPhase
from .problems import Problem

SHRINKS = 0.5  # of the unit of U: a motion below it is solved again in its own unit

Solution = tuple[Correction, np.ndarray]  # and the pairs that were allowed to slip, (n_pairs,) bool


class Workspace:
    """Reused data of a branch: PETSc's objects, numbers computed once; and the effort of its steps.

    It may be discarded between any two steps, without an effect on their results.
    """

    def __init__(self, equation: HarmonicBalance, has_bars: bool = False, n_parameters: int = 1):
        self._has_bars, self._k = has_bars, n_parameters  # bars need tangents at every point
        stiffest = float(equation.law.stiffness.max(initial=0.0))
        self.comm, self.stiffest = equation.comm, max(equation.comm.allgather(stiffest))  # N/m, the stiffest spring of all pairs
        self.spent = 0  # Newton iterations so far
        self._clock = time.perf_counter()
        self._resolution = Resolution(equation.harmonics, equation.n_samples)
        self._corrector = self._new_corrector(equation)  # now: its PETSc options then count as used even if all points are linear
        self.solver = self._corrector.name  # of Newton's method
        self._is_loose: dict[Harmonics, bool] = {}
        self._adjoints: AdjointSolver | None = None

    def corrector(self, equation: HarmonicBalance, resolution: Resolution) -> Corrector:
        """Return the corrector of a resolution, a new one if the last has another resolution.  Collective."""
        if self._resolution != resolution:
            self.destroy()
            self._resolution, neighbours = resolution, self._corrector.neighbours
            self._corrector = self._new_corrector(equation)
            self._corrector.neighbours = neighbours
        return self._corrector

    def _new_corrector(self, equation: HarmonicBalance) -> Corrector:
        return Corrector(equation.comm, equation.shape, self._resolution.tolerance, self._k, tangents_at_end=self._has_bars)

    def newton_solver(self, equation: HarmonicBalance, resolution: Resolution) -> NewtonSolver:
        """Return the solver of Newton's systems of a resolution, with its preconditioner.  Collective."""
        return self.corrector(equation, resolution).newton_solver

    def is_loose(self, equation: HarmonicBalance) -> bool:
        """Return whether a body is supported by its joint alone.  Collective at first."""
        if equation.harmonics not in self._is_loose:
            self._is_loose[equation.harmonics] = is_held_by_its_joint_alone(equation.model, equation.law)
        return self._is_loose[equation.harmonics]

    def adjoints(self, equation: HarmonicBalance) -> AdjointSolver:
        """Return the solver of exact adjoints.  Local."""
        self._adjoints = self._adjoints or exact_adjoints(equation)
        return self._adjoints

    def lap(self) -> float:
        """Return the seconds since the last call, or the beginning.  Local."""
        before, self._clock = self._clock, time.perf_counter()
        return self._clock - before

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective; once."""
        self._corrector.destroy()
        if self._adjoints is not None:
            self._adjoints.destroy()
            self._adjoints = None


@dataclass(frozen=True, eq=False)
class PointSolver:
    """Newton at one point of a branch: its units, its set B of pairs, its harmonics and samples."""

    problem: Problem
    selection: Selection
    sweep: Sweep
    tolerance: float
    workspace: Workspace
    is_linear: bool = False  # known to lie on the linear curve so far: points are tested there, not solved
    is_patient: bool = False  # with arbitrarily short Newton steps

    # -- may change from point to point --------------------------------------------------------------------

    @property
    def equation(self) -> HarmonicBalance:
        """The equation of the problem."""
        return self.problem.equation

    @property
    def comm(self) -> MPI.Comm:
        """The communicator of the ranks that follow the branch."""
        return self.equation.comm

    @property
    def harmonics(self) -> Harmonics:
        """The harmonics of the motion."""
        return self.equation.harmonics

    @property
    def resolution(self) -> Resolution:
        """Harmonics, samples and tolerance."""
        return Resolution(self.harmonics, self.equation.n_samples, self.tolerance)

    def resolved(self, resolution: Resolution) -> PointSolver:
        """Return the solver with other harmonics, samples and tolerance.  Local."""
        if resolution == self.resolution:
            return self
        equation = self.equation.resolved(resolution.harmonics, resolution.n_samples)
        return replace(self, problem=self.problem.with_equation(equation), tolerance=resolution.tolerance)

    def holding(self, mean: np.ndarray | None) -> PointSolver:
        """Return the solver with the mean slip regularised about a ``mean`` of p_t (n_owned, 2) [N], or free.  Local."""
        return replace(self, problem=self.problem.with_equation(self.equation.holding(mean)))

    @property
    def is_loose(self) -> bool:
        """Whether a body is supported by its joint alone.  Collective at first."""
        return self.workspace.is_loose(self.equation)

    # -- solving ---------------------------------------------------------------------------------------------------

    def solve(self, guess: Iterate, plane: Plane, size: float, selected: np.ndarray, force: float | None = None) -> Solution:
        """Correct a guess; with the in-point check, repeat with further pairs that slip, until none is left out.

        ``size`` [m] and ``force`` [N] of a point near by scale the residual.  If the solution is much smaller, or ``force`` is
        not known, it is solved again with its own scales.
        """
        if self.is_linear and self.problem.curve.holds(guess.parameters):
            return Correction(self.problem.curve.on(guess), 0, 0, 0.0, None, is_linear=True), selected
        size, newton, krylov = size or 1.0, 0, 0
        scaling = Scaling(size, self.units) if force is None else self.scaling(size, force)
        while True:
            corrector = self.workspace.corrector(self.equation, self.resolution)
            system = BorderedSystem(self.problem, (plane, *self.problem.constraints), scaling, selected)
            row = self.problem.maximum
            solution = row.correct(corrector, system, guess) if row else corrector.correct(system, guess, self.is_patient)
            newton, krylov = newton + solution.newton, krylov + solution.krylov
            self.workspace.spent += solution.newton
            solution = replace(solution, newton=newton, krylov=krylov)
            if solution.failure:
                return solution, selected
            size_there = self.norm(solution.iterate.U)
            if force is None or 0.0 < size_there < SHRINKS * size:
                plane = replace(plane, n_U=plane.n_U * ((size_there or size) / size))  # the same plane in the new unit
                size, force = size_there or size, self.force(solution.iterate, selected)
                scaling, guess = self.scaling(size, force), solution.iterate
                continue
            if not self.selection.checks_in_point:
                return solution, selected
            equation = self.equation_at(solution.iterate)
            active = equation.contact_forces(solution.iterate.U, equation.every_pair, tangents=False).active
            left_out = active[~selected[active]]
            if len(left_out) == 0:
                return solution, selected
            selected, guess = selected.copy(), solution.iterate
            selected[left_out] = True

    def solve_at(self, guess: Iterate, size: float, selected: np.ndarray, force: float | None = None) -> Solution:
        """Correct a guess at its own parameter; the solution has exactly that value, without rounding of the last bit.

        Raises
        ------
        ConvergenceError : the stuck structure resonates there without damping; on every rank
        """
        if not np.isfinite(self.norm(self.on_curve(guess.parameter).U)):
            raise ConvergenceError(
                f"hb: the stuck structure resonates without damping at {self.problem.where(guess.parameter)}: "
                "its linear response is infinite there; state [damping], or another frequency"
            )
        solution, selected = self.solve(guess, Plane.fixed_parameter(guess), size, selected, force)
        return replace(solution, iterate=solution.iterate.at(guess.parameter)), selected

    def solve_near(self, guess: Iterate, near: PointState, selected: np.ndarray | None = None) -> Solution:
        """Correct a guess at its own parameter, with the scales of a point near by and its pairs by default.  Collective."""
        return self.solve_at(guess, near.size, near.selected if selected is None else selected, near.force)

    def at_corner(self, solution: Solution) -> Solution:
        """Return the maximum itself if one by the phase may be below a corner; the solution if none near it is higher.

        Collective.
        """
        (below, selected), row = solution, self.problem.maximum
        if not (isinstance(row, MaximumByPhase) and below.neighbours):
            return solution
        there, corrector = below.iterate, self.workspace.corrector(self.equation, self.resolution)
        scaling = self.scaling(self.norm(there.U), self.force(there, selected))
        system = BorderedSystem(self.problem, (Plane.fixed_parameter(there),), scaling, selected)
        forward = AdjointSolver(self.comm, EXACT, np.float64)
        try:
            top = Maximum(row.output, 1, forward, below.neighbours).correct(corrector, system, there)
        finally:
            forward.destroy()
        self.workspace.spent += top.newton
        low, high = below.neighbours
        is_near = self.norm(top.iterate.U - there.U) < self.norm(high.U - low.U)
        sizes = [abs(row.amplitude(system, each)) for each in (there, top.iterate)]
        if top.failure is not None or not is_near or sizes[1] <= sizes[0]:
            return solution
        return replace(top, iterate=top.iterate.at(there.parameter)).with_effort_of(below), selected

    def first(self) -> Solution:
        """Solve the first point of the range from the known curve.  Collective."""
        guess = self.on_curve(self.sweep.start)
        return self.solve_at(guess, self.norm(guess.U), self.selection.first(self.equation.model.n_pairs))

    def on_curve(self, parameter: float) -> Iterate:
        """Return the point of the known curve at a value of the swept parameter.  Local; not to be written into."""
        return self.problem.curve.at(parameter)

    # -- from one resolution to another ------------------------------------------------------------------------------

    def carried(self, state: PointState) -> PointState:
        """Return a point in the harmonics of the problem.  Local."""
        there = state.iterate.on(self.harmonics)
        return state if there is state.iterate else replace(state, iterate=there)

    def still(self, solution: Solution, was: PointSolver) -> tuple[Solution, PointSolver]:
        """Return the solution of solver ``was`` solved again by this solver, and this solver; both unchanged if Newton fails.

        Collective.
        """
        if was.resolution == self.resolution:
            return solution, self
        guess = solution[0].iterate.on(self.harmonics)
        repeated = self.solve_at(guess, self.norm(guess.U), solution[1])
        return (solution, was) if repeated[0].failure else (repeated, self)

    def solved_again(self, state: PointState) -> PointState:
        """Return a point solved again for the present problem, so that the next step starts on the branch.  Collective."""
        state = self.carried(state)
        solution, _ = self.solve_near(state.iterate, state)
        return state if solution.failure else replace(state, iterate=solution.iterate)

    # -- units and lengths -------------------------------------------------------------------------------------------

    @property
    def units(self) -> tuple[float, ...]:
        """Units of the parameters: of the swept one its range."""
        return (self.sweep.scale, *self.problem.units)

    def d_nu(self, a: Iterate, b: Iterate) -> np.ndarray:
        """Return the difference of the scaled parameters of two iterates, (k,).  Local."""
        return np.subtract(b.parameters, a.parameters) / self.units

    def stepped(self, now: Iterate, d_U: np.ndarray, d_nu: np.ndarray) -> Iterate:
        """Return the iterate at a distance in motion (n_owned, 3, N_H) [m] and scaled parameters (k,) from another.  Local."""
        return Iterate(now.U + d_U, tuple(map(float, now.parameters + d_nu * self.units)), self.harmonics)

    def equation_at(self, there: Iterate) -> HarmonicBalance:
        """Return the equation with the contact law of an iterate's parameters.  Local."""
        return self.equation.under(self.problem.at(there.parameters))

    def scaling(self, size: float, force: float) -> Scaling:
        """Return the units of a point near one of this size [m] and force [N].  Local."""
        rows = row_weights(self.equation.law.stiffness[:, :, None], size, force, self.tolerance)
        weight = row_weights(np.array(self.workspace.stiffest), size, force, self.tolerance)
        return Scaling(size, self.units, rows, float(weight))

    def force(self, there: Iterate, selected: np.ndarray) -> float:
        """Return |f_nl| over all ranks [N] at an iterate.  Collective."""
        U, equation = there.U, self.equation_at(there)
        p = equation.full_force(equation.contact_forces(U, selected, tangents=False))
        return self.force_of(U, p.reshape(-1, *U.shape[1:])[equation.model.owned])

    def force_of(self, U: np.ndarray, p: np.ndarray) -> float:
        """Return |p + K_J U| over all ranks [N].  Collective."""
        return self.norm(p + self.equation.law.stiffness[:, :, None] * U)

    def norm(self, U: np.ndarray) -> float:
        """Return |U| over all ranks.  Collective."""
        return float(np.sqrt(self._product(U, U)))

    def _product(self, a: np.ndarray, b: np.ndarray) -> float:
        """Return a . b over all ranks.  Collective."""
        product = float(np.vdot(a, b))
        return product if self.comm.size == 1 else self.comm.allreduce(product)

    def length(self, d_xi: np.ndarray, d_nu: np.ndarray) -> float:
        """Return the length of a step in motion and scaled parameters (k,), docs/theory.md, eq. (7.1).

        The mean does not count: it drifts while the sliders settle, and changes direction sharply where that ends, although the
        branch is straight.
        """
        return float(np.hypot(self.norm(self.vibration(d_xi)), np.linalg.norm(d_nu)))

    def vibration(self, U: np.ndarray) -> np.ndarray:
        """Return the harmonics above the mean."""
        return U[..., self.harmonics.vibration]

    def distance(self, now: PointState, there: Iterate) -> float:
        """Return the length of a step in its own norm."""
        d_xi = (there.on(self.harmonics).U - now.iterate.on(self.harmonics).U) / (now.size or 1.0)
        return self.length(d_xi, self.d_nu(now.iterate, there))

    def turn(self, before: Iterate, now: Iterate, after: Iterate, size: float) -> float:
        """Return the angle [rad] between the last two steps, in the norm of the step."""
        size, (before, now, after) = max(size, 1e-300), (there.on(self.harmonics) for there in (before, now, after))
        a_xi, b_xi = (now.U - before.U) / size, (after.U - now.U) / size
        a_nu, b_nu = self.d_nu(before, now), self.d_nu(now, after)
        dot = self._product(self.vibration(a_xi), self.vibration(b_xi)) + float(a_nu @ b_nu)
        cosine = dot / max(self.length(a_xi, a_nu) * self.length(b_xi, b_nu), 1e-300)
        return float(np.arccos(min(max(cosine, -1.0), 1.0)))
