"""Follow the branch of one level through a frequency range by arc length (docs/theory.md, section 7)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ..contact.law import STICK
from ..error_estimate.estimate import ErrorEstimator
from ..fourier.harmonics import Harmonics
from ..harmonic.residual import DampingFamily, HarmonicBalance, LevelFamily
from ..parallel.errors import ConvergenceError
from ..reduction.selection import Selection
from .accuracy import Accuracy
from .branch import Branch, Point
from .corrector import Correction, Iterate
from .point_record import point_record
from .point_solver import State, interpolate
from .stepper import Stepper
from .steps import ArcLength
from .sweep import Sweep

# the way to a first point that Newton does not reach at once: steps over the level or further damping
APPROACH = ArcLength(ds=0.2, ds_min=2e-4, ds_max=1.0)
BEGINNINGS = {LevelFamily: (1e-2, 1e-4), DampingFamily: (1e-1, 1e-3)}  # of the parameter at the end of such a way
MOST_APPROACH_ITERATIONS = 1500  # of Newton, on one such way; those that arrive take some hundreds
MOST_APPROACH_POINTS = 1000
FINEST_WAY = 1e-2  # of the way from a point to an asked value: the smallest step in between
MISSED = "accuracy not met: more harmonics or samples than the program uses or the scene states, or no convergence with them"
UNBALANCED = 5e-6  # of the forces beyond which a point is not one, at a tolerance of 1e-8
REACHED = {
    way: f"first point {how}, where there may be other solutions"
    for way, how in (  # the notes of such a point
        ("over_the_level", "reached over the level"),
        ("from_rest", "found from rest"),
        ("patiently", "found by small Newton steps"),
        ("over_damping", "reached over further damping"),
    )
}
MOSTLY = 0.8  # share of the pairs that slip or are open, from which the mean of the slip may be held
NOTHING = np.empty((0, 3, 0))  # the motion of a recorded point on ranks other than 0


class BranchFollower(Stepper):
    """The stepping loop of one branch; what it knows of a point goes in and out as :class:`State`."""

    reached: str | None = None  # how the first point was, where not from the linear response; noted with it
    scaled = False  # whether all points so far are the linear response, found without solving

    def __init__(
        self,
        problem: HarmonicBalance,
        selection: Selection,
        sweep: Sweep,
        steps: ArcLength,
        tolerance: float,
        estimator: ErrorEstimator | None = None,
        accuracy: Accuracy | None = None,
    ):
        if accuracy is not None:
            problem = problem.resolved(accuracy.coarsest.harmonics, accuracy.coarsest.n_samples)
            tolerance = tolerance if "solver" in accuracy.keeps else accuracy.coarsest.tolerance
        super().__init__(problem, selection, sweep, steps, tolerance)
        self.estimator, self.accuracy = estimator, accuracy
        self.clock = time.perf_counter()

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        super().destroy()
        if self.estimator is not None:
            self.estimator.destroy()

    # -- one point ---------------------------------------------------------------------------------------------

    def accept(
        self, found: Correction, selected: np.ndarray, asked: bool = False, on_the_way: bool = False
    ) -> tuple[State, Point]:
        """Evaluate all pairs at a converged point, record it and choose B of the next one.  Collective.

        A point ``on_the_way`` to one that counts has no error bar, and leaves harmonics and samples as they are.
        """
        estimator = None if on_the_way else self.estimator
        while True:
            try:
                point, moves = point_record(self.problem, found, selected, self.selection, asked, estimator)
                self._check_forces(found, point)
            except ConvergenceError:
                tighter = self.accuracy and self.accuracy.tighter(self.resolution)  # its residual alone may be to blame
                better, used = self.solve_with(tighter, found, selected) if tighter else (found, selected)
                if not tighter or better.failure:
                    raise
                found, selected = better, used
                continue
            ratios = self.ratios(point)
            finer = self.accuracy and self.accuracy.finer(self.resolution, ratios)
            if not finer:
                break
            better, used = self.solve_with(finer, found, selected, self.force_at(found.iterate, point))
            if better.failure:
                break
            found, selected = better, used
        if max(ratios.values(), default=0.0) > 1.0:
            point = replace(point, notes=(*point.notes, MISSED))
        if self.reached is not None:
            point, self.reached = replace(point, notes=(*point.notes, self.reached)), None
        force = self.force_at(found.iterate, point)
        if self.accuracy:
            was = self.resolution
            self.change_to(self.accuracy.coarser(was, ratios))
            found, selected = self.still(found, selected, was)
        now = time.perf_counter()
        point, self.clock = replace(point, seconds=now - self.clock), now
        B = self.selection.update(moves, point.state, point.energy)
        sliding = float((point.state != STICK).mean())
        amplitude = point.response[:, 1] - 1j * point.response[:, 2]
        return State(found.iterate, B, self.norm(found.iterate.U), force, not moves.any(), sliding, amplitude), point

    def _check_forces(self, found: Correction, point: Point) -> None:
        """Raise ConvergenceError where a motion has outgrown the forces so far that they have no digits left.  Collective."""
        there = found.iterate
        loads = abs(self.problem.level_at(there.parameter)) * float(np.linalg.norm(self.problem.model.f))
        forces, unbalanced = loads + self.force_at(there, point), float(self.stiffest) * found.gap
        if unbalanced > max(UNBALANCED, 500.0 * found.bound) * forces:
            raise ConvergenceError(
                f"hb: at {self.problem.where(there.parameter)} contact forces of {unbalanced:.1e} N are lost beside a motion of "
                f"{self.norm(there.U):.1e} m, {unbalanced / forces:.1e} of all forces: a body that nothing but its joint holds, "
                "or a joint far too stiff? Hold the body, or lower the stiffness"
            )

    def force_at(self, there: Iterate, point: Point) -> float:
        """Return |f_nl| over all ranks [N] at a point on record.  Collective."""
        p = Harmonics.full(point.p.shape[-1]).carry(point.p[self.problem.model.owned], self.harmonics)
        return self.force_of(there.U, p)

    def ratios(self, point: Point) -> dict[str, float]:
        """Return what is wrong with a point for want of harmonics, samples and tolerance, over what is allowed.  Collective."""
        if self.accuracy is None or point.error is None:
            return {}
        amplitudes = np.hypot(point.response[:, 1::2], point.response[:, 2::2]).max(axis=1)
        return self.comm.bcast(self.accuracy.ratios(amplitudes, point.error))

    def next_step(self, ds: float, newton: int, last: tuple[State, State, State]) -> float:
        """Return the length of the next step: from the turn between the last ones, or from the accuracy of straight lines."""
        before, now, after = last
        turn = self.turn(before.iterate, now.iterate, after.iterate, now.size)
        if self.accuracy is None or not self.accuracy.chooses_steps:
            return self.steps.next(ds, newton, turn)
        steps = self.distance(before, now.iterate), self.distance(now, after.iterate)
        stretch = self.comm.bcast(self.accuracy.stretch([state.amplitude for state in last], steps))
        return self.steps.stretched(ds, newton, turn, stretch)

    # -- the mean slip -----------------------------------------------------------------------------------------

    def hold(self, now: State) -> State | None:
        """Return the point from which to go on with the mean slip held; None where that is of no help.  Collective."""
        if not self.may_hold or self.problem.held_at is not None or now.sliding < MOSTLY or not self.is_loose:
            return None
        self.problem.hold_mean_slip(now.iterate.U, now.selected)
        return now

    def let_go(self, now: State) -> State | None:
        """Return the point with the mean slip no longer held, None where Newton does not find it.  Collective.

        The springs may have let the mean drift far from where the pairs that stick again hold it: it is looked for where it is,
        and where it is without slip.
        """
        held_at, self.problem.held_at = self.problem.held_at, None
        at_rest = now.iterate.U.copy()
        mean = self.harmonics.mean
        at_rest[..., mean] = self.problem.linear_motion(now.iterate.parameter)[0][..., mean]
        for U in (at_rest, now.iterate.U):
            found, selected = self.solve_at(replace(now.iterate, U=U), now.size, now.selected, now.force)
            if found.failure is None and self.distance(now, found.iterate) <= self.steps.ds_max:
                return replace(now, iterate=found.iterate, selected=selected)
        self.problem.held_at = held_at
        return None

    # -- the branch --------------------------------------------------------------------------------------------

    def points(self) -> Iterator[tuple[State, Point]]:
        """Yield the points of the branch in order."""
        found, selected = self.first()
        if found.failure:
            found, selected = self.reach_first(found)
        before, point = self.accept(found, selected, asked=self.sweep.start in self.sweep.at)
        yield before, point
        found, selected = self.second(self.carried(before))
        was = self.resolution
        yield from self.asked(before, found.iterate, selected)
        now, point = self.accept(*self.still(found, selected, was))
        yield now, point
        if self.resolution != was:
            before = self.again(before)
        ds, earlier = self.steps.ds, None
        while True:
            now = self.carried(now)
            try:
                found, selected, ds = self.step(earlier, before, now, ds)
            except ConvergenceError:
                held = self.hold(now)
                if held is None:
                    raise
                now, ds = held, 0.25 * self.steps.ds
                continue
            if self.sweep.before(found.iterate.parameter):
                begin = interpolate(now.iterate, found.iterate, self.sweep.start)
                yield from self.asked(now, begin, selected)
                yield self.solved(self.carried(now), self.fitted(begin), selected, asked=self.sweep.start in self.sweep.at)
                raise ConvergenceError(
                    f"hb: a fold leads the branch back out of the range at its start, "
                    f"{self.problem.where(self.sweep.start)}; begin further off"
                )
            if self.sweep.beyond(found.iterate.parameter):
                end = interpolate(now.iterate, found.iterate, self.sweep.stop)
                yield from self.asked(now, end, selected)
                yield self.solved(self.carried(now), self.fitted(end), selected, asked=self.sweep.stop in self.sweep.at)
                return
            was = self.resolution
            yield from self.asked(now, found.iterate, selected)
            after, point = self.accept(*self.still(found, selected, was))
            yield after, point
            ds = self.next_step(ds, found.newton, (before, now, after))
            if self.problem.held_at is not None and after.sliding < MOSTLY:
                after = self.let_go(after) or after
            if self.resolution == was:
                earlier, before, now = before, now, after
            else:
                earlier, before, now = None, self.again(now), after

    def asked(self, now: State, there: Iterate, selected: np.ndarray) -> Iterator[tuple[State, Point]]:
        """Solve at the asked values that a step has passed."""
        for value in self.sweep.asked_between(now.iterate.parameter, there.parameter):
            between = interpolate(self.fitted(now.iterate), self.fitted(there), value)
            yield self.solved(self.carried(now), between, selected, asked=True)

    def solved(self, now: State, guess: Iterate, selected: np.ndarray, asked: bool) -> tuple[State, Point]:
        """Solve at the parameter of a guess on the chord from the last point, at once or by way of points in between."""
        found, used = self.solve_at(guess, now.size, now.selected | selected, now.force)
        if found.failure:
            found, used = self.approach(now, guess, now.selected | selected)
        return self.accept(found, used, asked=asked)

    def approach(self, now: State, goal: Iterate, selected: np.ndarray) -> tuple[Correction, np.ndarray]:
        """Solve at the parameter of ``goal`` in steps of the parameter from the last point, halved until Newton converges."""
        here, towards = now.iterate, goal
        way = 0.5 * (goal.parameter - here.parameter)
        while True:
            is_last = abs(goal.parameter - here.parameter) <= 1.001 * abs(way)
            there = goal.parameter if is_last else here.parameter + way
            found, used = self.solve_at(interpolate(here, towards, there), now.size, selected, now.force)
            if found.failure is None and is_last:
                return found, used
            if found.failure is None:
                here, towards, selected = found.iterate, interpolate(here, found.iterate, goal.parameter), used
                continue
            way /= 2.0
            if abs(way) < FINEST_WAY * abs(goal.parameter - now.iterate.parameter):
                raise ConvergenceError(self.message(here.parameter, found))

    # -- a first point that Newton does not reach from the linear response -------------------------------------

    def reach_first(self, failed: Correction) -> tuple[Correction, np.ndarray]:
        """Solve the first point another way: the ways in turn, from the most natural one to the longest.  Collective.

        Raises
        ------
        ConvergenceError : none leads there; on every rank
        """
        ways = [self.over_the_level, self.from_rest, self.with_mean_slip_held, self.patiently, self.over_damping]
        if not self.may_hold:
            ways.remove(self.with_mean_slip_held)
        if self.problem.is_a_way:
            ways = [self.from_rest, self.patiently]
        for way in ways:
            found = way()
            if found is not None:
                self.reached = REACHED.get(way.__name__)
                return found
        where, is_static = self.problem.where(self.sweep.start), self.harmonics.highest == 0
        raise ConvergenceError(
            f"hb: no equilibrium under the static load of {self.problem.level_at(self.sweep.start):.4g} N was found "
            f"({failed.failure}): is it more than friction and preload carry?"
            if is_static
            else f"hb: no first point at {where}: neither from the linear response ({failed.failure}) nor from rest, "
            "over the level or over further damping; begin at another frequency, or raise [solver] samples"
        )

    def over_the_level(self) -> tuple[Correction, np.ndarray] | None:
        """Solve the first point from a small level up, by arc length at its frequency, folds included; None in vain."""
        return self.over(LevelFamily(self.problem, self.sweep.start), self.problem.level)

    def over_damping(self) -> tuple[Correction, np.ndarray] | None:
        """Solve the first point from a damping that leaves one solution down to none beside the scene's; None in vain."""
        return self.over(DampingFamily(self.problem, self.sweep.start), 1.0)

    def over(self, family: LevelFamily | DampingFamily, end: float) -> tuple[Correction, np.ndarray] | None:
        """Solve at the end of a family's parameter, where it is the problem, from near its beginning; None in vain."""
        held_at = self.problem.held_at
        for share in BEGINNINGS[type(family)]:
            family.held_at = held_at
            way = BranchFollower(family, self.selection, Sweep(share * end, end), APPROACH, self.tolerance)
            way.may_hold = self.may_hold
            try:
                for (state, _), _ in zip(way.points(), range(MOST_APPROACH_POINTS)):
                    if way.spent > MOST_APPROACH_ITERATIONS:
                        break
                    if state.iterate.parameter == end:
                        there = Iterate(state.iterate.U, self.sweep.start)
                        self.problem.held_at = family.held_at
                        found, selected = self.solve_at(there, state.size, state.selected, state.force)
                        if found.failure is None:
                            return found, selected
                        break
            except ConvergenceError:
                pass
            finally:
                way.destroy()
            self.problem.held_at = held_at
        return None

    def patiently(self) -> tuple[Correction, np.ndarray] | None:
        """Solve the first point by many small Newton steps, from the linear response and from rest; None in vain."""
        with self.corrector.patient():
            found, selected = self.first()
            return (found, selected) if found.failure is None else self.from_rest()

    def from_rest(self) -> tuple[Correction, np.ndarray] | None:
        """Solve the first point from no motion, where gaps are open; None in vain."""
        U_lin, _ = self.problem.linear_motion(self.sweep.start)
        guess, selected = Iterate(np.zeros_like(U_lin), self.sweep.start), self.selection.first(self.problem.model.n_pairs)
        found, selected = self.solve_at(guess, self.norm(U_lin), selected)
        return (found, selected) if found.failure is None else None

    def with_mean_slip_held(self) -> tuple[Correction, np.ndarray] | None:
        """Solve the first point of a body that hangs on its joint alone with the mean slip held about none; None in vain."""
        if self.problem.held_at is not None or not self.is_loose:
            return None
        self.problem.held_at = np.zeros((self.problem.n_owned, 2))
        found, selected = self.first()
        reached = self.over_the_level() or self.over_damping() if found.failure else (found, selected)
        if reached is None:
            self.problem.held_at = None
        return reached


