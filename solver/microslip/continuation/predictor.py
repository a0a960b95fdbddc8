"""The next point's guess, and the plane that holds the step (docs/theory.md, section 7)."""

from __future__ import annotations

import numpy as np

from ..receptance.motions import static_motion
from .constraint_rows import Plane
from .iterate import Iterate, PointState
from .point_solver import PointSolver

FAR_AHEAD = 4.0  # lengths of the last step beyond which a parabola says nothing
FAINT_MOTION = 1e-2  # of the motion under the same loads at rest, below which ratios of a linear motion tell nothing


def predict(
    solver: PointSolver, earlier: PointState | None, before: PointState, now: PointState, ds: float
) -> tuple[Iterate, Plane]:
    """Return the guess a step ``ds`` ahead and the row that holds the step, docs/theory.md, eq. (7.2).

    On the linear curve (all pairs stuck) the guess is the linear response itself, at a fixed parameter; otherwise
    the parabola through the last three points (the secant where there are two), and the plane normal to the secant.
    """
    if now.sticks:
        direction = float(np.sign(now.iterate.parameter - before.iterate.parameter))
        guess = solver.linear_iterate(now.iterate.parameter + direction * linear_step(solver, now, ds))
        return guess, Plane.fixed_parameter(guess)
    d_U, d_parameter, length = difference(solver, before, now, now.size)
    U = now.iterate.U + ds / length * d_U
    parameter = now.iterate.parameter + ds / length * d_parameter
    if earlier is not None and not before.sticks and ds < FAR_AHEAD * length:
        e_U, e_parameter, e_length = difference(solver, earlier, before, now.size)
        share = ds * (ds + length) / (length + e_length)  # Newton's divided differences in the arc length
        U += share * (d_U / length - e_U / e_length)
        parameter += share * (d_parameter / length - e_parameter / e_length)
    guess = Iterate(U, (parameter,), solver.harmonics)
    normal = d_U / (now.size * length)
    normal[..., solver.harmonics.mean] = 0.0
    return guess, Plane(guess, normal, (d_parameter / (solver.sweep.scale * length),))


def difference(solver: PointSolver, a: PointState, b: PointState, size: float) -> tuple[np.ndarray, float, float]:
    """Return the step from a to b: its motion, its parameter and its length in the norm about ``size``.  Collective."""
    d_U, d_parameter = b.iterate.U - a.iterate.U, b.iterate.parameter - a.iterate.parameter
    return d_U, d_parameter, solver.length(d_U / size, d_parameter / solver.sweep.scale)


def linear_step(solver: PointSolver, now: PointState, ds: float) -> float:
    """Return the change of the parameter that makes a step ``ds`` along the linear curve.  Collective.

    Where that curve passes through no motion, the step is measured by a share of the static one, and leads across.
    """
    at, rates = solver.problem.at(now.iterate.parameters), solver.problem.rates(now.iterate.parameters)
    size = max(now.size, FAINT_MOTION * solver.norm(static_motion(solver.equation.model, at.level)))
    slope = solver.norm(solver.vibration(solver.equation.linear_motion_rate(at, rates[0]))) / size if size > 0.0 else 0.0
    return ds / float(np.hypot(slope, 1.0 / solver.sweep.scale))
