"""Solutions at one frequency and level: along the curve, over the level, and by deflation from many starts.

docs/theory.md, section 7.  There may be further solutions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..error_estimate.estimate import ErrorEstimator
from ..messages.errors import ConvergenceError
from ..points.branch import Branch, Point
from ..points.selection import AllPairs
from ..points.sweep import Sweep
from .branch_points import equation_at, harmonics_of, iterate_of
from .constraint_rows import Plane
from .corrector import BorderedSystem, Correction
from .deflation import DeflatedCorrector
from .follow import follow_branch
from .iterate import Iterate
from .levels import ResponseProblem, follow_level, most_points
from .maximum_by_phase import rotated
from .peaks import FromSolution
from .point_record import Unbalanced, point_record, with_stability
from .point_solver import PointSolver, Workspace
from .problems import ForcedResponse, KnownCurve, LevelHomotopy
from .task import BranchTask
from .ways_out import HOMOTOPY_STEPS, MOST_POINTS

DISTINCT = 1e-4  # of the larger motion, the smallest difference of two solutions
FROM, UP_TO = 1e-2, 10.0  # of the level, between which a curve over the level passes it
FACTORS = (0.02, 50.0)  # of a known motion, between which random starts have their sizes
ON_CURVE, OVER_LEVEL, BY_DEFLATION = "curve", "level", "deflation"


@dataclass(frozen=True, eq=False)
class Solution:
    """A solution at the frequency: its record, and its source."""

    point: Point
    iterate: Iterate
    residual: float  # scaled 2-norm
    source: str  # ON_CURVE, OVER_LEVEL or BY_DEFLATION


@dataclass(frozen=True, eq=False)
class FromThere(ForcedResponse):
    """The forced response with a known solution as its start."""

    begins: Iterate

    @property
    def curve(self) -> KnownCurve:
        """The linear response, but for the known solution."""
        return FromSolution(self, solution=self.begins)


def curve_through(of: ResponseProblem, level: float, omega: float, has_stability: bool = False) -> Branch:
    """Return the curve of a level, a frequency [rad/s] among its points, without peaks.  Collective."""
    settings = replace(of.settings, peaks=False, stability=has_stability)
    return follow_level(replace(of, settings=settings, sweep=replace(of.sweep, at=(omega,))), level)


def solutions_at(of: ResponseProblem, curve: Branch, omega: float, starts: int, seed: int, has_stability: bool) -> list[Solution]:
    """Return solutions at a frequency [rad/s], by rising amplitude; those on the ``curve`` are solved first.  Collective.

    The harmonics and samples are those of the point of the curve.

    Parameters
    ----------
    starts : number of motions from which Newton's method with deflation begins
    seed : of the random motions; the same seed gives the same motions on any number of ranks

    Raises
    ------
    ConvergenceError : no solution was found; on every rank
    """
    problem = of.at_level(curve.level)
    on_curve = [point for point in curve.points if point.requested]
    if on_curve:
        harmonics = harmonics_of(curve, on_curve[0], problem.equation.harmonics)
        problem = problem.with_equation(equation_at(on_curve[0], problem.equation, harmonics))
    workspace = Workspace(problem.equation)
    solver = PointSolver(problem, AllPairs(), Sweep(omega, omega + of.sweep.scale), of.settings.tolerance, workspace)
    estimator = None if of.enriched is None else ErrorEstimator(of.enriched)
    try:
        search = _Search(solver, omega, has_stability, estimator)
        for point in on_curve:
            search.add(iterate_of(point, problem, solver.harmonics), ON_CURVE)
        for there in over_level(solver, omega):
            search.add(there, OVER_LEVEL)
        search.deflate(starts, np.random.default_rng(seed))
    finally:
        workspace.destroy()
        if estimator is not None:
            estimator.destroy()
    if not search.solutions:
        raise ConvergenceError(f"hb: no solution at {problem.where(omega)} was found: {curve.failure or 'Newton diverges'}")
    comm = problem.equation.comm
    return sorted(search.solutions, key=lambda solution: comm.bcast(float(np.hypot(*solution.point.response[0, 1:3]))))


def over_level(solver: PointSolver, omega: float) -> Iterator[Iterate]:
    """Yield the solutions where a curve over the level, at the frequency, passes the level, folds included.  Collective."""
    level = solver.problem.at((omega,)).level
    homotopy = LevelHomotopy(solver.equation, omega)
    sweep = Sweep(FROM * level, UP_TO * level, (level,))
    task = BranchTask(homotopy, AllPairs(), sweep, HOMOTOPY_STEPS, solver.tolerance, is_homotopy=True)
    for point in follow_branch(task, MOST_POINTS).points:
        if point.requested:
            yield iterate_of(point, homotopy, solver.harmonics).at(omega)


class _Search:
    """The solutions so far.  Collective on the communicator of the solver."""

    def __init__(self, solver: PointSolver, omega: float, has_stability: bool, estimator: ErrorEstimator | None = None):
        self.solver, self.omega, self.has_stability, self.estimator = solver, omega, has_stability, estimator
        self.solutions: list[Solution] = []

    def add(self, guess: Iterate, source: str) -> bool:
        """Solve from a guess; return whether the solution is new."""
        solver = self.solver
        solution = solver.solve_at(guess, solver.norm(guess.U), solver.equation.every_pair)
        there = solution[0].iterate
        if solution[0].failure is not None or any(self.is_same(there, known.iterate) for known in self.solutions):
            return False
        try:
            point, _ = point_record(solver.problem, AllPairs(), solution, requested=True, estimator=self.estimator)
        except Unbalanced:
            return False
        if self.has_stability:
            point = with_stability(solver.problem, there, point, self.estimator)
        self.solutions.append(Solution(point, there, solution[0].residual, source))
        return True

    def is_same(self, a: Iterate, b: Iterate) -> bool:
        """Return whether two motions are equal, except for their means."""
        solver = self.solver
        away, *sizes = (solver.norm(solver.vibration(U)) for U in (a.U - b.U, a.U, b.U))
        return away <= DISTINCT * max(sizes)

    def deflate(self, starts: int, rng: np.random.Generator) -> None:
        """Search by deflation from a number of motions."""
        solver, n_tried = self.solver, 0
        corrector = DeflatedCorrector(solver.comm, solver.equation.shape, solver.tolerance)
        try:
            for guess in self.beginnings(rng):
                while n_tried < starts and self.solution_from(corrector, guess):
                    n_tried += 1
                n_tried += 1
                if n_tried >= starts:
                    return
        finally:
            corrector.destroy()

    def solution_from(self, corrector: DeflatedCorrector, guess: Iterate) -> bool:
        """Return whether deflation leads from a motion to a new solution."""
        solver, every = self.solver, self.solver.equation.every_pair
        corrector.known = [known.iterate for known in self.solutions]
        size, force = solver.norm(guess.U), solver.force(guess, every)
        if size == 0.0 or any(self.is_same(guess, known.iterate) for known in self.solutions):
            return False
        rows = (Plane.fixed_parameter(guess), *solver.problem.constraints)
        solution: Correction = corrector.correct(
            BorderedSystem(solver.problem, rows, solver.scaling(size, force), every), guess, True
        )
        return solution.failure is None and self.add(solution.iterate.at(self.omega), BY_DEFLATION)

    def beginnings(self, rng: np.random.Generator) -> Iterator[Iterate]:
        """Yield motions: the linear response, then known motions and those of single modes, of random size and phase.

        Random numbers are the same on all ranks.
        """
        solver = self.solver
        linear = solver.on_curve(self.omega)
        yield linear
        model = solver.equation.model
        k, _ = model.index_of(1)
        modes = model.groups[k].receptance.modes
        rows = slice(3 * model.owned.start, 3 * model.owned.stop)
        weights = 1.0 / np.abs(modes.omega_n**2 - self.omega**2 + 1e-3 * self.omega**2)
        while True:
            factor, theta = float(np.exp(rng.uniform(*np.log(FACTORS)))), float(rng.uniform(0.0, 2.0 * np.pi))
            known = [linear, *(known.iterate for known in self.solutions)]
            base = rotated(known[int(rng.integers(len(known)))], theta)
            j = int(rng.choice(len(weights), p=weights / weights.sum()))
            if rng.random() < 0.5:
                yield replace(base, U=factor * base.U)
                continue
            size, shape = solver.norm(linear.U), modes.R_phi[:, j]
            motion = np.exp(1j * theta) * factor * size / float(np.linalg.norm(shape) or 1.0) * shape[rows].reshape(-1, 3)
            U = np.zeros_like(linear.U)
            U[..., solver.harmonics.columns(1)] = np.stack([motion.real, -motion.imag], axis=-1)
            yield replace(linear, U=U)


def continued(of: ResponseProblem, level: float, solution: Solution, has_stability: bool) -> Branch:
    """Return the curve through a solution, followed both ways to the ends of the range or back to its frequency.  Collective.

    Segment 0 leads to higher frequencies.  ``failure`` has the reason if the curve ends within the range.
    """
    there, point = solution.iterate, solution.point
    equation = equation_at(point, of.at_level(level).equation, there.harmonics)
    problem, omega, whole = FromThere(equation, level, there), there.parameter, Branch(level)
    ends = max(of.sweep.start, of.sweep.stop), min(of.sweep.start, of.sweep.stop)
    failures = []
    for segment, end in enumerate(ends):
        if end == omega:
            continue
        steps = of.steps
        task = BranchTask(problem, AllPairs(), Sweep(omega, end), steps, of.settings.tolerance, has_stability=has_stability)
        branch = follow_branch(task, most_points(of.settings.points), segment=segment)
        whole.points += branch.points
        returns = len(branch.points) > 1 and branch.points[-1].omega == omega
        failures += [branch.failure] if branch.failure and not returns else []
    whole.failure = "; ".join(failures) or None
    return whole
