"""Bifurcations: folds of a curve and crossings of the unit circle by multipliers, enclosed between points, then solved for.

docs/theory.md, section 16.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..points.bifurcation import BRANCHING, FOLD, NEIMARK_SACKER, PERIOD_DOUBLING, Bifurcation
from ..points.branch import Branch
from ..points.multipliers import BEYOND, n_unstable
from ..points.selection import AllPairs
from ..points.sweep import Sweep
from ..stability.multipliers import N_STEPS, multipliers_at
from .branch_points import equation_at, harmonics_of, iterate_of
from .constraint_rows import Plane, Scaling
from .corrector import BorderedSystem
from .iterate import Iterate
from .outputs import outputs_at
from .point_solver import PointSolver, Workspace
from .problems import ForcedResponse

CLOSE = 1e-6  # of the way between two points, to which a bifurcation is enclosed
SAME, SAME_AMPLITUDE = 1e-6, 1e-3  # of frequency and amplitude; an amplitude at a fold changes by the root of the frequency
_REAL = 1e-3  # imaginary part up to which a multiplier is real
N_STEPS_AT_FOLDS = 512  # of the map of a cycle there, whose multiplier 1 is then as exact as the harmonics


class NotEnclosed(Exception):
    """Newton's method does not reach a place between two points, or nothing changes sign there."""


def bifurcations_of(problem: ForcedResponse, branch: Branch, tolerance: float) -> list[Bifurcation]:
    """Return folds and places where multipliers cross the unit circle along a branch with multipliers, in order.  Collective."""
    folds = list(turns(branch))
    located = [bifurcation_between(problem, branch, i - 1, i + 1, 0, tolerance) for i in folds]
    at_folds = {edge for i in folds for edge in (i - 1, i)}
    for i, k, multiplier in crossings(branch):
        if i not in at_folds or kind_of(multiplier) != BRANCHING:
            located.append(bifurcation_between(problem, branch, i, i + 1, k, tolerance))
    located.sort(key=lambda bifurcation: bifurcation.after)
    return [each for i, each in enumerate(located) if not any(is_same(each, other) for other in located[:i])]


def is_same(a: Bifurcation, b: Bifurcation) -> bool:
    """Return whether two bifurcations are the same, as where a later segment retraces an earlier one.  Local."""
    is_near = abs(a.omega - b.omega) <= SAME * b.omega
    return a.kind == b.kind and is_near and bool(np.allclose(a.amplitude, b.amplitude, rtol=SAME_AMPLITUDE, atol=0.0))


def turns(branch: Branch) -> Iterator[int]:
    """Yield the numbers of the points about which the frequency turns back.  Local."""
    omega, segment = (np.array([getattr(point, name) for point in branch.points]) for name in ("omega", "segment"))
    for i in range(1, len(omega) - 1):
        if segment[i - 1] == segment[i + 1] and (omega[i] - omega[i - 1]) * (omega[i + 1] - omega[i]) < 0.0:
            yield i


def crossings(branch: Branch) -> Iterator[tuple[int, int, complex]]:
    """Yield the points before multipliers cross the unit circle, how many are outside on one side, and the last of these."""
    for i, (a, b) in enumerate(zip(branch.points, branch.points[1:])):
        if a.segment == b.segment and a.multipliers is not None and b.multipliers is not None:
            before, after = n_unstable(a.multipliers), n_unstable(b.multipliers)
            worse, k = (a.multipliers, before) if before > after else (b.multipliers, after)
            if before != after:
                yield i, k, complex(*worse[k - 1])


def bifurcation_between(problem: ForcedResponse, branch: Branch, i: int, j: int, k: int, tolerance: float) -> Bifurcation:
    """Return the fold (k = 0), or where the k-th largest multiplier crosses the unit circle, between two points.  Collective.

    With the harmonics and samples of the point at the end.  The nearer point where nothing is enclosed.
    """
    point = branch.points[j]
    harmonics = harmonics_of(branch, point, problem.equation.harmonics)
    equation = equation_at(point, problem.equation, harmonics)
    ends = [iterate_of(branch.points[n], problem, harmonics) for n in range(i, j + 1)]
    workspace, within = Workspace(equation), max(end.parameter for end in ends) - min(end.parameter for end in ends)
    try:
        omega = [point.omega for point in branch.points]
        sweep = Sweep(min(omega), max(omega))
        arc = _Arc(PointSolver(problem.with_equation(equation), AllPairs(), sweep, tolerance, workspace), ends)
        try:
            there = arc.root(arc.turn if k == 0 else lambda there: arc.beyond(there, k))
            within = arc.within
        except NotEnclosed:
            there = ends[1] if k == 0 else ends[-1]
        return replace(_record(arc.solver, there, k), within=within, after=i + int(k == 0 and there is ends[1]))
    finally:
        workspace.destroy()


