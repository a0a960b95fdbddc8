"""Data of a trade: settings, times and errors, and results derived from them.  NumPy only; every function is local.

Errors are of the complex amplitude of harmonic 1 of the first output, relative to the reference's peak at the same level.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...points.peak import top_of_curve

PARAMETERS = ("harmonics", "samples", "modes", "tolerance", "eps", "method", "mesh")
KEYS = {parameter: parameter for parameter in PARAMETERS} | {"eps": "energy_tolerance"}  # keys of [solver] and of Setting
BASE, COMBINED, ACCURACY = "base", "combination", "accuracy"  # further kinds of runs
TARGETS = (1e-2, 1e-3, 1e-4)
MOST_GAIN = 4.0  # largest trusted factor between successive changes of a sequence of refinements
LEAST_GAIN = 1.25
ROUNDING = 1e-9  # of the peak: least uncertainty of a point


@dataclass(frozen=True)
class Setting:
    """The settings of a run; with ``accuracy`` harmonics, samples and tolerance are chosen and their values here ignored."""

    modes: int
    harmonics: int
    samples: int
    tolerance: float = 1e-8
    method: str = "receptance"
    energy_tolerance: float | None = None  # J per cycle and pair; adaptive-energy
    accuracy: float | None = None
    accuracy_of: str = "amplitude"  # or "corrected"
    mesh: str | None = None  # mesh file, if not the scene's

    def table(self) -> str:
        """Return the setting as the table [solver] of a scene."""
        lines = ["[solver]", f'method = "{self.method}"', f"modes = {self.modes}"]
        if self.accuracy is None:
            lines += [f"harmonics = {self.harmonics}", f"samples = {self.samples}"]
        else:
            lines.append(f"accuracy = {self.accuracy:g}")
            lines += [f'accuracy_of = "{self.accuracy_of}"'] if self.is_corrected else []
        if self.energy_tolerance is not None:
            lines.append(f"energy_tolerance = {self.energy_tolerance:g}")
        if self.accuracy is None:
            lines.append(f"tolerance = {self.tolerance:g}")
        return "\n".join(lines)

    @property
    def is_corrected(self) -> bool:
        """Whether the corrected amplitude is used."""
        return self.accuracy_of == "corrected"

    def varied(self, parameter: str, value: Any) -> Setting:
        """Return the setting with another value of a parameter."""
        return replace(self, **{KEYS[parameter]: value})

    def __str__(self) -> str:
        if self.accuracy is not None:
            return f"accuracy {self.accuracy:g}{' of the corrected amplitude' if self.is_corrected else ''}"
        head = "" if self.method == "receptance" else f"{self.method}, "
        head += "" if self.energy_tolerance is None else f"eps {self.energy_tolerance:g} J, "
        return f"{head}{self.modes} modes, H = {self.harmonics}, N_t = {self.samples}, tolerance {self.tolerance:g}"


@dataclass(frozen=True)
class Curve:
    """The amplitude of a run at the frequencies of one level, and its error bar."""

    level: float  # N
    omega: np.ndarray  # (n,) rad/s
    u: np.ndarray  # (n,) complex, m
    bar: np.ndarray  # (n,) m; nan where not estimated

    @property
    def peak(self) -> float:
        """The largest amplitude [m]."""
        return float(np.abs(self.u).max(initial=0.0))


@dataclass(frozen=True)
class Run:
    """Time and results of one setting."""

    parameter: str  # a key of PARAMETERS, or BASE, COMBINED, ACCURACY
    value: str  # value of the parameter
    setting: Setting
    setup: float  # s: modes and reduction, without the shared set-up
    seconds: float  # s of wall time of the response at all frequencies of all levels, without error bars
    cpu: float  # s of processor time of one rank
    seconds_with_bars: float  # s of wall time
    cpu_with_bars: float  # s of processor time
    unknowns: int  # largest number at any point
    curves: tuple[Curve, ...]
    failure: str | None = None
    corrected: tuple[Curve, ...] = ()  # corrected amplitudes, for a run with error bars

    @property
    def cost(self) -> float:
        """The processor time of the response [s], used to rank runs because other load on the machine affects it least."""
        return self.cpu

    @property
    def n_points(self) -> int:
        """The number of points of all curves."""
        return sum(len(curve.omega) for curve in self.curves)


@dataclass(frozen=True)
class Check:
    """Coarser runs on the way to the reference, in one parameter."""

    parameter: str
    values: tuple[int, ...]  # values of the parameter, ascending up to the reference
    steps: tuple[float, ...]  # largest change of the response between successive values, relative to the peak

    @property
    def rest(self) -> float:
        """Estimated effect of further refinement: sum of a geometric series with the observed, bounded gain."""
        return remainder(self.steps)


def remainder(steps: Sequence[float]) -> float:
    """Return the remainder of a sequence of refinements: the last change over gain - 1."""
    return steps[-1] / (gain_of(steps) - 1.0) if steps else 0.0


def gain_of(steps: Sequence[float]) -> float:
    """Return the factor by which successive changes decrease, bounded; 2 for a single change."""
    if len(steps) < 2:
        return 2.0
    return float(min(max(steps[-2] / steps[-1], LEAST_GAIN), MOST_GAIN)) if steps[-1] > 0.0 else MOST_GAIN


def uncertainty(rungs: Sequence[Sequence[Sequence[Curve]]], reference: Sequence[Curve]) -> tuple[Curve, ...]:
    """Return the reference's curves with the uncertainty of each point as its bar [m].

    ``rungs`` are the curves of each sequence of refinements.  The largest last change at a point and its neighbours is
    extrapolated with the gain of the level; the sequences are added.
    """
    curves = []
    for i, curve in enumerate(reference):
        known = ROUNDING * curve.peak * np.ones(len(curve.omega))
        for sequence in rungs:
            steps = [np.abs(low[i].u - high[i].u) for low, high in zip(sequence, sequence[1:])]
            if steps:
                last = np.pad(steps[-1], 1, mode="edge")
                widest = np.maximum(last[1:-1], np.maximum(last[:-2], last[2:]))
                known += widest / (gain_of([step.max(initial=0.0) for step in steps]) - 1.0)
        curves.append(replace(curve, bar=known))
    return tuple(curves)


@dataclass(frozen=True)
class Reference:
    """The reference run of all errors, and its uncertainty."""

    setting: Setting
    curves: Mapping[float, Curve]  # by level; the bars are their uncertainty
    checks: tuple[Check, ...]
    seconds: float  # s, including the checks
    why: str  # reason why it is not finer

    @property
    def floor(self) -> float:
        """The largest uncertainty of the reference relative to its peak."""
        return max(float((curve.bar / (curve.peak or 1.0)).max(initial=0.0)) for curve in self.curves.values())


@dataclass(frozen=True)
class Score:
    """The errors of a run."""

    error: float = np.nan  # largest error of all points
    rms: float = np.nan
    peak: float = np.nan  # error of the peak amplitude
    frequency: float = np.nan  # relative error of the peak frequency
    bar: float = np.nan  # largest bar of all points
    coverage: float = np.nan  # fraction below their bar of the points with an error above the reference's uncertainty
    ratio: float = np.nan  # median of bar over error at these points
    n_above: int = 0  # number of these points

    @property
    def is_known(self) -> bool:
        """Whether there is an error."""
        return bool(np.isfinite(self.error))


@dataclass
class Study:
    """All that was measured on one scene."""

    title: str
    name: str
    reference: Reference
    base: Setting
    runs: list[Run] = field(default_factory=list)
    meshes: list[Run] = field(default_factory=list)  # errors relative to the finest mesh, the last one
    shared: dict[str, float] = field(default_factory=dict)  # s of the shared set-up, by stage
    notes: list[str] = field(default_factory=list)
    is_linear: bool = False  # no pair slips or opens at any point

    def __post_init__(self):
        self._scores: dict[int, Score] = {}

    def score(self, run: Run) -> Score:
        """Return the errors of a run, cached."""
        if id(run) not in self._scores:
            self._scores[id(run)] = score(run.curves, self.reference.curves)
        return self._scores[id(run)]

    @property
    def complete(self) -> list[Run]:
        """The runs that reached every frequency."""
        return [run for run in self.runs if run.failure is None and self.score(run).is_known]

    @property
    def run_of_base(self) -> Run | None:
        """The run of the base setting, if complete."""
        return next((run for run in self.complete if run.parameter == BASE), None)

    def error_of_corrected(self, curves: Sequence[Curve]) -> float:
        """Return the largest error of corrected amplitudes; nan without corrected amplitudes."""
        return score(curves, self.reference.curves).error

    def sweep(self, parameter: str) -> list[Run]:
        """Return the complete runs of a parameter, with the base run if it belongs to them, in the order of their values."""
        runs = [run for run in self.complete if run.parameter == parameter]
        if parameter in ("harmonics", "samples", "modes", "tolerance"):
            runs += [run for run in self.complete if run.parameter == BASE]
            key = KEYS[parameter]
            by_value = {getattr(run.setting, key): run for run in runs}
            return [by_value[value] for value in sorted(by_value, reverse=parameter == "tolerance")]
        return sorted(runs, key=lambda run: -(run.setting.energy_tolerance or 0.0)) if parameter == "eps" else runs

    def parameter_error(self, run: Run, parameter: str) -> float:
        """Return the error of a single parameter: relative to its finest value, for harmonics relative to the reference."""
        if parameter not in PARAMETERS:
            return np.nan
        sweep = self.sweep(parameter)
        if parameter in ("harmonics", "method") or not sweep:
            return self.score(run).error
        if parameter == "eps":
            return difference(run.curves, self.run_of_base.curves) if self.run_of_base is not None else np.nan
        return difference(run.curves, sweep[-1].curves)

    def front(self) -> list[Run]:
        """Return the Pareto front in cost and error, with errors rounded to two significant digits, by ascending cost."""
        runs = self.complete
        if not runs:
            return []
        errors = [float(f"{max(self.score(run).error, self.reference.floor):.1e}") for run in runs]
        best = pareto(np.array([run.cost for run in runs]), np.array(errors))
        return sorted((run for run, is_best in zip(runs, best) if is_best), key=lambda run: run.cost)

    def ordered(self) -> list[Run]:
        """Return the runs sorted by kind and by the values of their parameters."""
        kinds = [BASE, *PARAMETERS, ACCURACY, COMBINED]
        return sorted(self.runs, key=lambda run: (kinds.index(run.parameter), _place(run)))

    def choice(self, target: float) -> Run | None:
        """Return the run with the least time, set-up included, whose sure error is within ``target``; None without one."""
        good = [run for run in self.complete if self.sure_error(run) + self.reference.floor <= target]
        return min(good, key=lambda run: run.cost + run.setup) if good else None

    @property
    def most_accurate(self) -> Run | None:
        """The run with the smallest sure error; None without a complete one."""
        return min(self.complete, key=self.sure_error, default=None)

    def is_undecided(self, target: float) -> bool:
        """Return whether the reference is too inaccurate to tell if a run without choice is within ``target``."""
        best, floor = self.most_accurate, self.reference.floor
        return best is not None and (floor > target or self.sure_error(best) - floor <= target)

    def best_fixed(self, target: float) -> Run | None:
        """Return the run of fixed settings with the least processor time within ``target``; None without one."""
        good = [
            run
            for run in self.complete
            if run.setting.accuracy is None and self.score(run).error <= max(target, self.reference.floor)
        ]
        return min(good, key=lambda run: run.cost) if good else None

    def sure_error(self, run: Run) -> float:
        """Return the larger of the error of a run and the error of its parameter, because errors may cancel at single points."""
        return max(self.score(run).error, float(np.nan_to_num(self.parameter_error(run, run.parameter))))

    def validation(self) -> Score:
        """Return coverage and ratio over the points of all runs."""
        return score([curve for run in self.runs for curve in run.curves], self.reference.curves)


def _place(run: Run) -> float:
    """Return the sort key of a run among runs of its parameter, coarse before fine."""
    setting = run.setting
    if run.parameter in ("harmonics", "samples", "modes"):
        return getattr(setting, run.parameter)
    falling = {"tolerance": setting.tolerance, "eps": setting.energy_tolerance, ACCURACY: setting.accuracy}
    return run.cost if run.parameter == COMBINED else -(falling.get(run.parameter) or 0.0)


def score(curves: Sequence[Curve], exact: Mapping[float, Curve]) -> Score:
    """Return the errors of curves, point by point against the reference at the same level."""
    pairs = [(curve, exact[curve.level]) for curve in curves if len(curve.omega) and curve.level in exact]
    if not pairs:
        return Score()
    errors, bars, floors, peaks, frequencies = [], [], [], [], []
    for curve, reference in pairs:
        n = min(len(curve.omega), len(reference.omega))
        errors.append(np.abs(curve.u[:n] - reference.u[:n]) / (reference.peak or 1.0))
        bars.append(curve.bar[:n] / (reference.peak or 1.0))
        floors.append(np.nan_to_num(reference.bar[:n]) / (reference.peak or 1.0))
        if n == len(reference.omega):
            (omega, amplitude), (omega_exact, amplitude_exact) = (top_of_curve(c.omega, np.abs(c.u)) for c in (curve, reference))
            peaks.append(abs(amplitude / amplitude_exact - 1.0) if amplitude_exact else np.nan)
            frequencies.append(abs(omega / omega_exact - 1.0))
    error, bar = np.concatenate(errors), np.concatenate(bars)
    above = np.isfinite(bar) & (error > np.concatenate(floors))
    has_any = above.any()
    return Score(
        error=float(error.max()),
        rms=float(np.sqrt(np.mean(error**2))),
        peak=max(peaks, default=np.nan),
        frequency=max(frequencies, default=np.nan),
        bar=float(bar.max()),
        coverage=float(np.mean(error[above] <= bar[above])) if has_any else np.nan,
        ratio=float(np.median(bar[above] / error[above])) if has_any else np.nan,
        n_above=int(above.sum()),
    )


def difference(curves: Sequence[Curve], others: Sequence[Curve]) -> float:
    """Return the largest difference of curves at common points, relative to the peak of ``others``; nan without points."""
    by_level = {curve.level: curve for curve in others}
    worst = [np.nan]
    for curve in curves:
        other = by_level.get(curve.level)
        if other is not None and (n := min(len(curve.omega), len(other.omega))):
            worst.append(float(np.abs(curve.u[:n] - other.u[:n]).max() / (other.peak or 1.0)))
    return float(np.nanmax(worst)) if len(worst) > 1 else np.nan


def pareto(cost: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return which of n settings are not dominated in cost and error, (n,) bool."""
    order = np.lexsort((error, cost))
    best, is_best = np.inf, np.zeros(len(cost), dtype=bool)
    cost_of_best = -np.inf
    for i in order:
        if error[i] < best or (error[i] == best and cost[i] == cost_of_best):
            is_best[i], best, cost_of_best = True, error[i], cost[i]
    return is_best


