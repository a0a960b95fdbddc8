"""Steps from point to point of a branch by arc length: predictor, length, corners (docs/theory.md, section 7)."""

from __future__ import annotations

from functools import cached_property
from typing import NoReturn

import numpy as np

from ..harmonic.mean_slip import is_held_by_its_joint_alone
from ..harmonic.residual import HarmonicBalance
from ..parallel.errors import ConvergenceError
from ..reduction.selection import Selection
from .corrector import ConstraintRow, Correction, Iterate
from .point_solver import PointSolver, State
from .steps import ArcLength
from .sweep import Sweep

FAR_AHEAD = 4.0  # lengths of the last step beyond which a parabola says nothing
FARTHEST = 4.0  # lengths of a step asked for that it may have: on the plane normal to it, a turn of 75 degrees
NEAREST = 1e-3  # lengths of it below which it leads nowhere
CORNERS = 4.0 ** np.arange(1, 5)  # shortest steps in which the branch is looked for beyond a sharp corner
BACK = 0.05  # rad between a step and the way back, below which it is that


class Stepper(PointSolver):
    """Finds the next point of a branch from the last ones, which go in as :class:`State`."""

    def __init__(self, problem: HarmonicBalance, selection: Selection, sweep: Sweep, steps: ArcLength, tolerance: float):
        super().__init__(problem, selection, sweep, tolerance)
        self.steps = steps
        self.may_hold = True  # the mean slip, by springs

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
        if now.sticks:
            direction = float(np.sign(now.iterate.parameter - before.iterate.parameter))
            parameter = now.iterate.parameter + direction * self.linear_step(now, ds)
            guess = Iterate(self.problem.linear_motion(parameter)[0], parameter)
            return guess, ConstraintRow.fixed_parameter(guess)
        d_U, d_parameter, length = self.difference(before, now, now.size)
        U = now.iterate.U + ds / length * d_U
        parameter = now.iterate.parameter + ds / length * d_parameter
        if earlier is not None and not before.sticks and ds < FAR_AHEAD * length:
            e_U, e_parameter, e_length = self.difference(earlier, before, now.size)
            share = ds * (ds + length) / (length + e_length)  # Newton's divided differences in the arc length
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

    @cached_property
    def is_loose(self) -> bool:
        return is_held_by_its_joint_alone(self.problem)

    def left(self, before: State, now: State, found: Correction, ds: float) -> bool:
        """Tell whether a step fell back on the branch or jumped off it: by a turn of more than 90 degrees or another length."""
        turn, distance = self.turn(before.iterate, now.iterate, found.iterate, now.size), self.distance(now, found.iterate)
        return turn > 0.5 * np.pi or not NEAREST * ds <= distance <= FARTHEST * ds

    def message(self, parameter: float, found: Correction) -> str:
        return (
            f"hb: no convergence beyond {self.problem.where(parameter)} after {found.newton} iterations: "
            f"{found.failure or 'the branch turns back'}; the step was halved down to [continuation] "
            f"ds_min = {self.steps.ds_min:.1e}: reduce ds_min or ds, or the level"
        )

    # -- corners -----------------------------------------------------------------------------------------------

    def corner(self, before: State, now: State, failed: Correction) -> tuple[Correction, np.ndarray]:
        """Return a point just beyond a corner of the branch, at a fixed parameter.

        Where a sample of a pair begins or ends to slip the branch has a corner, and on the plane normal to its old direction
        Newton may go back and forth between the two sides.  A fixed parameter favours none.
        """
        return self.just_ahead(before, now) or self.sharp_corner(before, now) or self.give_up(now, failed)

    def just_ahead(self, before: State, now: State) -> tuple[Correction, np.ndarray] | None:
        """Return a point at a fixed parameter within the shortest step; None if Newton finds none.  Collective."""
        direction = np.sign(now.iterate.parameter - before.iterate.parameter) or self.sweep.direction
        for share in 2.0 ** -np.arange(6):
            there = now.iterate.parameter + direction * share * self.steps.ds_min * self.sweep.scale
            found, selected = self.solve_at(Iterate(now.iterate.U, there), now.size, now.selected, now.force)
            if found.failure is None and self.distance(now, found.iterate) <= self.steps.ds_max:
                return found, selected
        return None

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
                if found.failure or not NEAREST * ds <= self.distance(now, found.iterate) <= FARTHEST * ds:
                    continue
                if self.turn(self.moved(now, -ds, *come_from), now.iterate, found.iterate, now.size) < np.pi - BACK:
                    return found, selected
        return None

    def tangent_step(self, now: State, there: Iterate, n_U: np.ndarray, n_nu: float) -> tuple[np.ndarray, float]:
        """Return the unit tangent of the linearisation at ``there``, on the side of the normal (n_U, n_nu).  Collective."""
        row = ConstraintRow(there, n_U, n_nu)
        t_xi, t_nu = self.corrector.tangent(there, row, self.scaling(now.size, now.force), now.selected)
        size = self.length(t_xi, t_nu)
        if not np.isfinite(size) or size == 0.0:  # the linearisation is singular there: nowhere to go
            return np.zeros_like(t_xi), 0.0
        return t_xi / size, t_nu / size

    def moved(self, now: State, ds: float, t_xi: np.ndarray, t_nu: float) -> Iterate:
        """Return the place a step ``ds`` along a tangent.  Local."""
        return Iterate(now.iterate.U + ds * now.size * t_xi, now.iterate.parameter + ds * self.sweep.scale * t_nu)
