"""Follow the branch of one level through a frequency range by arc length (docs/theory.md, section 7)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..harmonic.residual import HarmonicBalance
from ..parallel.errors import ConvergenceError
from ..reduction.selection import Selection
from .branch import Branch, Point
from .corrector import ConstraintRow, Correction, Corrector, Iterate, Scaling
from .record import point_record
from .steps import ArcLength

OnPoint = Callable[[Point], None]


@dataclass(frozen=True)
class Sweep:
    """A frequency range and the direction in which it is followed."""

    start: float                        # rad/s
    stop: float                         # rad/s; below ``start`` for a sweep down
    at: tuple[float, ...] = ()          # rad/s, frequencies that must be points

    @property
    def direction(self) -> float:
        return 1.0 if self.stop > self.start else -1.0

    @property
    def omega_scale(self) -> float:
        return abs(self.stop - self.start)

    def beyond(self, omega: float) -> bool:
        return self.direction * (omega - self.stop) >= 0.0

    def before(self, omega: float) -> bool:
        return self.direction * (omega - self.start) < 0.0

    def asked_between(self, a: float, b: float) -> list[float]:
        """Return the asked frequencies strictly between two points, in the order of travel from a to b."""
        low, high = min(a, b), max(a, b)
        return sorted((w for w in self.at if low < w < high), reverse=b < a)


@dataclass(frozen=True)
class State:
    """A converged point as the next step needs it."""

    iterate: Iterate
    selected: np.ndarray            # B of the next point
    size: float                     # |U| over all ranks [m]
    sticks: bool                    # no pair slips or opens: the point lies on the linear curve
    newton: int


class BranchFollower:
    """The stepping loop of one level; what it knows of a point goes in and out as :class:`State`."""

    def __init__(self, problem: HarmonicBalance, selection: Selection, sweep: Sweep, steps: ArcLength,
                 tolerance: float, on_point: OnPoint):
        self.problem, self.selection, self.sweep, self.steps = problem, selection, sweep, steps
        self.comm = problem.comm
        self.corrector = Corrector(problem, tolerance)
        self.on_point = on_point
        self.clock = time.perf_counter()

    # -- one point ---------------------------------------------------------------------------------------------

    def solve(self, guess: Iterate, row: ConstraintRow, size: float, selected: np.ndarray) -> tuple[Correction, np.ndarray]:
        """Correct a guess; with the in-point check, again with the pairs that want to slip, until none is left out."""
        scaling = Scaling(size, self.sweep.omega_scale)
        newton = krylov = 0
        while True:
            found = self.corrector.correct(guess, row, scaling, selected)
            newton, krylov = newton + found.newton, krylov + found.krylov
            found = replace(found, newton=newton, krylov=krylov)
            if found.failure or not self.selection.checks_in_point:
                return found, selected
            forces = self.problem.contact_forces(found.iterate.U, np.ones_like(selected), tangents=False)
            left_out = forces.active[~selected[forces.active]]
            if len(left_out) == 0:
                return found, selected
            selected = selected.copy()
            selected[left_out] = True
            guess = found.iterate

    def accept(self, found: Correction, selected: np.ndarray, asked: bool = False, report: bool = True) -> tuple[State, Point]:
        """Evaluate all pairs at a converged point, record it and choose B of the next one.  Collective."""
        point, moves = point_record(self.problem, found, selected, self.selection, asked)
        now = time.perf_counter()
        point = replace(point, seconds=now - self.clock)
        self.clock = now
        state = State(found.iterate, self.selection.update(moves, point.state, point.energy),
                      self.norm(found.iterate.U), not moves.any(), found.newton)
        if report:
            self.on_point(point)
        return state, point

    def norm(self, U: np.ndarray) -> float:
        return float(np.sqrt(self.comm.allreduce(float(np.vdot(U, U)))))

    def at_frequency(self, omega: float, guess: np.ndarray, size: float, selected: np.ndarray):
        about = Iterate(guess, omega)
        return self.solve(about, ConstraintRow.fixed_frequency(about), size, selected)

    # -- the branch --------------------------------------------------------------------------------------------

    def start(self) -> tuple[State, Point]:
        """Solve the first point from the linear response; if that fails, approach its level in steps."""
        omega, n_pairs = self.sweep.start, self.problem.model.n_pairs
        selected = self.selection.first(n_pairs)
        U_lin, _ = self.problem.linear_motion(omega)
        size = self.norm(U_lin) or 1.0
        found, selected = self.at_frequency(omega, U_lin, size, selected)
        if found.failure:
            found, selected = self.raise_level(omega, selected, found)
        return self.accept(found, selected, asked=omega in self.sweep.at)

    def raise_level(self, omega: float, selected: np.ndarray, first: Correction):
        """Reach the level of this branch by steps from a lower one, each from the solution of the last."""
        level = self.problem.level
        share, step, U = 0.0, 0.25, np.zeros(self.problem.shape)
        try:
            while share < 1.0:
                target = min(share + step, 1.0)
                self.problem.level = target * level
                U_lin, _ = self.problem.linear_motion(omega)
                guess = U + (target - share) / target * U_lin
                found, chosen = self.at_frequency(omega, guess, self.norm(U_lin) or 1.0, selected)
                if found.failure is None:
                    share, U = target, found.iterate.U
                    continue
                step /= 2.0
                if step < 1e-3:
                    raise ConvergenceError(
                        f"hb: no convergence at the first frequency, {omega / 2 / np.pi:.6g} Hz, level {level:g} N: "
                        f"{first.failure}; start further from a resonance or lower the level"
                    )
            return found, chosen
        finally:
            self.problem.level = level

    def predict(self, before: State, now: State, ds: float) -> tuple[Iterate, ConstraintRow]:
        """Return the guess a step ``ds`` ahead and the row that holds the step.

        On the linear curve (all pairs stuck) the guess is the linear response itself, at a fixed frequency; otherwise
        the secant through the last two points, and the plane normal to it.
        """
        scale = self.sweep.omega_scale
        d_xi = (now.iterate.U - before.iterate.U) / now.size
        d_nu = (now.iterate.omega - before.iterate.omega) / scale
        length = self.length(d_xi, d_nu)
        if now.sticks:
            omega = now.iterate.omega + np.sign(d_nu) * self.linear_step(now, ds)
            U_lin, _ = self.problem.linear_motion(omega)
            guess = Iterate(U_lin, omega)
            return guess, ConstraintRow.fixed_frequency(guess)
        factor = ds / length
        guess = Iterate(now.iterate.U + factor * (now.iterate.U - before.iterate.U),
                        now.iterate.omega + factor * (now.iterate.omega - before.iterate.omega))
        return guess, ConstraintRow(guess, d_xi / length, d_nu / length)

    def linear_step(self, now: State, ds: float) -> float:
        """Return the change of frequency [rad/s] that makes a step ``ds`` along the linear curve."""
        _, dU = self.problem.linear_motion(now.iterate.omega)
        slope = self.norm(dU) / now.size if now.size > 0.0 else 0.0
        return ds / np.hypot(slope, 1.0 / self.sweep.omega_scale)

    def length(self, d_xi: np.ndarray, d_nu: float) -> float:
        return float(np.hypot(self.norm(d_xi), d_nu))

    def turn(self, before: State, now: State, after: State) -> float:
        """Return the angle [rad] between the last two steps, in the norm of the step."""
        scale, size = self.sweep.omega_scale, max(now.size, 1e-300)
        a_xi, b_xi = (now.iterate.U - before.iterate.U) / size, (after.iterate.U - now.iterate.U) / size
        a_nu = (now.iterate.omega - before.iterate.omega) / scale
        b_nu = (after.iterate.omega - now.iterate.omega) / scale
        dot = self.comm.allreduce(float(np.vdot(a_xi, b_xi))) + a_nu * b_nu
        cosine = dot / max(self.length(a_xi, a_nu) * self.length(b_xi, b_nu), 1e-300)
        return float(np.arccos(min(max(cosine, -1.0), 1.0)))

    def second(self, first: State, ds: float) -> tuple[Correction, np.ndarray]:
        """Solve the second point, a little further along the sweep, from the first; halve the way until it converges."""
        step = self.linear_step(first, ds)
        while True:
            omega = first.iterate.omega + self.sweep.direction * min(step, 0.5 * self.sweep.omega_scale)
            U_now, _ = self.problem.linear_motion(first.iterate.omega)
            U_next, _ = self.problem.linear_motion(omega)
            guess = U_next if first.sticks else first.iterate.U
            found, selected = self.at_frequency(omega, guess, first.size or 1.0, first.selected)
            if found.failure is None:
                return found, selected
            step /= 2.0
            if step < self.steps.ds_min * self.sweep.omega_scale:
                raise ConvergenceError(self.message(first.iterate.omega, found, step / self.sweep.omega_scale))

    def message(self, omega: float, found: Correction, ds: float) -> str:
        return (
            f"hb: no convergence beyond {omega / 2 / np.pi:.6g} Hz ({omega:.6g} rad/s) at level {self.problem.level:g} N "
            f"after {found.newton} iterations: {found.failure}; the step was halved down to {ds:.1e} "
            f"([continuation] ds_min = {self.steps.ds_min:.1e}); reduce ds_min or ds, or the level"
        )

    def step(self, before: State, now: State, ds: float) -> tuple[Correction, np.ndarray, float]:
        """Return the next converged point and the step that reached it, halved until Newton converges."""
        while True:
            guess, row = self.predict(before, now, ds)
            found, selected = self.solve(guess, row, now.size, now.selected)
            if found.failure is None and not self.turned_back(before, now, found, ds):
                return found, selected, ds
            ds /= 2.0
            if ds < self.steps.ds_min:
                raise ConvergenceError(self.message(now.iterate.omega, found, 2.0 * ds))

    def turned_back(self, before: State, now: State, found: Correction, ds: float) -> bool:
        """Tell whether a converged step fell back on the branch or jumped far from it: a sharper turn than 90 degrees."""
        after = State(found.iterate, now.selected, now.size, False, found.newton)
        return self.turn(before, now, after) > 0.5 * np.pi and ds > 8.0 * self.steps.ds_min

    def asked_points(self, now: State, after: Correction, selected: np.ndarray) -> Iterator[Point]:
        """Solve at the asked frequencies that a step has passed."""
        a, b = now.iterate, after.iterate
        for omega in self.sweep.asked_between(a.omega, b.omega):
            share = (omega - a.omega) / (b.omega - a.omega)
            found, used = self.at_frequency(omega, a.U + share * (b.U - a.U), now.size, now.selected | selected)
            if found.failure:
                raise ConvergenceError(self.message(omega, found, share))
            yield self.accept(found, used, asked=True)[1]

    def finish(self, now: State, after: Correction, selected: np.ndarray) -> Point:
        """Solve the last point at the end of the range, which a step has passed."""
        a, b = now.iterate, after.iterate
        share = (self.sweep.stop - a.omega) / (b.omega - a.omega)
        found, used = self.at_frequency(self.sweep.stop, a.U + share * (b.U - a.U), now.size, now.selected | selected)
        if found.failure:
            raise ConvergenceError(self.message(self.sweep.stop, found, share))
        return self.accept(found, used, asked=self.sweep.stop in self.sweep.at)[1]

    def points(self) -> Iterator[Point]:
        """Yield the points of the branch in order."""
        before, point = self.start()
        yield point
        found, selected = self.second(before, 0.5 * self.steps.ds)
        yield from self.asked_points(before, found, selected)
        now, point = self.accept(found, selected)
        yield point
        ds = self.steps.ds
        while True:
            found, selected, ds = self.step(before, now, ds)
            omega = found.iterate.omega
            if self.sweep.beyond(omega):
                end = replace(found, iterate=Iterate(found.iterate.U, omega))
                yield from self.asked_points(now, self.clip(now, end), selected)
                yield self.finish(now, end, selected)
                return
            if self.sweep.before(omega):
                return
            yield from self.asked_points(now, found, selected)
            after, point = self.accept(found, selected)
            yield point
            ds = self.steps.next(ds, found.newton, self.turn(before, now, after))
            before, now = now, after

    def clip(self, now: State, found: Correction) -> Correction:
        """Return the step cut off at the end of the range, by interpolation."""
        a, b = now.iterate, found.iterate
        share = (self.sweep.stop - a.omega) / (b.omega - a.omega)
        return replace(found, iterate=Iterate(a.U + share * (b.U - a.U), self.sweep.stop))


def follow_branch(problem: HarmonicBalance, selection: Selection, sweep: Sweep, steps: ArcLength, *, tolerance: float,
                  max_points: int, on_point: OnPoint = lambda point: None) -> Branch:
    """Follow the branch of one level.  Collective on ``problem.comm``.

    A branch that cannot be continued keeps its points and says why in ``failure``; nothing is raised.
    ``max_points`` bounds a branch that never reaches the end of the range.
    """
    branch = Branch(problem.level)
    follower = BranchFollower(problem, selection, sweep, steps, tolerance, on_point)
    try:
        for point in follower.points():
            branch.points.append(point)
            if len(branch.points) >= max_points:
                branch.failure = f"{max_points} points without reaching {sweep.stop / 2 / np.pi:.6g} Hz; raise [response] points"
                break
    except ConvergenceError as problem_found:
        branch.failure = str(problem_found)
    finally:
        follower.corrector.destroy()
    return branch
