"""The reference of a trade: levels and frequencies from coarse curves, then refinement of harmonics, samples and modes.

Every refinement step (rung) is solved at all points, each from the solution of the previous rung.  The changes from rung to rung
form a series, and its remainder is the uncertainty of the reference.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...continuation.grid import at_frequencies, range_of
from ...continuation.iterate import Iterate
from ...continuation.point_record import point_record
from ...continuation.point_solver import PointSolver, Workspace
from ...messages.errors import CaseError, ConvergenceError
from ...points.branch import Branch
from .bench import Bench, Clock, curve_of
from .study import ROUNDING, TARGETS, Check, Curve, Reference, Setting, difference, uncertainty

POINTS = 20  # points per level
STEPS = 60  # steps of the coarse curve
FEWEST = 5  # least points of a level for a comparison
RUNGS = (3, 7, 15, 31, 63, 127)  # harmonics, about doubled
SAMPLES, MOST_SAMPLES = 128, 16384  # samples of the first rung, doubled from rung to rung
FINE = 512  # least samples of the rungs of harmonics
ENOUGH = 0.3 * min(TARGETS)  # sufficient accuracy, relative to the peak
EVEN = 0.4  # of the remaining effect of harmonics: sufficient accuracy of other settings
TOLERANCE = 1e-10
CHECKED_AT = 7  # harmonics for the rungs of samples and modes
LINEAR = "those of the loads, nothing slips"
GROWTH = 2.2  # least factor of time from one rung of harmonics to the next
AGAIN = 1.5  # time of the remaining work over the time of the last rung


def frequencies(bench: Bench, setting: Setting, levels: Sequence[float] | None) -> tuple[dict[float, list[float]], float, bool]:
    """Return the frequencies [rad/s] of each level, the largest loss of a pair [J per cycle], and whether any slips or opens.

    Collective.  By default the first level of the scene with slip and the highest level.  The frequencies are from a curve with
    few harmonics, at equal arc lengths.

    Raises
    ------
    CaseError : the first output does not move in harmonic 1; on every rank
    ConvergenceError : no level has a curve; on every rank
    """
    prepared, by_level, most, failures, any_slips = bench.prepared(setting), {}, 0.0, [], False
    response = bench.response(prepared, setting)
    response = replace(response, settings=replace(response.settings, points=STEPS))
    strongest = max(levels or bench.scene.response.levels)
    for level in [strongest, *sorted(set(levels or bench.scene.response.levels) - {strongest})]:
        branch, omegas = response.frequencies_of(level)
        slips = bench.comm.bcast(any(np.any(point.state != 0) for point in branch.points))
        if len(omegas) < FEWEST:
            failures.append(f"{level:g} N: {branch.failure}")
        elif levels or slips or level == strongest:
            check_moves(bench, branch)
            any_slips = any_slips or slips
            by_level[level] = thinned(omegas, curve_of(branch))
            most = max([most, *(float(point.energy.max(initial=0.0)) for point in branch.points)])
        if not levels and (len(by_level) == 2 or (level == strongest and by_level and not slips)):
            break
    if not by_level:
        raise ConvergenceError("no level has a curve to compare on: " + "; ".join(failures))
    return bench.comm.bcast((dict(sorted(by_level.items())), most, any_slips))


def check_moves(bench: Bench, branch: Branch) -> None:
    """Refuse a curve whose first output does not move, because errors are relative to its peak.  Collective: one broadcast.

    Raises
    ------
    CaseError : on every rank
    """
    motions = [np.abs(motion).max(initial=0.0) for point in branch.points for motion in (point.response, point.U)]
    if bench.comm.bcast(curve_of(branch).peak <= ROUNDING * max(motions)):
        scene = bench.scene
        raise CaseError(
            f'{scene.path}: [[outputs]] 1 ("{scene.outputs[0].name}") does not move in harmonic 1 at '
            f"{branch.level:g} N, and trade measures errors over its peak there; put an output first that moves"
        )


def thinned(omegas: Sequence[float], curve: Curve) -> list[float]:
    """Return about POINTS evenly spread ``omegas``, including the largest amplitude and its neighbours.  Local."""
    top = int(np.argmin(np.abs(np.array(omegas) - curve.omega[int(np.argmax(np.abs(curve.u)))])))
    chosen = set(np.linspace(0, len(omegas) - 1, min(POINTS, len(omegas))).round().astype(int)) | {top - 1, top, top + 1}
    return [omegas[i] for i in sorted(chosen) if 0 <= i < len(omegas)]


@dataclass(frozen=True)
class Rung:
    """A setting solved at all points: curves, and motions as starting values of other settings."""

    setting: Setting
    curves: tuple[Curve, ...]
    motions: dict[float, list[Iterate]]  # by level; this rank's pairs
    seconds: float


class Ladder:
    """Settings solved at the same points, each from another's solution.  Every method is collective."""

    def __init__(self, bench: Bench, omegas: Mapping[float, Sequence[float]], clock: Clock):
        self.bench, self.omegas, self.clock = bench, omegas, clock

    def rung(self, setting: Setting, below: Rung | None = None) -> Rung:
        """Return a setting's solution.

        Raises
        ------
        ConvergenceError : no convergence at some frequency; on every rank
        """
        start, prepared, curves, motions = self.clock.spent, self.bench.prepared(setting), [], {}
        for level, omegas in self.omegas.items():
            branch = None
            if below is not None:
                branch, motions[level] = self._from(below.motions[level], prepared, setting, level, omegas)
            if branch is None:
                branch, motions[level] = self._computed(prepared, setting, level, omegas)
            curves.append(curve_of(branch))
        return Rung(setting, self.bench.comm.bcast(tuple(curves)), motions, self.clock.spent - start)

    def _from(self, motions, prepared, setting: Setting, level: float, omegas) -> tuple[Branch | None, list[Iterate]]:
        """Return the points solved from another setting's solutions; None if one does not converge."""
        problem, selection = self.bench.response(prepared, setting).at_level(level), prepared.reduction.selection
        workspace, branch, iterates = Workspace(problem.equation), Branch(level), []
        solver = PointSolver(problem, selection, range_of(omegas), setting.tolerance, workspace)
        try:
            for motion in motions:
                guess = motion.on(solver.harmonics)
                at_point = solver.solve_at(guess, solver.norm(guess.U), problem.equation.every_pair)
                if at_point[0].failure:
                    return None, []
                branch.points.append(point_record(problem, selection, at_point, requested=True)[0])
                iterates.append(at_point[0].iterate)
        finally:
            workspace.destroy()
        return branch, iterates

    def _computed(self, prepared, setting: Setting, level: float, omegas) -> tuple[Branch, list[Iterate]]:
        """Return the points, each solved from the preceding ones."""
        problem = self.bench.response(prepared, setting).at_level(level)
        branch = at_frequencies(problem, prepared.reduction.selection, list(omegas), tolerance=setting.tolerance)
        if branch.failure:
            raise ConvergenceError(f"no reference: {setting}, of {len(omegas)} points {branch.why_ended}")
        model = problem.equation.model
        motions = self.bench.comm.bcast([point.U for point in branch.points])
        owned = [model.recorded.carry(U[model.owned], model.harmonics) for U in motions]
        return branch, [Iterate(U, (point.omega,), model.harmonics) for U, point in zip(owned, branch.points)]


