"""Maxima of outputs along a curve, located by its points (docs/theory.md, section 7)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline, KroghInterpolator

from ..harmonic.adjoint_solver import AdjointSolver
from ..parallel.agree import on_root
from ..points.branch import Branch, Point
from .branch_points import equation_at, harmonics_of, iterate_of
from .constraint_rows import Scaling
from .corrector import BorderedSystem
from .output_rates import output_rates
from .problems import ForcedResponse
from .steps import LinearCurve

LEAST_CHANGE = 1e-3  # of the logarithm of an amplitude, below which corners decide: over half of the way between its neighbours;
# of the maximum of a cubic within a step
MARGIN = 2.0  # times the difference of the parabolas, above which the sign of their slope is certain
UNIT = 1e-3  # of the frequency, the unit of derivatives by it
TINY = 1e-300  # m2


@dataclass(frozen=True)
class Top:
    """A place of a branch about which an output has a maximum."""

    output: int
    between: tuple[int, int]  # numbers of two points
    point: int  # a third one that is higher; or, by its slope or for the linear response, one of them
    omega: float | None = None  # rad/s, of the linear response; None: that point

    @property
    def is_hidden(self) -> bool:
        """Whether the slope at a point shows it."""
        return self.omega is None and self.point in self.between


def maxima(branch: Branch) -> Iterator[tuple[int, int]]:
    """Yield the outputs and the numbers of the points at which they are higher than at both neighbours.  Local."""
    if not branch.points:
        return
    sizes = np.array([np.hypot(*point.response[:, 1:3].T) for point in branch.points])  # (n_points, n_outputs)
    segment = np.array([point.segment for point in branch.points])
    inner = (segment[:-2] == segment[1:-1]) & (segment[1:-1] == segment[2:])
    tops = inner[:, None] & (sizes[1:-1] > sizes[:-2]) & (sizes[1:-1] >= sizes[2:])
    for output, i in np.argwhere(tops.T):
        yield int(output), int(i) + 1


def between_points(branch: Branch, curve: LinearCurve) -> list[Top]:
    """Return the maxima of the linear response between consecutive points at which all pairs stick.

    Local, on rank 0.  Without a maximum that is already shown by a stuck point next to it.  The points may be
    higher than the maxima, as between two antiresonances.
    """
    tops, points = [], branch.points
    stuck = [i for i, (a, b) in enumerate(zip(points, points[1:])) if sticks(a) and sticks(b) and a.segment == b.segment]
    sizes = np.hypot(curve.response[..., 1], curve.response[..., 2])  # (n, n_outputs)
    for k, output in np.argwhere((sizes[1:-1] > sizes[:-2]) & (sizes[1:-1] >= sizes[2:])):
        omega = float(curve.omega[k + 1])
        for i in stuck:
            ends = points[i : i + 2]
            is_between = min(end.omega for end in ends) < omega < max(end.omega for end in ends)
            if is_between:
                tops.append(Top(int(output), (i, i + 1), i, omega))
    for output, i in maxima(branch):
        beside = [top for top in tops if top.output == output and i in top.between]
        if beside and all(map(sticks, points[i - 1 : i + 2])):
            tops.remove(min(beside, key=lambda top: abs((top.omega or 0.0) - points[i].omega)))  # noqa: B023  called here
    return tops


def sticks(point: Point) -> bool:
    """Return whether every element of every pair sticks at a point, which is one of the linear response.  Local, on rank 0."""
    return not (point.state.any() or point.p[..., 1:].any())


def hidden(problem: ForcedResponse, branch: Branch, curve: LinearCurve | None) -> list[Top]:
    """Return the maxima between two consecutive points that only slopes show, not the amplitudes of points.  Collective.

    If an output falls at a point that is higher than the previous one, a maximum is before the point; if it rises at a point that
    is higher than the next one, a maximum is behind it.  The cubic by the amplitudes and slopes at both ends of a step may have a
    maximum that is higher than both; such a top has the lower end as its point.
    """
    comm, tops = problem.equation.comm, []
    open_points = on_root(comm, undecided, branch, curve is not None)
    open_steps = on_root(comm, undecided_steps, branch, curve is not None)
    forward = AdjointSolver(comm)
    try:
        for i, way, trends in open_points:
            changes = way * slopes_at(problem, branch, i, list(trends), forward)
            for (output, trend), change in zip(trends.items(), changes):
                if change * trend < -LEAST_CHANGE:
                    tops.append(Top(output, (i - 1, i) if trend > 0.0 else (i, i + 1), i))
        for i, outputs in open_steps:
            sizes = log_sizes(outputs_of(branch)[i : i + 2, outputs])
            slopes = np.array([slopes_at(problem, branch, k, outputs, forward) for k in (i, i + 1)])
            has_top = exceeds_ends(np.array([point.omega for point in branch.points[i : i + 2]]), sizes, slopes)
            has_top, lower = comm.bcast((has_top, i + np.argmin(sizes, axis=0)))
            tops += [Top(output, (i, i + 1), int(low)) for output, low, is_top in zip(outputs, lower, has_top) if is_top]
    finally:
        forward.destroy()
    return tops


def undecided(branch: Branch, has_linear: bool) -> list[tuple[int, float, dict[int, float]]]:
    """Return points at which slopes may be against the trend of amplitudes; half of the step [rad/s]; outputs and their trends.

    Local, on rank 0.  Without points that are a maximum or a minimum, and those at which the frequency turns back, where its
    direction along the branch is not known.  Without points where three parabolas over the arc length, through the output at the
    point and at two others near by, agree on the slope; and, ``has_linear``, those between points at which all pairs stick.
    """
    points = branch.points
    if len(points) < 3:
        return []
    a, s = outputs_of(branch), arc_of(branch)
    omega, cases = np.array([point.omega for point in points]), []
    for i in range(len(points)):
        near = [k for k in range(i - 1, i + 2) if 0 <= k < len(points) and points[k].segment == points[i].segment]
        steps = np.diff(omega[near])
        if len(near) < 2 or steps.min() * steps.max() <= 0.0 or (has_linear and all(sticks(points[k]) for k in near)):
            continue
        trend = np.sign(np.diff(np.abs(a[near]), axis=0)).sum(axis=0) / (len(near) - 1)
        has_room = np.abs(trend) == 1.0 if len(near) == 3 else trend == (1.0 if near[1] == i else -1.0)
        estimates = slopes_of_parabolas(s, a, i, points)
        agrees = np.zeros(a.shape[1], dtype=bool)
        if len(estimates) == 3:
            agrees = estimates[1] * trend > MARGIN * np.ptp(estimates, axis=0)
        trends = {int(output): float(trend[output]) for output in np.flatnonzero(has_room & ~agrees)}
        if trends:
            cases.append((i, 0.5 * float(omega[near[-1]] - omega[near[0]]), trends))
    return cases


def undecided_steps(branch: Branch, has_linear: bool) -> list[tuple[int, list[int]]]:
    """Return the first points of steps, and outputs, that may have a maximum and a minimum within the step.  Local, on rank 0.

    By the cubic over the arc length with the largest slopes of parabolas at both ends, times ``MARGIN``.  The frequency does not
    turn back at or next to these steps.  Without those between points at which all pairs stick, with ``has_linear``.
    """
    points = branch.points
    if len(points) < 3:
        return []
    a, s = outputs_of(branch), arc_of(branch)
    omega, sizes, cases = np.array([point.omega for point in points]), log_sizes(a), []
    for i in range(len(points) - 1):
        near = [k for k in range(i - 1, i + 3) if 0 <= k < len(points) and points[k].segment == points[i].segment]
        steps, is_stuck = np.diff(omega[near]), sticks(points[i]) and sticks(points[i + 1])
        if i + 1 not in near or (has_linear and is_stuck) or steps.min() * steps.max() <= 0.0:
            continue
        ends, way = [i, i + 1], np.sign(sizes[i + 1] - sizes[i])
        rates = [slopes_of_parabolas(s, a, k, points) * way for k in ends]
        if all(map(len, rates)):
            slopes = MARGIN * way * np.array([rate.max(axis=0) for rate in rates]) / np.maximum(np.abs(a[ends]) ** 2, TINY)
            outputs = np.flatnonzero(exceeds_ends(s[ends], sizes[ends], slopes))
            cases += [(i, list(map(int, outputs)))] if len(outputs) else []
    return cases


def exceeds_ends(x: np.ndarray, y: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Return where a cubic by values and slopes (2, n) at both x, slopes with the sign of the chord, is above both values.

    Local.  It then has a maximum and a minimum between them.
    """
    order = np.argsort(x)
    above = CubicHermiteSpline(x[order], y[order], slopes[order])(np.linspace(x[0], x[1], 33)).max(axis=0) - y.max(axis=0)
    return (above > LEAST_CHANGE) & (slopes * (y[1] - y[0]) / (x[1] - x[0]) > 0.0).all(axis=0)


