"""From the scene's [response] to one branch a level."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from ..contact.law import ContactParameters
from ..error_estimate.better_model import Truth
from ..error_estimate.estimate import ErrorEstimator
from ..harmonic.residual import HarmonicBalance
from ..modes.band import frequency_band
from ..parallel.errors import CaseError
from ..receptance import motion as receptance
from ..receptance.model import ReducedModel
from ..reduction.selection import AllPairs, Selection
from .accuracy import accuracy_of, steps_for
from .branch import Branch, Point
from .corrector import Correction, Iterate
from .follow import BranchFollower, follow_branch
from .point_record import point_record
from .scaled import ScaledFollower, is_linear, sticks_up_to
from .statics import StaticFollower
from .steps import ArcLength, LinearCurve, arc_lengths, linear_frequencies
from .sweep import Sweep

USUAL_POINTS = 100


def frequency_sweep(response, omega_n: np.ndarray) -> Sweep:
    """Return the range of [response] in rad/s, in the direction asked for.  Local.

    Raises
    ------
    CaseError : the mode asked for was not computed, or a frequency of ``at`` lies outside the range
    """
    low, high = frequency_band(response, omega_n)
    highest = float(np.max(omega_n, initial=0.0)) / (2 * np.pi)
    if len(omega_n) and low > 10.0 * highest:
        raise CaseError(
            f"[response] starts at {low:g} Hz, far above the highest of the {len(omega_n)} modes computed, "
            f"{highest:.4g} Hz; check the unit (Hz), or raise [solver] modes"
        )
    outside = [f for f in response.at if not low <= f <= high]
    if outside:
        raise CaseError(f"[response] at = {outside[0]:g} Hz lies outside {low:.6g} to {high:.6g} Hz")
    start, stop = (low, high) if response.direction == "up" else (high, low)
    return Sweep(2 * np.pi * start, 2 * np.pi * stop, tuple(2 * np.pi * f for f in response.at))


def linear_curve(model: ReducedModel, sweep: Sweep, parameters: ContactParameters | None = None) -> LinearCurve:
    """Return the stuck curve over the range, every resonance in it resolved.  Collective.

    Its length is that of the pairs' motion; of the outputs' where there is no pair.  Without ``parameters`` of the pairs no level
    is known to be linear.
    """
    ends = min(sweep.start, sweep.stop), max(sweep.start, sweep.stop)
    omega = model.comm.bcast(linear_frequencies(*ends, model.omega_n, model.zeta))
    none = np.zeros((3 * model.n_pairs, model.N_H))
    response = np.array([receptance.output_motion(model, 1.0, w, none) for w in omega])
    motions = [receptance.linear_motion(model, 1.0, w)[0] for w in omega] if model.n_pairs else list(response)
    s = arc_lengths(model.comm, motions, omega, sweep.scale)
    stuck = np.zeros(len(omega))
    if parameters is not None and model.n_pairs > 0:
        stuck = sticks_up_to(model, parameters, motions)
    return LinearCurve(omega, model.harmonics.carry(response, model.recorded), s, stuck)


def linear_branch(
    problem: HarmonicBalance,
    sweep: Sweep,
    curve: LinearCurve,
    n_points: int,
    on_point: Callable[[Point], None],
    estimator: ErrorEstimator | None = None,
) -> Branch:
    """Return a branch known to be linear, at equal steps of its length and where asked; nothing is solved.  Collective."""
    omegas = np.interp(np.linspace(0.0, curve.s[-1], n_points), curve.s, curve.omega) if n_points > 1 else np.array([sweep.start])
    branch, everything = Branch(problem.level), np.ones(problem.model.n_pairs, dtype=bool)
    clock = time.perf_counter()
    for omega in np.union1d(omegas, sweep.at)[:: int(sweep.direction)]:
        on_curve = Correction(Iterate(problem.linear_motion(omega)[0], float(omega)), 0, 0, 0.0, None)
        point, _ = point_record(problem, on_curve, everything, AllPairs(), omega in sweep.at, estimator)
        now = time.perf_counter()
        point, clock = replace(point, seconds=now - clock), now
        on_point(point)
        branch.points.append(point)
    return branch


def most_points(points: int) -> int:
    """Return the bound of the points of a branch that never ends; corners and folds take some, however few are asked for."""
    return 10 * (points + USUAL_POINTS)


def arc_length_steps(continuation, points: int, curve: LinearCurve) -> ArcLength:
    """Return the step lengths: the linear curve in ``points`` steps, unless [continuation] says otherwise.  Local.

    The keys of [continuation] are shares of that length.  Few points make long steps, but none of them blind: the shortest step
    is no longer than that of the usual number of points.
    """
    stated = stated_steps(continuation, curve)
    ds = stated.get("ds", curve.s[-1] / points)
    return ArcLength(**{"ds": ds, "ds_min": min(ds, curve.s[-1] / USUAL_POINTS) / 4096.0, "ds_max": 2.0 * ds} | stated)


def stated_steps(continuation, curve: LinearCurve) -> dict[str, float]:
    """Return the step lengths that [continuation] states, from shares of the length of the linear curve.  Local."""
    asked = {key: getattr(continuation, key, None) for key in ("ds", "ds_min", "ds_max")}
    return {key: curve.s[-1] * value for key, value in asked.items() if value}


def likely_to_slip(model: ReducedModel, parameters: ContactParameters, curve: LinearCurve) -> np.ndarray:
    """Return the pairs by falling share of the friction limit, or of the preload, that the linear peak takes up.

    Collective: one broadcast.  Only the order of static solves depends on it.
    """
    at_peak = curve.omega[np.argmax(np.abs(curve.response[:, 0, 1:]).max(axis=1, initial=0.0))]
    U = np.abs(receptance.linear_motion_of_all(model, 1.0, at_peak)).reshape(model.n_pairs, 3, model.N_H).sum(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.stack(
            [
                parameters.k_t * np.hypot(U[:, 0], U[:, 1]) / (parameters.mu * parameters.N0),
                parameters.k_n * U[:, 2] / parameters.N0,
            ]
        )
    order = np.argsort(-np.nan_to_num(shares, nan=0.0, posinf=1e300, neginf=1e300).max(axis=0), kind="stable")
    return model.comm.bcast(order)  # all ranks solve for the same columns, also where a tie falls otherwise on some


def nobody(event: str, *news) -> None:
    """Tell nobody."""


def follow_levels(
    scene,
    model: ReducedModel,
    parameters: ContactParameters,
    selection: Selection,
    sweep: Sweep,
    curve: LinearCurve,
    truth: Truth | None = None,
    tell: Callable[..., None] = nobody,
) -> list[Branch]:
    """Return the branches of all levels, one after the other.  Collective, as is ``tell``, which hears of levels and points.

    What it is told is what :class:`~microslip.observe.observer.Observers` has methods for.
    """
    if model.n_pairs > 0:
        model.G_static.likely = likely_to_slip(model, parameters, curve)
    branches = []
    for number, level in enumerate(scene.response.levels):
        tell("level_started", number)
        on_point = partial(tell, "point", number)
        branches.append(follow_level(scene, model, parameters, selection, sweep, curve, level, on_point, truth))
        tell("level_finished", number, branches[-1])
    return branches


def follow_level(
    scene,
    model: ReducedModel,
    parameters: ContactParameters,
    selection: Selection,
    sweep: Sweep,
    curve: LinearCurve,
    level: float,
    on_point: Callable[[Point], None],
    truth: Truth | None = None,
) -> Branch:
    """Return the branch of one level [N], with error bars where a ``truth`` is given.  Collective on ``model.comm``.

    A branch that ends early is followed from the other end of the range as well: folds that lead it back, or a corner that
    Newton does not pass in one direction, often lie on one side only.
    """
    follow = partial(_follow_one_way, scene, model, parameters, selection, curve, level, on_point, truth)
    branch = follow(sweep)
    if branch.failure is None or model.harmonics.highest == 0 or len(branch.points) >= most_points(scene.response.points):
        return branch
    return branch.with_segment_from_the_other_end(follow(sweep.reverse, segment=1))


def _follow_one_way(
    scene,
    model: ReducedModel,
    parameters: ContactParameters,
    selection: Selection,
    curve: LinearCurve,
    level: float,
    on_point: Callable[[Point], None],
    truth: Truth | None,
    sweep: Sweep,
    segment: int = 0,
) -> Branch:
    problem = HarmonicBalance(model, parameters, scene.solver.samples, level)
    estimator = None if truth is None else ErrorEstimator(truth)
    is_static = model.harmonics.highest == 0
    if model.n_pairs == 0:
        n_points, sweep = (1, replace(sweep, at=())) if is_static else (scene.response.points, sweep)
        return linear_branch(problem, sweep, curve, n_points, on_point, estimator)
    linear = is_linear(problem, curve)
    accuracy = accuracy_of(scene, problem, linear) if estimator else None
    steps = arc_length_steps(scene.continuation, scene.response.points, curve)
    if accuracy is not None and accuracy.chooses_steps:
        steps = ArcLength(**asdict(steps_for(accuracy.target)) | stated_steps(scene.continuation, curve))
    return follow_branch(
        problem,
        selection,
        sweep,
        steps,
        tolerance=scene.solver.tolerance,
        max_points=most_points(scene.response.points),
        on_point=on_point,
        estimator=estimator,
        accuracy=accuracy,
        follower=StaticFollower if is_static else ScaledFollower if linear else BranchFollower,
        segment=segment,
    )