def find_reference(ladder: Ladder, base: Setting, share: float, note: Callable[[str], None], slips: bool = True) -> Reference:
    """Return the reference, as fine as needed or as the fraction ``share`` of the time allows.  Collective.

    Without slip (``slips`` False) the response is linear, and the harmonics and samples of ``base`` are exact.

    Raises
    ------
    ConvergenceError : the reference has no curve; on every rank
    """
    bench, clock, began = ladder.bench, ladder.clock, ladder.clock.spent
    start = replace(base, samples=FINE, tolerance=TOLERANCE)
    by_harmonics, why_H = _more_harmonics(ladder, start, share) if slips else ([ladder.rung(start)], LINEAR)
    goal = max(ENOUGH, EVEN * _rest(bench, by_harmonics))
    coarse = next((rung for rung in by_harmonics if rung.setting.harmonics >= CHECKED_AT), by_harmonics[-1])
    samples = [SAMPLES * 2**k for k in range(20) if 2 * coarse.setting.harmonics < SAMPLES * 2**k <= MOST_SAMPLES]
    by_samples, why_N = _raised(ladder, coarse, "samples", samples, goal, share) if slips else ([coarse], LINEAR)
    numbers = [len(bench.modes.omega_n)] if bench.has_all_modes else mode_numbers(bench)
    by_modes, _ = _raised(ladder, coarse, "modes", numbers, -1.0, 2.0)
    best = replace(
        by_harmonics[-1].setting,
        samples=max(by_samples[-1].setting.samples, by_harmonics[-1].setting.samples),
        modes=by_modes[-1].setting.modes,
    )
    reference = by_harmonics[-1] if best == by_harmonics[-1].setting else ladder.rung(best, by_harmonics[-1])
    checks = [_check("harmonics", by_harmonics), _check("samples", by_samples)] if slips else []
    checks += [] if bench.has_all_modes else [_check("modes", by_modes)]
    for check in checks:
        note(
            f"  reference, {check.parameter} {', '.join(map(str, check.values))}: changes of "
            f"{', '.join(f'{step:.1e}' for step in check.steps)} of the peak"
        )
    known = uncertainty([[rung.curves for rung in rungs] for rungs in (by_harmonics, by_samples, by_modes)], reference.curves)
    why_m = "all there are" if bench.has_all_modes else "as many as were computed"
    why = f"harmonics: {why_H}; samples: {why_N}; modes: {why_m}"
    return Reference(best, {curve.level: curve for curve in bench.comm.bcast(known)}, tuple(checks), clock.spent - began, why)


