"""Solve at given frequencies, so that methods can be compared point by point."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..error_estimate.estimate import ErrorEstimator
from ..harmonic.residual import HarmonicBalance
from ..parallel.errors import ConvergenceError
from ..reduction.selection import Selection
from .accuracy import Accuracy
from .branch import Branch, Point
from .corrector import Iterate
from .follow import NOTHING, BranchFollower
from .point_solver import State, interpolate
from .steps import ArcLength
from .sweep import Sweep

FURTHEST = 2.0  # times the last way between two points over which their secant is trusted
STEPS = ArcLength(ds=0.1, ds_min=1e-5, ds_max=0.2)  # along the branch, to a frequency that Newton does not reach at once
MOST_STEPS = 1000


def going_on(points, direction: float) -> list[float]:
    """Return the frequencies of a branch, each further in the direction of the sweep than all before.

    Local.  None comes twice behind a fold.
    """
    omegas: list[float] = []
    for point in points:
        if not omegas or direction * (point.omega - omegas[-1]) > 1e-9 * point.omega:
            omegas.append(point.omega)
    return omegas


def secant(before: Iterate | None, now: Iterate, omega: float) -> Iterate:
    """Return a guess at ``omega`` [rad/s]: on the secant through two points where it reaches that far, else the last point.

    Local.  Where ``omega`` lies back of the last point, that point is the guess: the branch may have folded.
    """
    if before is None or not 0.0 < (omega - now.parameter) / (now.parameter - before.parameter) <= FURTHEST:
        return Iterate(now.U, omega)
    return interpolate(before, now, omega)


def at_frequencies(
    problem: HarmonicBalance,
    selection: Selection,
    omegas: Sequence[float],
    *,
    tolerance: float,
    on_point: Callable[[Point], None] = lambda point: None,
    estimator: ErrorEstimator | None = None,
    accuracy: Accuracy | None = None,
) -> Branch:
    """Solve one level at ``omegas`` (n,) [rad/s], each another than the one before, from the points solved before it.

    Collective on ``problem.comm``.  Nothing is raised for divergence: the branch keeps its points and says why in
    ``failure``.  Where several solutions exist at a frequency, one near the last point is found.

    Notes
    -----
    Every method starts from its own last two points by the same predictor, the secant.  To a frequency that Newton does
    not reach so, beyond a fold for one, the branch is followed in its arc length; points on the way are not recorded, but
    their iterations and time count.
    """
    branch, width = Branch(problem.level), float(np.ptp(omegas)) or 1e-3 * omegas[0]
    follower = BranchFollower(problem, selection, Sweep(omegas[0], omegas[0] + width), STEPS, tolerance, estimator, accuracy)
    follower.may_hold = False  # springs would stay for good, and compare another problem
    try:
        for point in _points(follower, omegas):
            on_point(point)
            branch.points.append(point if problem.comm.rank == 0 else replace(point, U=NOTHING, p=NOTHING))
    except ConvergenceError as failure:
        branch.failure = str(failure)
    finally:
        follower.destroy()
    return branch


def _points(follower: BranchFollower, omegas: Sequence[float]) -> Iterator[Point]:
    """Yield the point at each frequency."""
    found, selected = follower.first()
    if found.failure:
        found, selected = follower.reach_first(found)
    now, point = follower.accept(found, selected, asked=True)
    yield point
    before = None
    for omega in omegas[1:]:
        before, now = before and follower.carried(before), follower.carried(now)
        after, point = _reach(follower, before, now, omega)
        yield point
        before, now = now, after


def _reach(follower: BranchFollower, before: State | None, now: State, omega: float) -> tuple[State, Point]:
    """Return the point at ``omega``: from the secant, from the last point, or along the branch."""
    guess, spent = secant(None if before is None else before.iterate, now.iterate, omega), Spent()
    for start in [guess] if guess.U is now.iterate.U else [guess, Iterate(now.iterate.U, omega)]:
        found, selected = follower.solve_at(start, now.size, now.selected, now.force)
        if found.failure is None:
            after, point = follower.accept(found, selected, asked=True)
            return after, spent.added_to(point)
        spent.add(found.newton, found.krylov)
    after, point = _follow_to(follower, before, now, omega)
    return after, spent.added_to(point)


def _follow_to(follower: BranchFollower, before: State | None, now: State, omega: float) -> tuple[State, Point]:
    """Return the point at which the branch, followed from ``now`` towards ``omega``, first has that frequency."""
    way, ds, earlier, spent = omega - now.iterate.parameter, follower.steps.ds, None, Spent()
    follower.sweep = Sweep(now.iterate.parameter, now.iterate.parameter + float(np.copysign(follower.sweep.scale, way)))
    if before is None or (now.iterate.parameter - before.iterate.parameter) * way <= 0.0:
        before = None
        found, selected = follower.second(follower.carried(now))
    else:
        found, selected, ds = follower.step(earlier, before, now, ds)
    start = now.iterate.parameter
    for _ in range(MOST_STEPS):
        if (start - found.iterate.parameter) * follower.sweep.direction > follower.sweep.scale:
            break
        if (found.iterate.parameter - omega) * (now.iterate.parameter - omega) <= 0.0:
            spent.add(found.newton, found.krylov)
            there = interpolate(follower.fitted(now.iterate), found.iterate, omega)
            last, point = follower.solved(now, there, selected, asked=True)
            return last, spent.added_to(point)
        after, point = follower.accept(found, selected, on_the_way=True)
        spent.add(point.newton, point.krylov, point.seconds)
        if before is not None:
            ds = follower.steps.next(ds, found.newton, follower.turn(before.iterate, now.iterate, after.iterate, now.size))
        earlier, before, now = before, now, after
        found, selected, ds = follower.step(earlier, before, now, ds)
    raise ConvergenceError(
        f"hb: {follower.problem.where(omega)} not reached along the branch from "
        f"{follower.problem.where(start)}; ask for frequencies closer to each other"
    )


@dataclass
class Spent:
    """Effort on the way to a point, beside that of its own solve."""

    newton: int = 0
    krylov: int = 0
    seconds: float = 0.0

    def add(self, newton: int, krylov: int, seconds: float = 0.0) -> None:
        self.newton, self.krylov, self.seconds = self.newton + newton, self.krylov + krylov, self.seconds + seconds

    def added_to(self, point: Point) -> Point:
        """Return the record of the point with this effort added."""
        return replace(
            point, newton=point.newton + self.newton, krylov=point.krylov + self.krylov, seconds=point.seconds + self.seconds
        )
