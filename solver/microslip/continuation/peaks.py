"""Peaks: the maxima of the outputs along a curve, each a point of its own (docs/theory.md, section 7).

On a branch the output a has |a| stationary where (7.7) vanishes, with da/domega along the branch.  That is a constraint of the
linearisation: together with harmonic balance it is solved for the motion and the frequency at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import scipy.optimize

from ..contact.law import STICK
from ..error_estimate.estimate import output_amplitude, sensitivity
from ..fourier.harmonics import Harmonics
from ..harmonic.adjoint_solver import AdjointSolver
from ..harmonic.linearisation import Linearisation
from ..points.branch import Branch, Point
from ..points.peak import Peak
from ..points.selection import AllPairs
from ..points.sweep import Sweep
from .constraint_rows import Place, Scaling
from .corrector import BorderedSystem, Corrector
from .iterate import Iterate, interpolate
from .point_record import HELD
from .point_solver import PointSolver, Workspace
from .problems import ForcedResponse

EXACT = 1e-10  # relative tolerance of the solves in the constraint: its zero is as exact
APART = 1e-3  # unit of the frequency, over which rates are differences; those of the receptance are exact to its fourth power
CLOSEST = 1e-12  # relative width of a bracket that is halved no further

Function = Callable[[float], np.ndarray]


@dataclass(frozen=True, eq=False)
class Slope:
    """An output along a branch: its amplitude and its rate with the frequency, by way of the motion's."""

    a: np.ndarray  # (2,) cosine and sine
    a_omega: np.ndarray  # (2,) d a / d omega along the branch [s]
    V: np.ndarray  # (n_owned, 3, N_H) d U / d omega [m s]

    @property
    def product(self) -> float:
        """Re(conj(a) da/domega)."""
        return float(self.a @ self.a_omega)


