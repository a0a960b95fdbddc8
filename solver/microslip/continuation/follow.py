"""Follow the branch of one level through a frequency range by arc length (docs/theory.md, section 7)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NoReturn

import numpy as np

from ..contact.law import STICK
from ..error_bars.estimate import ErrorEstimator
from ..fourier.harmonics import Harmonics
from ..harmonic.mean_slip import is_held_by_its_joint_alone
from ..harmonic.residual import HarmonicBalance, LevelFamily
from ..parallel.errors import ConvergenceError
from ..reduction.selection import Selection
from .accuracy import Accuracy, Resolution
from .branch import Branch, Point
from .corrector import ConstraintRow, Correction, Corrector, Iterate, Scaling, row_weights
from .record import point_record
from .steps import ArcLength

# the way to a first point that Newton does not reach at once: steps over the level
APPROACH = ArcLength(ds=0.2, ds_min=2e-4, ds_max=1.0)
MOST_APPROACH_STEPS = 400
FINEST_WAY = 1e-2       # of the way from a point to an asked value: the smallest step in between
FAR_AHEAD = 4.0         # lengths of the last step beyond which a parabola says nothing
FARTHEST = 4.0          # lengths of a step asked for that it may have: on the plane normal to it, a turn of 75 degrees
CORNERS = 4.0 ** np.arange(1, 5)        # shortest steps in which the branch is looked for beyond a sharp corner
BACK = 0.05             # rad between a step and the way back, below which it is that
MISSED = "accuracy not met: more harmonics or samples than the program uses, or no convergence with them"
MOSTLY = 0.8            # share of the pairs that slip or are open, from which the mean of the slip may be held
SHRINKS = 0.5           # of the unit of U: a motion below it is solved again in its own unit
NOTHING = np.empty((0, 3, 0))       # the motion of a recorded point on ranks other than 0


@dataclass(frozen=True)
class Sweep:
    """A range of the parameter, frequency [rad/s] or level [N], and the direction in which it is followed."""

    start: float
    stop: float                         # below ``start`` for a sweep down
    at: tuple[float, ...] = ()          # values that must be points

    @property
    def direction(self) -> float:
        return 1.0 if self.stop > self.start else -1.0

    @property
    def scale(self) -> float:
        return abs(self.stop - self.start)

    def beyond(self, parameter: float) -> bool:
        return self.direction * (parameter - self.stop) >= 0.0

    def before(self, parameter: float) -> bool:
        return self.direction * (parameter - self.start) < 0.0

    def asked_between(self, a: float, b: float) -> list[float]:
        """Return the asked values strictly between two points, in the order of travel from a to b."""
        low, high = min(a, b), max(a, b)
        return sorted((value for value in self.at if low < value < high), reverse=bool(b < a))


@dataclass(frozen=True)
class State:
    """A converged point as the next step needs it."""

    iterate: Iterate
    selected: np.ndarray            # B of the next point
    size: float                     # |U| over all ranks [m]
    force: float                    # |f_nl| over all ranks [N]
    sticks: bool                    # no pair slips or opens: the point lies on the linear curve
    sliding: float                  # share of the pairs that do not stick
    amplitude: np.ndarray           # (n_outputs,) complex, of harmonic 1 [m]


def interpolate(a: Iterate, b: Iterate, parameter: float) -> Iterate:
    """Return the point of the chord from ``a`` to ``b`` at a value of the parameter.  Local."""
    share = (parameter - a.parameter) / (b.parameter - a.parameter)
    return Iterate(a.U + share * (b.U - a.U), parameter)


class BranchFollower:
    """The stepping loop of one branch; what it knows of a point goes in and out as :class:`State`."""

    scaled = False          # whether all points so far are the linear response, found without solving

    def __init__(self, problem: HarmonicBalance, selection: Selection, sweep: Sweep, steps: ArcLength, tolerance: float,
                 estimator: ErrorEstimator | None = None, accuracy: Accuracy | None = None):
        self.problem, self.selection, self.sweep, self.steps = problem, selection, sweep, steps
        self.comm, self.tolerance = problem.comm, tolerance
        self.estimator, self.accuracy = estimator, accuracy
        if accuracy is not None:
            self.problem = problem.resolved(accuracy.coarsest.harmonics, accuracy.coarsest.n_samples)
        self.corrector = Corrector(self.problem, tolerance)
        self.clock = time.perf_counter()

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        self.corrector.destroy()
        if self.estimator is not None:
            self.estimator.destroy()

    # -- one point ---------------------------------------------------------------------------------------------

    def solve(self, guess: Iterate, row: ConstraintRow, size: float, selected: np.ndarray,
              force: float | None = None) -> tuple[Correction, np.ndarray]:
        """Correct a guess; with the in-point check, again with the pairs that want to slip, until none is left out.

        ``size`` [m] and ``force`` [N] are what residuals are measured by, of a point near by.  Where the answer is much
        smaller, or ``force`` is not known, it is solved again by its own.
        """
        size = size or 1.0
        scaling = Scaling(size, self.sweep.scale) if force is None else self.scaling(size, force)
        newton = krylov = 0
        while True:
            found = self.corrector.correct(guess, row, scaling, selected)
            newton, krylov = newton + found.newton, krylov + found.krylov
            found = replace(found, newton=newton, krylov=krylov)
            if found.failure:
                return found, selected
            own = self.norm(found.iterate.U)
            if force is None or 0.0 < own < SHRINKS * size:
                row = replace(row, n_U=row.n_U * ((own or size) / size))        # the same plane in the new unit
                size, force = own or size, self.force(found.iterate.U, selected)
                scaling, guess = self.scaling(size, force), found.iterate
                continue
            if not self.selection.checks_in_point:
                return found, selected
            forces = self.problem.contact_forces(found.iterate.U, np.ones_like(selected), tangents=False)
            left_out = forces.active[~selected[forces.active]]
            if len(left_out) == 0:
                return found, selected
            selected = selected.copy()
            selected[left_out] = True
            guess = found.iterate

    def solve_at(self, guess: Iterate, size: float, selected: np.ndarray,
                 force: float | None = None) -> tuple[Correction, np.ndarray]:
        """Correct a guess at its own parameter; the answer carries exactly that value, not its last bit's rounding.

        Raises
        ------
        ConvergenceError : the stuck structure resonates there without damping; on every rank
        """
        if not np.isfinite(self.norm(self.problem.linear_motion(guess.parameter)[0])):
            raise ConvergenceError(f"hb: the stuck structure resonates without damping at {self.problem.where(guess.parameter)}: "
                                   "its linear response is infinite there; state [damping], or another frequency")
        found, selected = self.solve(guess, ConstraintRow.fixed_parameter(guess), size, selected, force)
        return replace(found, iterate=Iterate(found.iterate.U, guess.parameter)), selected

    def accept(self, found: Correction, selected: np.ndarray, asked: bool = False) -> tuple[State, Point]:
        """Evaluate all pairs at a converged point, record it and choose B of the next one.  Collective."""
        while True:
            point, moves = point_record(self.problem, found, selected, self.selection, asked, self.estimator)
            ratios = self.ratios(point)
            finer = self.accuracy and self.accuracy.finer(self.resolution, ratios)
            if not finer:
                break
            better, used = self.solve_with(finer, found, selected)
            if better.failure:
                break
            found, selected = better, used
        if max(ratios.values(), default=0.0) > 1.0:
            point = replace(point, notes=(*point.notes, MISSED))
        if self.accuracy:
            was = self.resolution
            self.change_to(self.accuracy.coarser(was, ratios))
            found, selected = self.still(found, selected, was)
        now = time.perf_counter()
        point, self.clock = replace(point, seconds=now - self.clock), now
        B = self.selection.update(moves, point.state, point.energy)
        sliding = float((point.state != STICK).mean())
        amplitude = point.response[:, 1] - 1j * point.response[:, 2]
        p = Harmonics.full(point.p.shape[-1]).carry(point.p[self.problem.model.owned], self.harmonics)
        size, force = self.norm(found.iterate.U), self.force_of(found.iterate.U, p)
        return State(found.iterate, B, size, force, not moves.any(), sliding, amplitude), point

    # -- harmonics and samples ---------------------------------------------------------------------------------

    @property
    def harmonics(self) -> Harmonics:
        return self.problem.model.harmonics

    @property
    def resolution(self) -> Resolution:
        return Resolution(self.harmonics, self.problem.n_samples)

    def ratios(self, point: Point) -> dict[str, float]:
        """Return what is wrong with a point for want of harmonics and samples, over what is allowed.  Collective."""
        if self.accuracy is None or point.error is None:
            return {}
        amplitudes = np.hypot(point.response[:, 1::2], point.response[:, 2::2]).max(axis=1)
        return self.comm.bcast(self.accuracy.ratios(amplitudes, point.error))

    def change_to(self, resolution: Resolution) -> None:
        """Go on with other harmonics and samples.  Collective; motions at hand are carried over by :meth:`fitted`."""
        if resolution != self.resolution:
            self.problem = self.problem.resolved(resolution.harmonics, resolution.n_samples)
            self.corrector.destroy()
            self.corrector = Corrector(self.problem, self.tolerance)

    def fitted(self, iterate: Iterate) -> Iterate:
        """Return a motion in the harmonics of the problem, from whatever set it was solved in.  Local."""
        N_H = iterate.U.shape[-1]
        if N_H == self.harmonics.n_coefficients:
            return iterate
        solved_in = Harmonics.full(N_H) if N_H % 2 else Harmonics.odd_up_to(N_H - 1)
        return replace(iterate, U=solved_in.carry(iterate.U, self.harmonics))

    def carried(self, state: State) -> State:
        """Return a point in the harmonics of the problem.  Local."""
        return replace(state, iterate=self.fitted(state.iterate))

    def still(self, found: Correction, selected: np.ndarray, was: Resolution) -> tuple[Correction, np.ndarray]:
        """Return a solution found with the resolution ``was`` as one of the problem as it is now.  Collective."""
        if was == self.resolution:
            return found, selected
        guess = self.fitted(found.iterate)
        again, used = self.solve_at(guess, self.norm(guess.U), selected)
        if again.failure is None:
            return again, used
        self.change_to(was)
        return found, selected

    def again(self, state: State) -> State:
        """Return a point as the problem has it now, so that the way to the next one is that of the branch.  Collective."""
        state = self.carried(state)
        found, _ = self.solve_at(state.iterate, state.size, state.selected, state.force)
        return state if found.failure else replace(state, iterate=found.iterate)

    def solve_with(self, finer: Resolution, found: Correction, selected: np.ndarray) -> tuple[Correction, np.ndarray]:
        """Solve a point again with more harmonics or samples; go back to the old ones where Newton fails.  Collective."""
        coarse = self.resolution
        self.change_to(finer)
        guess = self.fitted(found.iterate)
        better, used = self.solve_at(guess, self.norm(guess.U), selected)
        better = replace(better, newton=found.newton + better.newton, krylov=found.krylov + better.krylov)
        if better.failure:
            self.change_to(coarse)
        return better, used

    def scaling(self, size: float, force: float) -> Scaling:
        """Return the units of a point near one of this size [m] and force [N].  Local."""
        rows = row_weights(self.stiffness[:, :, None], size, force, self.tolerance)
        return Scaling(size, self.sweep.scale, rows, float(row_weights(self.stiffest, size, force, self.tolerance)))

    @cached_property
    def stiffness(self) -> np.ndarray:
        """The springs of this rank's pairs, (n_owned, 3) [N/m]."""
        parameters = self.problem.parameters
        return np.stack([parameters.k_t, parameters.k_t, parameters.k_n], axis=1)

    @cached_property
    def stiffest(self) -> np.ndarray:
        """The stiffest spring of all pairs [N/m].  Collective at first."""
        return np.array(max(self.comm.allgather(float(self.stiffness.max(initial=0.0)))))

    def force(self, U: np.ndarray, selected: np.ndarray) -> float:
        """Return |f_nl| over all ranks [N] under a motion of this rank's pairs.  Collective."""
        p = self.problem.full_force(self.problem.contact_forces(U, selected, tangents=False))
        return self.force_of(U, p.reshape(-1, *U.shape[1:])[self.problem.model.owned])

    def force_of(self, U: np.ndarray, p: np.ndarray) -> float:
        """Return |p + K_J U| over all ranks [N].  Collective."""
        return self.norm(p + self.stiffness[:, :, None] * U)

    def norm(self, U: np.ndarray) -> float:
        return float(np.sqrt(self.comm.allreduce(float(np.vdot(U, U)))))

    def length(self, d_xi: np.ndarray, d_nu: float) -> float:
        """Return the length of a step.

        The mean does not count: it drifts with the slip in which sliders settle, and turns sharply where that ends, while the
        branch goes straight on.
        """
        return float(np.hypot(self.norm(self.vibration(d_xi)), d_nu))

    def vibration(self, U: np.ndarray) -> np.ndarray:
        """Return the harmonics above the mean."""
        return U[..., self.harmonics.vibration]

    # -- the first two points ----------------------------------------------------------------------------------

    def first(self) -> tuple[Correction, np.ndarray]:
        """Solve the first point from the linear response."""
        U_lin, _ = self.problem.linear_motion(self.sweep.start)
        selected = self.selection.first(self.problem.model.n_pairs)
        return self.solve_at(Iterate(U_lin, self.sweep.start), self.norm(U_lin), selected)

    def second(self, first: State) -> tuple[Correction, np.ndarray]:
        """Solve the second point, a little further along the sweep; halve the way until it converges nearby.

        A point further off than ``ds_max`` may lie beyond folds, with the resonance between them.  It is taken only where none
        is nearer: where the set B has changed since the first point, and the solution with it.
        """
        way = min(self.linear_step(first, 0.5 * self.steps.ds), 0.5 * self.sweep.scale)
        far = None
        while True:
            there = first.iterate.parameter + self.sweep.direction * way
            U = self.problem.linear_motion(there)[0] if first.sticks else first.iterate.U
            found, selected = self.solve_at(Iterate(U, there), first.size, first.selected, first.force)
            if found.failure is None:
                if self.distance(first, found.iterate) <= self.steps.ds_max:
                    return found, selected
                far = far or (found, selected)
            way /= 2.0
            if way < self.steps.ds_min * self.sweep.scale:
                if far:
                    return far
                raise ConvergenceError(self.message(first.iterate.parameter, found))

    def distance(self, now: State, there: Iterate) -> float:
        """Return the length of a step in its own norm."""
        d_xi = (self.fitted(there).U - self.fitted(now.iterate).U) / (now.size or 1.0)
        return self.length(d_xi, (there.parameter - now.iterate.parameter) / self.sweep.scale)

    def linear_step(self, now: State, ds: float) -> float:
        """Return the change of the parameter that makes a step ``ds`` along the linear curve."""
        _, dU = self.problem.linear_motion(now.iterate.parameter)
        slope = self.norm(self.vibration(dU)) / now.size if now.size > 0.0 else 0.0
        return ds / float(np.hypot(slope, 1.0 / self.sweep.scale))

    # -- a step ------------------------------------------------------------------------------------------------

    def predict(self, earlier: State | None, before: State, now: State, ds: float) -> tuple[Iterate, ConstraintRow]:
        """Return the guess a step ``ds`` ahead and the row that holds the step.

        On the linear curve (all pairs stuck) the guess is the linear response itself, at a fixed parameter; otherwise
        the parabola through the last three points (the secant where there are two), and the plane normal to the secant.
        """
        d_U, d_parameter, length = self.difference(before, now, now.size)
        if now.sticks:
            parameter = now.iterate.parameter + float(np.sign(d_parameter)) * self.linear_step(now, ds)
            guess = Iterate(self.problem.linear_motion(parameter)[0], parameter)
            return guess, ConstraintRow.fixed_parameter(guess)
        U = now.iterate.U + ds / length * d_U
        parameter = now.iterate.parameter + ds / length * d_parameter
        if earlier is not None and not before.sticks and ds < FAR_AHEAD * length:
            e_U, e_parameter, e_length = self.difference(earlier, before, now.size)
            share = ds * (ds + length) / (length + e_length)            # Newton's divided differences in the arc length
            U += share * (d_U / length - e_U / e_length)
            parameter += share * (d_parameter / length - e_parameter / e_length)
        guess = Iterate(U, parameter)
        normal = d_U / (now.size * length)
        normal[..., self.harmonics.mean] = 0.0
        return guess, ConstraintRow(guess, normal, d_parameter / (self.sweep.scale * length))

    def difference(self, a: State, b: State, size: float) -> tuple[np.ndarray, float, float]:
        """Return the step from a to b: its motion, its parameter and its length in the norm about ``size``."""
        d_U, d_parameter = b.iterate.U - a.iterate.U, b.iterate.parameter - a.iterate.parameter
        return d_U, d_parameter, self.length(d_U / size, d_parameter / self.sweep.scale)

    def turn(self, before: Iterate, now: Iterate, after: Iterate, size: float) -> float:
        """Return the angle [rad] between the last two steps, in the norm of the step."""
        size, before, now, after = max(size, 1e-300), self.fitted(before), self.fitted(now), self.fitted(after)
        a_xi, b_xi = (now.U - before.U) / size, (after.U - now.U) / size
        a_nu = (now.parameter - before.parameter) / self.sweep.scale
        b_nu = (after.parameter - now.parameter) / self.sweep.scale
        dot = self.comm.allreduce(float(np.vdot(self.vibration(a_xi), self.vibration(b_xi)))) + a_nu * b_nu
        cosine = dot / max(self.length(a_xi, a_nu) * self.length(b_xi, b_nu), 1e-300)
        return float(np.arccos(min(max(cosine, -1.0), 1.0)))

    def step(self, earlier: State | None, before: State, now: State, ds: float) -> tuple[Correction, np.ndarray, float]:
        """Return the next converged point and the step that reached it, halved until Newton converges."""
        earlier, before, now = earlier and self.carried(earlier), self.carried(before), self.carried(now)
        while True:
            guess, row = self.predict(earlier, before, now, ds)
            found, selected = self.solve(guess, row, now.size, now.selected, now.force)
            if found.failure is None and not self.left(before, now, found, ds):
                return found, selected, ds
            ds /= 2.0
            if ds < self.steps.ds_min:
                return *self.corner(before, now, found), 8.0 * self.steps.ds_min
            if now.sliding == 1.0 and self.problem.held_at is None and self.is_loose:
                raise ConvergenceError(self.message(now.iterate.parameter, found))

    def next_step(self, ds: float, newton: int, last: tuple[State, State, State]) -> float:
        """Return the length of the next step: from the turn between the last ones, or from the accuracy of straight lines."""
        before, now, after = last
        turn = self.turn(before.iterate, now.iterate, after.iterate, now.size)
        if self.accuracy is None or not self.accuracy.chooses_steps:
            return self.steps.next(ds, newton, turn)
        steps = self.distance(before, now.iterate), self.distance(now, after.iterate)
        stretch = self.comm.bcast(self.accuracy.stretch([state.amplitude for state in last], steps))
        return self.steps.stretched(ds, newton, turn, stretch)

    @cached_property
    def is_loose(self) -> bool:
        return is_held_by_its_joint_alone(self.problem)

    def hold(self, now: State) -> State | None:
        """Return the point from which to go on with the mean slip held; None where that is of no help.  Collective."""
        if self.problem.held_at is not None or now.sliding < MOSTLY or not self.is_loose:
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

    def corner(self, before: State, now: State, failed: Correction) -> tuple[Correction, np.ndarray]:
        """Return a point just beyond a corner of the branch, at a fixed parameter.

        Where a sample of a pair begins or ends to slip the branch has a corner, and on the plane normal to its old direction
        Newton may go back and forth between the two sides.  A fixed parameter favours none.
        """
        direction = np.sign(now.iterate.parameter - before.iterate.parameter) or self.sweep.direction
        for share in 2.0 ** -np.arange(6):
            there = now.iterate.parameter + direction * share * self.steps.ds_min * self.sweep.scale
            found, selected = self.solve_at(Iterate(now.iterate.U, there), now.size, now.selected, now.force)
            if found.failure is None and self.distance(now, found.iterate) <= self.steps.ds_max:
                return found, selected
        return self.sharp_corner(before, now) or self.give_up(now, failed)

    def give_up(self, now: State, failed: Correction) -> NoReturn:
        raise ConvergenceError(self.message(now.iterate.parameter, failed))

    def sharp_corner(self, before: State, now: State) -> tuple[Correction, np.ndarray] | None:
        """Return a point beyond a corner at which the branch turns by more than 90 degrees; None if there is none.  Collective.

        Beyond the corner another set of samples slips: the direction in which the linearisation there goes on is that of the
        branch, one way or the other.  What lies back on the way that led here is not wanted.
        """
        d_U, d_parameter, length = self.difference(before, now, now.size)
        come_from = self.tangent_step(now, now.iterate, d_U / (now.size * length), d_parameter / (self.sweep.scale * length))
        for ds in self.steps.ds_min * CORNERS:
            ahead = Iterate(now.iterate.U + ds / length * d_U, now.iterate.parameter + ds / length * d_parameter)
            t_xi, t_nu = self.tangent_step(now, ahead, d_U / (now.size * length), d_parameter / (self.sweep.scale * length))
            for way in (-ds, ds):
                guess = self.moved(now, way, t_xi, t_nu)
                row = ConstraintRow(guess, np.sign(way) * t_xi, np.sign(way) * t_nu)
                found, selected = self.solve(guess, row, now.size, now.selected, now.force)
                if found.failure or self.distance(now, found.iterate) > FARTHEST * ds:
                    continue
                if self.turn(self.moved(now, -ds, *come_from), now.iterate, found.iterate, now.size) < np.pi - BACK:
                    return found, selected
        return None

    def tangent_step(self, now: State, there: Iterate, n_U: np.ndarray, n_nu: float) -> tuple[np.ndarray, float]:
        """Return the unit tangent of the linearisation at ``there``, on the side of the normal (n_U, n_nu).  Collective."""
        row = ConstraintRow(there, n_U, n_nu)
        t_xi, t_nu = self.corrector.tangent(there, row, self.scaling(now.size, now.force), now.selected)
        size = self.length(t_xi, t_nu) or 1.0
        return t_xi / size, t_nu / size

    def moved(self, now: State, ds: float, t_xi: np.ndarray, t_nu: float) -> Iterate:
        """Return the place a step ``ds`` along a tangent.  Local."""
        return Iterate(now.iterate.U + ds * now.size * t_xi, now.iterate.parameter + ds * self.sweep.scale * t_nu)

    def left(self, before: State, now: State, found: Correction, ds: float) -> bool:
        """Tell whether a step fell back on the branch or jumped off it: it turned by more than 90 degrees, or is far too long."""
        turn = self.turn(before.iterate, now.iterate, found.iterate, now.size)
        return turn > 0.5 * np.pi or self.distance(now, found.iterate) > FARTHEST * ds

    def message(self, parameter: float, found: Correction) -> str:
        return (
            f"hb: no convergence beyond {self.problem.where(parameter)} after {found.newton} iterations: "
            f"{found.failure or 'the branch turns back'}; the step was halved down to [continuation] "
            f"ds_min = {self.steps.ds_min:.1e}: reduce ds_min or ds, or the level"
        )

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
                raise ConvergenceError(f"hb: a fold leads the branch back out of the range at its start, "
                                       f"{self.problem.where(self.sweep.start)}; begin further off, or sweep the other way")
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

    def reach_first(self, failed: Correction) -> tuple[Correction, np.ndarray]:
        """Solve the first point over the level; with the mean slip held about none where a body hangs on its joint alone."""
        try:
            return self.reach_level(failed)
        except ConvergenceError:
            if isinstance(self.problem, LevelFamily) or self.problem.held_at is not None or not self.is_loose:
                raise
        self.problem.held_at = np.zeros((self.problem.n_owned, 2))
        found, selected = self.first()
        return self.reach_level(found) if found.failure else (found, selected)

    def reach_level(self, failed: Correction) -> tuple[Correction, np.ndarray]:
        """Solve the first point another way: from a small level up, by arc length at its frequency, folds included."""
        if isinstance(self.problem, LevelFamily):
            raise ConvergenceError(self.message(self.sweep.start, failed))
        level = self.problem.level
        family = LevelFamily(self.problem, self.sweep.start)
        for share in (1e-2, 1e-4):
            way = BranchFollower(family, self.selection, Sweep(share * level, level), APPROACH, self.tolerance)
            try:
                for (state, _), _ in zip(way.points(), range(MOST_APPROACH_STEPS)):
                    if state.iterate.parameter == level:
                        there = Iterate(state.iterate.U, self.sweep.start)
                        self.problem.held_at = family.held_at
                        return self.solve_at(there, state.size, state.selected, state.force)
            except ConvergenceError:
                continue
            finally:
                way.destroy()
        raise ConvergenceError(self.message(self.sweep.start, failed))


def follow_branch(problem: HarmonicBalance, selection: Selection, sweep: Sweep, steps: ArcLength, *, tolerance: float,
                  max_points: int, on_point: Callable[[Point], None] = lambda point: None,
                  estimator: ErrorEstimator | None = None, accuracy: Accuracy | None = None,
                  follower: type[BranchFollower] = BranchFollower) -> Branch:
    """Follow the branch of one level over frequency, by the steps of a ``follower``.  Collective on ``problem.comm``.

    A branch that cannot be continued keeps its points and says why in ``failure``; nothing is raised.
    ``max_points`` bounds a branch that never reaches the end of the range.
    """
    branch = Branch(problem.level)
    steps_of = follower(problem, selection, sweep, steps, tolerance, estimator, accuracy)
    try:
        for _, point in steps_of.points():
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
    branch.odd = accuracy is not None and not steps_of.scaled and all(n % 2 for n in accuracy.coarsest.harmonics.chosen)
    return branch