def _record(solver: PointSolver, there: Iterate, k: int) -> Bifurcation:
    """Return the record of a bifurcation.  Collective."""
    equation, at = solver.equation, solver.problem.at(there.parameters)
    values = multipliers_at(equation, at, there.U, N_STEPS if k else N_STEPS_AT_FOLDS).values
    multiplier = complex(values[k - 1] if k else values[np.argmin(np.abs(values - 1.0))])
    forces = equation.contact_forces(there.U, equation.every_pair, tangents=False)
    kind = FOLD if k == 0 else kind_of(multiplier)
    return Bifurcation(kind, at.omega, np.abs(outputs_at(equation, at, forces)), multiplier, 0.0, 0)


def kind_of(multiplier: complex) -> str:
    """Return the kind of bifurcation where this multiplier crosses the unit circle, folds excepted.  Local."""
    if abs(multiplier.imag) > _REAL * abs(multiplier):
        return NEIMARK_SACKER
    return PERIOD_DOUBLING if multiplier.real < 0.0 else BRANCHING


@dataclass
class _Arc:
    """The curve between two points of a branch, by the planes across the chord: 0 at its begin, 1 at its end.  Collective."""

    solver: PointSolver
    ends: list[Iterate]

    def __post_init__(self) -> None:
        solver, (first, *_, last) = self.solver, self.ends
        self.size = solver.norm(last.U) or 1.0
        self.force = solver.force(last, solver.equation.every_pair)
        d_U, self.d_nu = solver.vibration(last.U - first.U), solver.d_nu(first, last)
        self.normal = np.zeros_like(last.U)
        self.normal[..., solver.harmonics.vibration] = d_U / self.size
        self.length = solver.length(self.normal, self.d_nu)
        self.known = {self.place(end): end for end in self.ends}
        self.within = 0.0

    def plane(self, about: Iterate) -> Plane:
        """Return the plane across the chord through a place."""
        return Plane(about, self.normal / self.length, tuple(self.d_nu / self.length))

    def place(self, there: Iterate) -> float:
        """Return the coordinate of a place."""
        d_nu = self.solver.d_nu(self.ends[0], there)
        along = self.solver.comm.allreduce(float(np.vdot(self.normal, (there.U - self.ends[0].U) / self.size)))
        return float((along + self.d_nu @ d_nu) / self.length**2)

    def at(self, t: float) -> Iterate:
        """Return the solution at a coordinate, from a straight line between those that are known."""
        if t not in self.known:
            places = sorted(self.known)
            after = min(max(int(np.searchsorted(places, t)), 1), len(places) - 1)
            a, b = self.known[places[after - 1]], self.known[places[after]]
            share = (t - places[after - 1]) / (places[after] - places[after - 1])
            d_U, d_nu = share * (b.U - a.U), share * self.solver.d_nu(a, b)
            guess = self.solver.stepped(a, d_U, d_nu)
            solution, _ = self.solver.solve(guess, self.plane(guess), self.size, self.solver.equation.every_pair, self.force)
            if solution.failure is not None:
                raise NotEnclosed(solution.failure)
            self.known[t] = solution.iterate
        return self.known[t]

    def root(self, of: Callable[[Iterate], float]) -> Iterate:
        """Return the place where a function of solutions changes sign."""
        from scipy.optimize import brentq  # slow import, seldom needed

        values: dict[float, float] = {}

        def value(t: float) -> float:
            values[t] = of(self.at(t))
            return values[t]

        begin, end = self.place(self.ends[0]), self.place(self.ends[-1])
        if value(begin) * value(end) > 0.0:
            raise NotEnclosed("no change of sign")
        t = float(brentq(value, begin, end, xtol=CLOSE, rtol=1e-12))
        there = self.at(t)
        beyond = min((s for s in values if s != t and values[s] * values[t] <= 0.0), key=lambda s: abs(s - t))
        self.within = abs(self.known[beyond].parameter - there.parameter)
        return there

    def turn(self, there: Iterate) -> float:
        """Return d omega / dt at a solution, scaled: 0 where det J is.  docs/theory.md, eq. (16.5)."""
        solver, every = self.solver, self.solver.equation.every_pair
        system = BorderedSystem(solver.problem, (self.plane(there),), Scaling(self.size, solver.units), every)
        is_last = solver.comm.rank == solver.comm.size - 1
        owner = np.ones(1) if is_last else np.zeros(1)
        linear, border = system.linearise(there.U, owner * there.parameters / np.array(solver.units))
        newton = solver.workspace.newton_solver(solver.equation, solver.resolution)
        return solver.comm.allreduce(float(linear.solve(np.zeros_like(there.U), owner, border, newton).d_nu_owned[0]))

    def beyond(self, there: Iterate, k: int) -> float:
        """Return by how much the k-th largest multiplier is outside the unit circle."""
        multipliers = multipliers_at(self.solver.equation, self.solver.problem.at(there.parameters), there.U)
        return float(np.log(max(abs(multipliers.values[k - 1]), 1e-300)) - np.log1p(BEYOND))