@dataclass(frozen=True, eq=False)
class Stationary:
    """g = Re(conj(a) da/domega) / size = 0, eq. (7.7): the amplitude of an output is stationary along the branch."""

    output: int
    size: float  # |a|^2 over the unit of the frequency, which makes g a number
    unit: float  # rad/s, about the half-power width
    forward: AdjointSolver
    adjoint: AdjointSolver
    takes_linearisation: ClassVar[bool] = True

    def of_motion(self, U: np.ndarray, scaling: Scaling) -> float:
        return 0.0

    def value(self, of_motion: float, place: Place) -> float:
        return self.slope(place.linear).product / self.size

    def slope(self, linear: Linearisation) -> Slope:
        """Return the output and its rate at a linearisation, with dU/domega = -J^-1 dr/domega.  Collective."""
        equation, at, rows = linear.equation, linear.at, self._rows(linear)
        model, N_H = equation.model_at(at), equation.model.N_H
        p = equation.full_force(linear.forces)
        right = -equation.gather(linear.rate({"omega": 1.0})).reshape(1, -1, N_H)
        V, P_V, is_found = linear.solve_several(right, self.forward)
        B = sensitivity(model, at.omega)[rows][:, equation.model.owned_rows]
        by_motion = equation.comm.bcast(-equation.sum(B.reshape(2, -1) @ P_V[0]))
        at_fixed_forces = rate_of(lambda omega: output_amplitude(model, replace(at, omega=omega), p)[rows], at.omega, self._h)
        a, a_omega = output_amplitude(model, at, p)[rows], at_fixed_forces + by_motion
        return Slope(a, a_omega if is_found else np.full(2, np.nan), V[0].reshape(equation.shape))

    def gradient(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Return d g / d xi, eq. (7.8), and d g / d nu, by differences at fixed motion.  Collective."""
        linear, of_here = place.linear, self.slope(place.linear)
        n_U = self._by_motion(linear, of_here) * place.scaling.U / self.size
        steps = APART * np.eye(len(place.nu))
        n_nu = [(self.value(0.0, place.beside(d)) - self.value(0.0, place.beside(-d))) / (2.0 * APART) for d in steps]
        return n_U, np.array(n_nu)

    def _by_motion(self, linear: Linearisation, here: Slope) -> np.ndarray:
        """Return the derivative of Re(conj(a) da/domega) by this rank's motion, (n_owned, 3, N_H).

        Collective.  The second derivative of p is needed along dU/domega alone: P is symmetric in its two directions.
        """
        equation, at, rows = linear.equation, linear.at, self._rows(linear)
        model, shape, active = equation.model_at(at), equation.shape, linear.forces.active_owned
        own = equation.model.owned_rows
        B = sensitivity(model, at.omega)[rows]
        chi, tau, _ = linear.solve_transposed(B, self.adjoint)
        chi_a, tau_a = (np.tensordot(here.a, x.reshape(2, *shape), 1) for x in (chi, tau))
        tau_all = equation.gather(tau_a[active]).reshape(-1, shape[-1])

        def felt(omega: float) -> np.ndarray:
            """Return B^T a - G^T tau^T a at a frequency: chi^T a, with the forces' way back to the motion held."""
            there = replace(at, omega=omega)
            by_forces = np.tensordot(here.a, sensitivity(model, omega)[rows][:, own], 1).reshape(shape)
            return by_forces - equation.receptance(there, linear.forces.active).adjoint().apply(tau_all)

        of_P = np.tensordot(here.a_omega, B[:, own], 1).reshape(shape) + rate_of(felt, at.omega, self._h)
        found = np.zeros(shape)
        found[active] -= transposed_product(linear.P, of_P[active])
        step = APART * self.unit
        for way in (-1.0, 1.0):
            forces = equation.contact_forces(linear.forces.U + way * step * here.V, linear.forces.selected, tangents=True)
            assert forces.P is not None, "asked for tangents"
            changed = forces.active_owned
            found[changed] -= way / (2.0 * step) * transposed_product(forces.P, chi_a[changed])
        return found

    @property
    def _h(self) -> float:
        return APART * self.unit

    def _rows(self, linear: Linearisation) -> list[int]:
        """Return the rows of cosine and sine of the output among those of all."""
        return [self.output, linear.equation.model.n_outputs + self.output]


def transposed_product(P: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return P^T x of m pairs, (m, 3, N_H) both, for blocks P (m, 3 N_H, 3 N_H).  Local."""
    return np.matmul(x.reshape(len(x), 1, P.shape[1]), P).reshape(x.shape)


def rate_of(f: Function, omega: float, h: float) -> np.ndarray:
    """Return d f / d omega by differences of the fourth order in ``h`` [rad/s]."""
    return (8.0 * (f(omega + h) - f(omega - h)) - (f(omega + 2.0 * h) - f(omega - 2.0 * h))) / (12.0 * h)


# -- of a curve ----------------------------------------------------------------------------------------------------


def peaks_of(problem: ForcedResponse, branch: Branch, tolerance: float) -> list[Peak]:
    """Return every maximum of every output on a branch, to the solver's tolerance, by output and place.  Collective.

    A maximum lies between neighbours that are lower; one at the end of the range is none.
    """
    peaks = []
    for output, i in maxima(branch):
        solver = PeakSolver(problem, branch, output, i, tolerance)
        try:
            peaks.append(solver.solve())
        finally:
            solver.destroy()
    return peaks


def maxima(branch: Branch) -> Iterator[tuple[int, int]]:
    """Yield the outputs and the numbers of the points at which they are higher than at both neighbours.  Local."""
    if not branch.points:
        return
    sizes = np.array([np.hypot(*point.response[:, 1:3].T) for point in branch.points])  # (n_points, n_outputs)
    segment = np.array([point.segment for point in branch.points])
    inner = (segment[:-2] == segment[1:-1]) & (segment[1:-1] == segment[2:])
    tops = inner[:, None] & (sizes[1:-1] > sizes[:-2]) & (sizes[1:-1] >= sizes[2:])
    for output, i in np.argwhere(tops.T):
        yield int(output), int(i) + 1


class PeakSolver:
    """Solves for the maximum of an output about the ``i``-th point of a branch.  Collective on the problem's communicator."""

    def __init__(self, problem: ForcedResponse, branch: Branch, output: int, i: int, tolerance: float):
        self.branch, self.output, self.i = branch, output, i
        self.point: Point = branch.points[i]
        comm, harmonics = problem.equation.comm, harmonics_of(branch, self.point, problem.equation.harmonics)
        equation = problem.equation.resolved(harmonics, self.point.samples)
        equation = equation.holding(np.zeros((equation.n_owned, 2)) if HELD in self.point.notes else None)
        self.problem, self.equation, self.tolerance = problem.with_equation(equation), equation, tolerance
        self.curve = [self._iterate(branch.points[k], harmonics) for k in (i - 1, i, i + 1)]
        self.start, self.around = self.curve[1], [iterate.parameter for iterate in self.curve]
        unit = max(self.around) - min(self.around)
        size = float(np.sum(self.point.response[output, 1:3] ** 2)) / unit
        solvers = AdjointSolver(comm, EXACT, np.float64), AdjointSolver(comm, EXACT, np.float64)
        self.constraint = Stationary(output, size, unit, *solvers)
        workspace = Workspace(equation)
        sweep = Sweep(self.around[1], self.around[1] + unit)
        self.solver = PointSolver(self.problem, AllPairs(), sweep, tolerance, workspace)

    def _iterate(self, point: Point, harmonics: Harmonics) -> Iterate:
        """Return a point of the curve in the harmonics of the peak.  Collective: one broadcast."""
        model = self.equation.model
        U = model.comm.bcast(point.U if model.comm.rank == 0 else None)
        U = Harmonics.full(U.shape[-1]).carry(U, harmonics) if U.size else np.zeros((0, 3, harmonics.n_coefficients))
        return Iterate(U[model.owned], (point.omega,), harmonics)

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        self.solver.workspace.destroy()
        self.constraint.forward.destroy()
        self.constraint.adjoint.destroy()

    def solve(self) -> Peak:
        """Return the maximum: by Newton's method on motion and frequency, or else on a bracket of the frequency.  Collective."""
        width_of_curve = max(self.around) - min(self.around)
        there, newton, within = self.by_newton() or self.on_bracket() or (self.start, 0, width_of_curve)
        forces = self.equation.contact_forces(there.U, self.equation.every_pair, tangents=False)
        at = self.problem.at(there.parameters)
        amplitudes = output_amplitude(self.equation.model_at(at), at, self.equation.full_force(forces))
        cos, sin = amplitudes[[self.output, self.equation.model.n_outputs + self.output]]
        slipping = int(np.count_nonzero(self.equation.gather(forces.state) != STICK))
        width = half_power_width(self.branch, self.output, self.i, float(np.hypot(cos, sin)))
        return Peak(self.output, at.omega, complex(cos, -sin), width, within, slipping, newton, self.point.segment)

    def by_newton(self) -> tuple[Iterate, int, float] | None:
        """Return the stationary point, Newton iterations, and 0 for the width of its interval; None where there is none.

        Collective.
        """
        size, every = self.solver.norm(self.start.U), self.equation.every_pair
        if size == 0.0 or not self.slips(self.start):
            return None  # on the linear curve, whose frequency alone is unknown
        scaling = replace(self.solver.scaling(size, self.solver.force(self.start, every)), parameters=(self.constraint.unit,))
        corrector = Corrector(self.equation.comm, self.equation.shape, self.tolerance)
        try:
            found = corrector.correct(BorderedSystem(self.problem, (self.constraint,), scaling, every), self.start)
        finally:
            corrector.destroy()
        is_between = min(self.around) <= found.iterate.parameter <= max(self.around)
        return None if found.failure or not is_between else (found.iterate, found.newton, 0.0)

    def slips(self, there: Iterate) -> bool:
        """Return whether a pair slips or opens there.  Collective."""
        return len(self.equation.contact_forces(there.U, self.equation.every_pair, tangents=False).active) > 0

    def on_bracket(self) -> tuple[Iterate, int, float] | None:
        """Return a solution where the slope changes its sign between the neighbours, Newton iterations, and an interval's width.

        Collective.  The interval [rad/s] is that in which the sign changes: at a corner of the curve it does so without a zero.
        Where samples switch there are frequencies without a solution to the tolerance; the interval ends there.
        None where the slope does not change its sign, as on a curve that folds.
        """
        low, _, high = sorted(self.around)
        places: list[tuple[float, float, float, Iterate]] = []  # frequency, slope, amplitude and solution
        newton = 0

        def slope(omega: float) -> float:
            nonlocal newton
            for start in starts([*self.curve, *(place[-1] for place in places)], omega):
                solution, _ = self.solver.solve_at(start, self.solver.norm(start.U), self.equation.every_pair)
                newton += solution.newton
                if not solution.failure:
                    break
            else:
                raise ArithmeticError(solution.failure)
            at = self.problem.at(solution.iterate.parameters)
            forces = self.equation.contact_forces(solution.iterate.U, self.equation.every_pair, tangents=True)
            here = self.constraint.slope(Linearisation.of(self.equation, at, forces))
            if not np.isfinite(here.product):
                raise ArithmeticError("no rate of the motion")
            places.append((at.omega, here.product, float(np.hypot(*here.a)), solution.iterate))
            return here.product

        try:
            scipy.optimize.brentq(slope, low, high, xtol=CLOSEST * high, rtol=4.0 * np.finfo(float).eps)
        except (ArithmeticError, ValueError):  # no solution somewhere, or no change of sign
            pass
        return narrowest(sorted(places, key=lambda place: place[0]), newton)


def starts(solutions: list[Iterate], omega: float) -> Iterator[Iterate]:
    """Yield starts of a solve at a frequency: between the solutions on either side, then from the nearest ones.  Local."""
    nearest = sorted(solutions, key=lambda iterate: abs(iterate.parameter - omega))
    below, above = ([it for it in nearest if sign * (it.parameter - omega) > 0.0][:1] for sign in (-1.0, 1.0))
    yield from (interpolate(a, b, omega) for a, b in zip(below, above))
    yield from (iterate.at(omega) for iterate in nearest[:4])


def narrowest(places: list[tuple[float, float, float, Iterate]], newton: int) -> tuple[Iterate, int, float] | None:
    """Return the higher end of the interval over which the slope falls through zero, and its width; None if there is none.

    Local.  ``places`` are frequencies, slopes, amplitudes and solutions, by rising frequency.
    """
    for before, after in zip(places, places[1:]):
        if before[1] >= 0.0 >= after[1]:
            return max(before, after, key=lambda place: place[2])[-1], newton, after[0] - before[0]
    return None


def harmonics_of(branch: Branch, point: Point, otherwise: Harmonics) -> Harmonics:
    """Return the harmonics that a point was solved with: what the equation has, or as many as the accuracy chose.  Local."""
    if branch.odd:
        return Harmonics.odd_up_to(point.harmonics)
    return otherwise if otherwise.highest == point.harmonics else Harmonics.up_to(point.harmonics)


def half_power_width(branch: Branch, output: int, i: int, amplitude: float) -> float:
    """Return the width [rad/s] of a peak at the ``i``-th point, between the places of the curve at 1 / sqrt 2 of its amplitude.

    Local.  Between points 1 / |a|^2 is taken along a straight line.  NaN where the curve ends or rises before it is so low.
    """
    sides = []
    for way in (-1, 1):
        k, before = i + way, (branch.points[i].omega, 1.0)
        while 0 <= k < len(branch.points) and branch.points[k].segment == branch.points[i].segment:
            lower = float(np.hypot(*branch.points[k].response[output, 1:3]))
            here = branch.points[k].omega, (amplitude / lower) ** 2 if lower > 0.0 else np.inf
            if here[1] >= 2.0:
                share = (2.0 - before[1]) / (here[1] - before[1])
                sides.append(before[0] + share * (here[0] - before[0]))
                break
            if here[1] < before[1] and k != i + way:
                break
            before, k = here, k + way
    return abs(sides[1] - sides[0]) if len(sides) == 2 else float("nan")
