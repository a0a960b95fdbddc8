"""The reference of a trade: levels and frequencies from cheap curves, then harmonics, samples and modes raised until they are enough.

What is enough is learnt on a few points about the strongest peak, one knob at a time; then the reference is solved at all points
of all levels, and beside it the two coarser runs of each knob from which its own error follows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from .continuation.follow import follow_branch
from .continuation.grid import going_on
from .continuation.levels import arc_length_steps, linear_curve
from .modes.limits import most_modes
from .parallel.errors import ConvergenceError
from .results.trade import TARGETS, Check, Curve, Reference, Setting, difference
from .trade_bench import Bench, Clock, curve_of

POINTS = 24                         # a level
STEPS = 60                          # of the cheap curve
FEW = 5                             # points about the peak, on which the reference is looked for
HARMONICS = (3, 7, 15, 31, 63)      # each about twice the one before
SAMPLES = (128, 256, 512, 1024, 2048, 4096, 8192)
ENOUGH = 0.1 * min(TARGETS)         # of the peak
EVEN = 0.2                          # of what more harmonics change: other knobs need not be better
TOLERANCE = 1e-10
CHECKED_AT = 7                      # harmonics of the runs that tell of samples and modes


def frequencies(bench: Bench, setting: Setting, levels: Sequence[float] | None) -> tuple[dict[float, list[float]], float]:
    """Return the frequencies [rad/s] of each level, and the largest loss of a pair [J a cycle].  Collective.

    Of the scene's levels the first with slip and the strongest, unless ``levels`` are given.  The frequencies are those of a
    curve of few harmonics, at equal steps of its length.

    Raises
    ------
    ConvergenceError : no level has a curve; on every rank
    """
    prepared, found, most, failures = bench.prepared(setting), {}, 0.0, []
    curve = linear_curve(prepared.reduction.model, bench.sweep)
    steps = arc_length_steps(bench.scene.continuation, STEPS, curve)
    asked = sorted(levels or bench.scene.response.levels)
    for level in asked if levels else [asked[-1], *asked[:-1]]:
        branch = follow_branch(bench.problem(prepared, setting, level), prepared.reduction.selection, bench.sweep, steps,
                               tolerance=setting.tolerance, max_points=20 * STEPS)
        omegas = going_on(branch.points, bench.sweep.direction)
        slips = any(np.any(point.state != 0) for point in branch.points)
        if len(omegas) < 5:
            failures.append(f"{level:g} N: {branch.failure}")
        elif levels or slips or level == asked[-1]:
            found[level] = thinned(omegas, [abs(u) for u in curve_of(branch).u], [point.omega for point in branch.points])
            most = max([most, *(float(point.energy.max(initial=0.0)) for point in branch.points)])
        if not levels and (len(found) == 2 or (level == asked[-1] and not slips and found)):
            break
    if not found:
        raise ConvergenceError("no level has a curve to compare on: " + "; ".join(failures))
    return bench.comm.bcast((dict(sorted(found.items())), most))


def thinned(omegas: Sequence[float], amplitude: Sequence[float], at: Sequence[float]) -> list[float]:
    """Return about POINTS of ``omegas``, evenly, the one with the largest amplitude and its neighbours among them.  Local."""
    top = int(np.argmin(np.abs(np.array(omegas) - at[int(np.argmax(amplitude))])))
    chosen = set(np.linspace(0, len(omegas) - 1, min(POINTS, len(omegas))).round().astype(int)) | {top - 1, top, top + 1}
    return [omegas[i] for i in sorted(chosen) if 0 <= i < len(omegas)]


def find_reference(bench: Bench, omegas: Mapping[float, Sequence[float]], start: Setting, clock: Clock, share: float,
                   note: Callable[[str], None]) -> Reference:
    """Return the reference, as fine as needed or as ``share`` of the time allows.  Collective.

    Raises
    ------
    ConvergenceError : it has no curve; on every rank
    """
    began, strongest = clock.spent, max(omegas)
    few = about_peak(bench, start, strongest, omegas[strongest])
    ratio = sum(len(points) for points in omegas.values()) / len(few[strongest])
    H, steps_H, why_H = _raised(bench, start, "harmonics", [n for n in HARMONICS if n >= bench.least_harmonics], few, ENOUGH,
                                ratio, clock, share)
    goal = max(ENOUGH, EVEN * steps_H[-1]) if steps_H else ENOUGH
    N, steps_N, why_N = _raised(bench, replace(start, harmonics=CHECKED_AT), "samples", list(SAMPLES), few, goal, ratio, clock, share)
    m, steps_m, why_m = _raised(bench, start, "modes", mode_numbers(bench, start.modes), few, goal, ratio, clock, share)
    setting = replace(start, harmonics=H, samples=max(N, 8 * (H + 1)), modes=m)
    note(f"reference: {setting}; harmonics {why_H}, samples {why_N}, modes {why_m}")
    curves = solved(bench, setting, omegas)
    checks = [_checked(bench, setting, "harmonics", [n for n in HARMONICS if n <= H][-3:], omegas, curves)]
    coarse = replace(setting, harmonics=min(CHECKED_AT, H))
    beside = solved(bench, coarse, omegas)
    checks.append(_checked(bench, coarse, "samples", [setting.samples // 4, setting.samples // 2, setting.samples], omegas, beside))
    if m < bench.structure.linearised.system.n_dof:
        checks.append(_checked(bench, coarse, "modes", sorted({max(m // 4, 1), max(m // 2, 1), m}), omegas, beside))
    missing = [f"{curve.level:g} N" for curve in curves if len(curve.omega) < len(omegas[curve.level])]
    if missing:
        raise ConvergenceError(f"the reference ({setting}) does not converge at every frequency of {', '.join(missing)}")
    why = "; ".join(f"{knob} {reason}" for knob, reason in (("harmonics", why_H), ("samples", why_N), ("modes", why_m)))
    return Reference(setting, {curve.level: curve for curve in curves}, tuple(checks), clock.spent - began, why)


def about_peak(bench: Bench, setting: Setting, level: float, omegas: Sequence[float]) -> dict[float, list[float]]:
    """Return FEW neighbouring frequencies about the largest response at a level.  Collective."""
    curve = solved(bench, setting, {level: omegas})[0]
    top = int(np.argmax(np.abs(curve.u))) if len(curve.u) else 0
    first = min(max(top - FEW // 2, 0), max(len(omegas) - FEW, 0))
    return {level: list(omegas[first: first + FEW])}


def solved(bench: Bench, setting: Setting, omegas: Mapping[float, Sequence[float]]) -> tuple[Curve, ...]:
    """Return the curves of a setting, without bars.  Collective."""
    prepared = bench.prepared(setting)
    found = [curve_of(bench.branch(prepared, setting, level, points, bars=False)) for level, points in omegas.items()]
    return bench.comm.bcast(tuple(found))


def mode_numbers(bench: Bench, start: int) -> list[int]:
    """Return numbers of modes to try, each twice the one before, up to those computed or all there are.  Local."""
    n_dof = bench.structure.linearised.system.n_dof
    most = min(len(bench.modes.omega_n), most_modes(n_dof))
    numbers = [most]
    while numbers[0] > max(start, 2):
        numbers.insert(0, max(numbers[0] // 2, 1))
    return numbers


def _raised(bench: Bench, start: Setting, knob: str, values: Sequence[int], few, goal: float, ratio: float, clock: Clock,
            share: float) -> tuple[int, list[float], str]:
    """Return the first value of a knob after which the next one changes less than ``goal``, the changes, and why it is that one.

    Stops short where the reference, its checks and what is still to be done would take more than is left of the time.
    """
    before, steps, taken = None, [], []
    for value in values:
        if len(taken) > 1 and 2.0 * ratio * taken[-1] * max(taken[-1] / taken[-2], 1.5) > clock.left(share):
            return values[len(taken) - 1], steps, f"as many as the time allows (the last doubling changed {steps[-1]:.1e})"
        at = clock.spent
        now = solved(bench, replace(start, **{knob: value}), few)
        taken.append(clock.spent - at)
        if before is not None:
            steps.append(bench.comm.bcast(difference(before, now)))
            if steps[-1] <= goal:
                return value, steps, f"enough (the last doubling changed {steps[-1]:.1e})"
        before = now
    return values[-1], steps, "as many as are tried" + (f" (the last doubling changed {steps[-1]:.1e})" if steps else "")


def _checked(bench: Bench, setting: Setting, knob: str, values: Sequence[int], omegas, finest: Sequence[Curve]) -> Check:
    """Return how the response changes towards the last of ``values``, whose curves are known.  Collective."""
    curves = [*(solved(bench, replace(setting, **{knob: value}), omegas) for value in values[:-1]), finest]
    steps = bench.comm.bcast(tuple(difference(coarse, fine) for coarse, fine in zip(curves, curves[1:])))
    return Check(knob, tuple(values), steps)
