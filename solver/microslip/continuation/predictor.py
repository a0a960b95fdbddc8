"""The predictor: the guess of the next point, and the plane of the step (docs/theory.md, section 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..receptance.motions import static_motion
from .constraint_rows import Plane
from .iterate import Iterate, PointState
from .point_solver import PointSolver

FAR_AHEAD = 4.0  # lengths of the last step beyond which a parabola is not used
BY_PARAMETER = 1e-2  # shortest step of a maximum at a fixed parameter; shorter ones, in a plane, pass folds
FAINT_MOTION = 1e-2  # of the motion under the same loads at rest, below which ratios of a linear motion are meaningless


def predict(
    solver: PointSolver, earlier: PointState | None, before: PointState, now: PointState, ds: float
) -> tuple[Iterate, Plane]:
    """Return the guess a step ``ds`` ahead and the row of the arc length, docs/theory.md, eq. (7.2).

    On the known curve (all pairs stuck) the guess is its point, at a fixed parameter; otherwise
    the parabola through the last three points (the secant where there are two), and the plane normal to the secant; for a maximum
    the value of the parameter, as long as steps are not short.
    """
    if now.sticks:
        direction = float(np.sign(now.iterate.parameter - before.iterate.parameter))
        guess = solver.on_curve(now.iterate.parameter + direction * linear_step(solver, now, ds))
        return guess, Plane.fixed_parameter(guess)
    ahead = Ahead.of(solver, earlier, before, now, ds)
    is_by_parameter = solver.problem.maximum is not None and ds > BY_PARAMETER
    guess = ahead.at(ds, is_by_parameter)
    if is_by_parameter:
        return guess, Plane.fixed_parameter(guess)
    normal = ahead.d_U / now.size
    normal[..., solver.harmonics.mean] = 0.0
    return guess, Plane(guess, normal, tuple(ahead.d_nu))


def requested_ahead(
    solver: PointSolver, earlier: PointState | None, before: PointState, now: PointState, ds: float
) -> Iterate | None:
    """Return the guess of a maximum at the next requested value of the parameter, within a step ``ds``.  Collective.

    None where there is no such value, or the step is none of the parameter.
    """
    if solver.problem.maximum is None or now.sticks or ds <= BY_PARAMETER or not solver.sweep.at:
        return None
    ahead, here = Ahead.of(solver, earlier, before, now, ds), now.iterate.parameter
    for value in solver.sweep.requested_between(here, ahead.at(ds, True).parameter):
        return ahead.at(ahead.length_to(value), True).at(value)
    return None


@dataclass(frozen=True, eq=False)
class Ahead:
    """The parabola through the last three points in the arc length, the line through two where there is no other."""

    solver: PointSolver
    now: PointState
    length: float  # of the last step
    d_U: np.ndarray  # (n_owned, 3, N_H) m, over a length of 1 along the line
    d_nu: np.ndarray  # (k,) -, the same
    bend_U: np.ndarray | None = (
        None  # times the length and the length from the previous point: distance of the parabola from the line
    )
    bend_nu: np.ndarray | None = None

    @classmethod
    def of(cls, solver: PointSolver, earlier: PointState | None, before: PointState, now: PointState, ds: float) -> Ahead:
        """Return that for steps up to ``ds``.  Collective."""
        d_U, d_nu, length = difference(solver, before, now, now.size)
        line = cls(solver, now, length, d_U / length, d_nu / length)
        if earlier is None or before.sticks or ds >= FAR_AHEAD * length:
            return line
        e_U, e_nu, e_length = difference(solver, earlier, before, now.size)
        whole = length + e_length  # Newton's divided differences in the arc length
        return replace(line, bend_U=(line.d_U - e_U / e_length) / whole, bend_nu=(line.d_nu - e_nu / e_length) / whole)

    def at(self, ds: float, is_by_parameter: bool) -> Iterate:
        """Return the place a step ahead; ``is_by_parameter``: on the line where the parabola leads the parameter back.  Local.

        A value that was passed has the solution that was there.
        """
        d_U, d_nu = ds * self.d_U, ds * self.d_nu
        if self.bend_U is not None and self.bend_nu is not None:
            share = ds * (ds + self.length)
            bent = d_nu + share * self.bend_nu
            if not is_by_parameter or bent[0] * d_nu[0] > 0.0:
                d_U, d_nu = d_U + share * self.bend_U, bent
        return self.solver.stepped(self.now.iterate, d_U, d_nu)

    def length_to(self, value: float) -> float:
        """Return the shortest step to a value of the parameter.  Local."""
        way = (value - self.now.iterate.parameter) / self.solver.units[0]
        bend = 0.0 if self.bend_nu is None else self.bend_nu[0]
        slope = self.d_nu[0] + bend * self.length
        root = slope**2 + 4.0 * bend * way  # of way = slope ds + bend ds^2
        ds = 2.0 * way / (slope + np.copysign(np.sqrt(root), way)) if root >= 0.0 and slope * way > 0.0 else 0.0
        return float(ds) if ds > 0.0 else float(way / self.d_nu[0])


def difference(solver: PointSolver, a: PointState, b: PointState, size: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the step from a to b: its motion, its scaled parameters and its length in the norm about ``size``.  Collective."""
    d_U, d_nu = b.iterate.U - a.iterate.U, solver.d_nu(a.iterate, b.iterate)
    return d_U, d_nu, solver.length(d_U / size, d_nu)


def linear_step(solver: PointSolver, now: PointState, ds: float) -> float:
    """Return the change of the parameter that makes a step ``ds`` along the known curve.  Collective.

    Where that curve passes through no motion, the step is measured by a share of the static one, and leads across.
    """
    at, rate = solver.problem.at(now.iterate.parameters), solver.problem.curve.rate(now.iterate.parameters)
    size = max(now.size, FAINT_MOTION * solver.norm(static_motion(solver.equation.model, at.level)))
    slope = solver.norm(solver.vibration(rate)) / size if size > 0.0 else 0.0
    return ds / float(np.hypot(slope, 1.0 / solver.sweep.scale))