def outputs_of(branch: Branch) -> np.ndarray:
    """Return the first harmonics of the outputs at the points, (n_points, n_outputs).  Local."""
    return np.array([point.response[:, 1] - 1j * point.response[:, 2] for point in branch.points])


def log_sizes(a: np.ndarray) -> np.ndarray:
    """Return ln |a|, bounded where an output is at rest.  Local."""
    return np.log(np.maximum(np.abs(a), TINY))


def arc_of(branch: Branch) -> np.ndarray:
    """Return the arc length at the points of a branch, in the norm of steps.  Local, on rank 0."""
    omega, U = np.array([point.omega for point in branch.points]), [point.U[..., 1:] for point in branch.points]
    motions = [np.linalg.norm(b - a) / (np.linalg.norm(b) or 1.0) for a, b in zip(U, U[1:])]
    return np.concatenate([[0.0], np.cumsum(np.hypot(motions, np.diff(omega) / (np.ptp(omega) or 1.0)))])


def slopes_of_parabolas(s: np.ndarray, a: np.ndarray, i: int, points: list[Point]) -> np.ndarray:
    """Return |a|' |a| at point i by parabolas of complex ``a`` over ``s`` that end there, contain it or begin there.  Local.

    (n, n_outputs), without those that extend beyond the segment of the point or have two coincident points.
    """
    sets = [np.arange(k, k + 3) for k in (i - 2, i - 1, i) if 0 <= k < len(points) - 2]
    sets = [k for k in sets if points[k[0]].segment == points[k[2]].segment and np.diff(s[k]).min() > 0.0]
    rates = [KroghInterpolator(s[k] - s[i], a[k]).derivative(0.0) for k in sets]
    return np.array([(a[i].conj() * rate).real for rate in rates])


def slopes_at(problem: ForcedResponse, branch: Branch, number: int, outputs: list[int], forward: AdjointSolver) -> np.ndarray:
    """Return the derivatives of the logarithms of amplitudes of outputs by the frequency at a point [s/rad].  Collective.

    0 where the linearisation is singular.
    """
    point = branch.points[number]
    harmonics = harmonics_of(branch, point, problem.equation.harmonics)
    equation = equation_at(point, problem.equation, harmonics)
    system = BorderedSystem(problem.with_equation(equation), (), Scaling(1.0, (UNIT * point.omega,)), equation.every_pair)
    rates = output_rates(system, iterate_of(point, problem, harmonics), outputs, forward)
    if rates is None:
        return np.zeros(len(outputs))
    a, a_nu = rates.a.reshape(2, -1), rates.a_nu[0].reshape(2, -1)
    return equation.comm.bcast((a * a_nu).sum(axis=0) / np.maximum((a**2).sum(axis=0), TINY) / (UNIT * point.omega))
