"""From the scene's [response] to one branch a level."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..contact.law import ContactParameters
from ..harmonic.residual import HarmonicBalance
from ..parallel.errors import CaseError
from ..reduction import receptance
from ..reduction.model import ReducedModel
from ..reduction.selection import Selection
from .branch import Branch, Point
from .follow import Sweep, follow_branch
from .steps import ArcLength, curve_length, linear_frequencies


@dataclass(frozen=True)
class LinearCurve:
    """The response with every pair stuck, at one newton of level."""

    omega: np.ndarray           # (n,) rad/s
    response: np.ndarray        # (n, n_outputs, N_H) m/N
    length: float               # in the norm of the steps


def frequency_sweep(response, omega_n: np.ndarray) -> Sweep:
    """Return the range of [response] in rad/s, in the direction asked for.  Local.

    Raises
    ------
    CaseError : the mode asked for was not computed, or a frequency of ``at`` lies outside the range
    """
    if response.frequencies is not None:
        low, high = response.frequencies
    else:
        if response.mode > len(omega_n):
            raise CaseError(f"[response] mode = {response.mode}, but only {len(omega_n)} modes were computed; raise [solver] modes")
        low, high = (share * omega_n[response.mode - 1] / (2 * np.pi) for share in response.span)
    outside = [f for f in response.at if not low <= f <= high]
    if outside:
        raise CaseError(f"[response] at = {outside[0]:g} Hz lies outside {low:.6g} to {high:.6g} Hz")
    start, stop = (low, high) if response.direction == "up" else (high, low)
    return Sweep(2 * np.pi * start, 2 * np.pi * stop, tuple(2 * np.pi * f for f in response.at))


def linear_curve(model: ReducedModel, sweep: Sweep) -> LinearCurve:
    """Return the stuck curve over the range, every resonance in it resolved.  Collective."""
    omega = linear_frequencies(min(sweep.start, sweep.stop), max(sweep.start, sweep.stop), model.omega_n, model.zeta)
    none = np.zeros((3 * model.n_pairs, model.N_H))
    response = np.array([receptance.output_motion(model, 1.0, w, none) for w in omega])
    motions = [receptance.linear_motion(model, 1.0, w)[0] for w in omega]
    return LinearCurve(omega, response, curve_length(model.comm, motions, omega, sweep.scale))


def arc_length_steps(continuation, points: int, curve: LinearCurve) -> ArcLength:
    """Return the step lengths: the linear curve in ``points`` steps, unless [continuation] says otherwise.  Local.

    The keys of [continuation] are shares of the length of the linear curve.
    """
    asked = {key: getattr(continuation, key, None) for key in ("ds", "ds_min", "ds_max")}
    ds = curve.length * (asked["ds"] or 1.0 / points)
    ds_min = curve.length * asked["ds_min"] if asked["ds_min"] else ds / 1024.0
    ds_max = curve.length * asked["ds_max"] if asked["ds_max"] else 2.0 * ds
    return ArcLength(ds=ds, ds_min=ds_min, ds_max=ds_max)


class Listener(Protocol):
    """Who is told of levels and points as they come: the log and the result files."""

    def level_started(self, number: int, level: float) -> None: ...

    def point(self, point: Point) -> None: ...


def follow_levels(scene, model: ReducedModel, parameters: ContactParameters, selection: Selection, sweep: Sweep, curve: LinearCurve,
                  listener: Listener) -> Iterator[Branch]:
    """Yield the branch of each level as it is done.  Collective."""
    steps = arc_length_steps(scene.continuation, scene.response.points, curve)
    for number, level in enumerate(scene.response.levels):
        listener.level_started(number, level)
        problem = HarmonicBalance(model, parameters, scene.solver.samples, level)
        yield follow_branch(problem, selection, sweep, steps, tolerance=scene.solver.tolerance,
                            max_points=10 * scene.response.points, on_point=listener.point)