def _more_harmonics(ladder: Ladder, start: Setting, share: float) -> tuple[list[Rung], str]:
    """Return the rungs of harmonics, up to sufficient accuracy or the time limit, and the reason of the end."""
    numbers = [H for H in RUNGS if H >= ladder.bench.least_harmonics] or [ladder.bench.least_harmonics]
    rungs: list[Rung] = []
    for H in numbers:
        if len(rungs) > 1:
            growth = max(GROWTH, rungs[-1].seconds / max(rungs[-2].seconds, 1e-9)) if len(rungs) > 2 else GROWTH
            if (growth + AGAIN) * rungs[-1].seconds > ladder.clock.left(share):
                return rungs, "as many as the time allows"
        setting = replace(start, harmonics=H, samples=max(start.samples, 4 * (H + 1)))
        rungs.append(ladder.rung(setting, rungs[-1] if rungs else None))
        if len(rungs) > 2 and _rest(ladder.bench, rungs) <= ENOUGH:
            return rungs, "enough"
    return rungs, "as many as are tried"


def _raised(
    ladder: Ladder, below: Rung, parameter: str, values: Sequence[int], goal: float, share: float
) -> tuple[list[Rung], str]:
    """Return rungs of a setting, starting from another solution, up to sufficient accuracy, and the reason of the end."""
    rungs: list[Rung] = []
    for value in values:
        if len(rungs) > 2 and 2.0 * rungs[-1].seconds > ladder.clock.left(share):
            return rungs, "as many as the time allows"
        rungs.append(ladder.rung(below.setting.varied(parameter, value), rungs[-1] if rungs else below))
        if len(rungs) > 2 and _rest(ladder.bench, rungs) <= goal:
            return rungs, "enough"
    return rungs, "as many as are tried"


def _rest(bench: Bench, rungs: Sequence[Rung]) -> float:
    """Return the estimated effect of further rungs relative to the peak."""
    return bench.comm.bcast(_check("", rungs).rest)


def _check(parameter: str, rungs: Sequence[Rung]) -> Check:
    """Return the changes of the response from rung to rung.  Local."""
    steps = tuple(difference(low.curves, high.curves) for low, high in zip(rungs, rungs[1:]))
    return Check(parameter, tuple(getattr(rung.setting, parameter) if parameter else 0 for rung in rungs), steps)


def mode_numbers(bench: Bench) -> list[int]:
    """Return a quarter, half and all of the computed modes, at least enough to include the mode of the range.  Local."""
    most, least = len(bench.modes.omega_n), bench.least_modes
    return sorted({max(most // 4, least), max(most // 2, least), most})