def predicted(study: Study, parameters: Sequence[str]) -> list[tuple[Setting, float, float]]:
    """Return all combinations of individually run values: setting, predicted seconds and predicted error.

    Each parameter is assumed to multiply the time and to add its error.
    """
    base = study.run_of_base
    if base is None:
        return []
    combinations = [(study.base, base.cost, 0.0)]
    for parameter in parameters:
        sweep = study.sweep(parameter)
        if not sweep:
            continue
        options = [
            (getattr(run.setting, KEYS[parameter]), run.cost / base.cost, study.parameter_error(run, parameter)) for run in sweep
        ]
        combinations = [
            (setting.varied(parameter, value), seconds * factor, error + added)
            for setting, seconds, error in combinations
            for value, factor, added in options
        ]
    return [entry for entry in combinations if entry[0].samples > 2 * entry[0].harmonics]


def promising(study: Study, parameters: Sequence[str], most: int) -> list[Setting]:
    """Return at most ``most`` new combinations: the cheapest predicted for each of ``TARGETS``, then of the Pareto front."""
    combinations = predicted(study, parameters)
    if not combinations:
        return []
    seconds, error = np.array([entry[1] for entry in combinations]), np.array([entry[2] for entry in combinations])
    front = [combinations[i] for i in np.flatnonzero(pareto(seconds, error))]
    front.sort(key=lambda entry: entry[1])
    first = [
        min(good, key=lambda entry: entry[1])
        for target in TARGETS
        for share in (1.0, 0.5)
        if (good := [entry for entry in front if entry[2] <= share * target])
    ]
    spread = [front[i] for i in np.unique(np.linspace(0, len(front) - 1, most).round().astype(int))]
    known = {run.setting for run in study.runs}
    chosen = [setting for setting, _, _ in dict.fromkeys([*first, *spread]) if setting not in known]
    return chosen[:most]
