"""The next point's guess, and the plane that holds the step (docs/theory.md, section 7)."""

from __future__ import annotations

import numpy as np

from ..receptance.motions import static_motion
from .constraint_rows import Plane
from .iterate import Iterate, PointState
from .point_solver import PointSolver

FAR_AHEAD = 4.0  # lengths of the last step beyond which a parabola is not used
BY_PARAMETER = 1e-2  # shortest step of a maximum at a fixed parameter; shorter ones, in a plane, pass folds
FAINT_MOTION = 1e-2  # of the motion under the same loads at rest, below which ratios of a linear motion tell nothing


def predict(
    solver: PointSolver, earlier: PointState | None, before: PointState, now: PointState, ds: float
) -> tuple[Iterate, Plane]:
    """Return the guess a step ``ds`` ahead and the row that holds the step, docs/theory.md, eq. (7.2).

    On the known curve (all pairs stuck) the guess is its point, at a fixed parameter; otherwise
    the parabola through the last three points (the secant where there are two), and the plane normal to the secant; for a maximum
    the value of the parameter, as long as steps are not short.
    """
    if now.sticks:
        direction = float(np.sign(now.iterate.parameter - before.iterate.parameter))
        guess = solver.on_curve(now.iterate.parameter + direction * linear_step(solver, now, ds))
        return guess, Plane.fixed_parameter(guess)
    d_U, d_nu, length = difference(solver, before, now, now.size)
    line_U, line_nu = ds / length * d_U, ds / length * d_nu
    ahead_U, ahead_nu = line_U, line_nu
    if earlier is not None and not before.sticks and ds < FAR_AHEAD * length:
        e_U, e_nu, e_length = difference(solver, earlier, before, now.size)
        share = ds * (ds + length) / (length + e_length)  # Newton's divided differences in the arc length
        ahead_U = line_U + share * (d_U / length - e_U / e_length)
        ahead_nu = line_nu + share * (d_nu / length - e_nu / e_length)
    is_by_parameter = solver.problem.maximum is not None and ds > BY_PARAMETER
    if is_by_parameter and ahead_nu[0] * d_nu[0] <= 0.0:  # a value that was passed has the solution that was there
        ahead_U, ahead_nu = line_U, line_nu
    guess = solver.beside(now.iterate, ahead_U, ahead_nu)
    if is_by_parameter:
        return guess, Plane.fixed_parameter(guess)
    normal = d_U / (now.size * length)
    normal[..., solver.harmonics.mean] = 0.0
    return guess, Plane(guess, normal, tuple(d_nu / length))


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