def follow_branch(
    problem: HarmonicBalance,
    selection: Selection,
    sweep: Sweep,
    steps: ArcLength,
    *,
    tolerance: float,
    max_points: int,
    on_point: Callable[[Point], None] = lambda point: None,
    estimator: ErrorEstimator | None = None,
    accuracy: Accuracy | None = None,
    follower: type[BranchFollower] = BranchFollower,
    segment: int = 0,
) -> Branch:
    """Follow the branch of one level over frequency, by the steps of a ``follower``.  Collective on ``problem.comm``.

    A branch that cannot be continued keeps its points and says why in ``failure``; nothing is raised.
    ``max_points`` bounds a branch that never reaches the end of the range.
    """
    branch = Branch(problem.level)
    steps_of = follower(problem, selection, sweep, steps, tolerance, estimator, accuracy)
    try:
        for _, found in steps_of.points():
            point = replace(found, segment=segment)
            on_point(point)
            branch.points.append(point if problem.comm.rank == 0 else replace(point, U=NOTHING, p=NOTHING))
            if len(branch.points) == max_points:
                branch.failure = f"{max_points} points without reaching {problem.where(sweep.stop)}: raise [response] points"
                break
    except ConvergenceError as failure:
        branch.failure = str(failure)
    finally:
        steps_of.destroy()
    branch.scaled = steps_of.scaled
    if accuracy is not None and "solver" not in accuracy.keeps:
        branch.closes_to = max(branch.closes_to, accuracy.target)
    branch.odd = accuracy is not None and not steps_of.scaled and all(n % 2 for n in accuracy.coarsest.harmonics.chosen)
    return branch
