"""Both methods of the paper under many settings: the runs behind the page about its claims."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from paper_runs import ARC, EPSILON, EQUAL
from prepared import Prepared

from microslip.contact.law import STICK
from microslip.continuation.follow import follow_branch
from microslip.continuation.grid import advancing, at_frequencies
from microslip.continuation.task import BranchTask
from microslip.fourier.coefficients import amplitude
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.balance import HarmonicBalance
from microslip.points.selection import AllPairs, DissipatingPairs, NonStickingPairs

REFERENCE, ORIGINAL, IMPROVED = "reference", "original", "improved"
TIE = 1e-6  # of the peak: differences up to this are equal
NEAR = 1e-12  # relative shift of the frequency of a second solve


@dataclass(frozen=True)
class Setting:
    """One way to run both methods."""

    points: int  # requested
    rule: str = ARC
    down: bool = False  # from the end of the range to its start
    start: float = 0.0  # phase of the load at the first sample, where the sliders start [degrees]
    harmonics: int | None = None  # the scene's unless given
    tolerance: float | None = None  # of Newton; the scene's unless given
    slack: float = 0.0  # of mu N0: the original retains pairs with a larger dp
    settled: bool = False  # the original retains pairs by their state in the last period, without the settling
    again: bool = False  # also solve every point a second time

    @property
    def name(self) -> str:
        """Return the setting in words."""
        parts = [f"{self.points} {self.rule}" + (", downwards" if self.down else "")]
        parts += [f"sliders start at {self.start:g}\u00b0 of the load"] if self.start else []
        parts += [f"H = {self.harmonics}"] if self.harmonics else []
        parts += [f"Newton's tolerance {self.tolerance:g}"] if self.tolerance else []
        parts += [f"original retains \u0394p over {100.0 * self.slack:g} % of \u03bc N0"] if self.slack else []
        parts += ["original retains what slips or opens in the last period"] if self.settled else []
        return parts[-1]

    def of(self, method: str) -> Setting:
        """Return the part of the setting that affects a method."""
        if method == REFERENCE:
            return Setting(self.points, self.rule, self.down, self.start, self.harmonics)
        alone = replace(self, again=False)
        return replace(alone, slack=0.0, settled=False) if method == IMPROVED else alone


def settings(usual: int) -> list[Setting]:
    """Return the settings tried: that of the case study first, then one thing changed at a time."""
    return [
        Setting(usual, again=True),
        Setting(25),
        Setting(usual, down=True),
        *(Setting(n, EQUAL, again=n > 25) for n in (20, 25, 36, 50, 98, 200)),
        *(Setting(n, EQUAL, down=True) for n in (20, 25, 98)),
        *(Setting(usual, tolerance=tolerance) for tolerance in (1e-2, 1e-3)),
        Setting(usual, start=90.0),
        Setting(usual, harmonics=1),
        Setting(usual, settled=True),
        *(Setting(usual, slack=slack) for slack in (0.01, 0.03, 0.1, 0.3)),
    ]


@dataclass(frozen=True)
class Errors:
    """Errors of one method under a setting."""

    omega: np.ndarray  # (n,) rad/s, in the order of the sweep
    error: np.ndarray  # (n,) largest difference of any harmonic from the reference, over its peak
    peak: float  # relative error of the peak of the first output
    failure: str | None

    @property
    def largest(self) -> float:
        return float(self.error.max(initial=0.0))


@dataclass(frozen=True)
class Trial:
    """One setting at one level."""

    setting: Setting
    level: float  # N
    solved: int  # points
    original: Errors
    improved: Errors
    original_again: Errors | None
    improved_again: Errors | None

    @property
    def better(self) -> str:
        """Return the method with the smaller largest error, both updated once a point."""
        return judged(self.improved, self.original)


@dataclass(frozen=True)
class Own:
    """The highest point of each method's curve, each with its own arc-length steps."""

    level: float  # N
    requested: int  # points
    solved: dict[str, int]  # points, by method
    peak: dict[str, float]  # over the peak of the reference in the finest of such curves, less 1


def judged(improved: Errors | None, original: Errors | None) -> str:
    """Return which of two errs less on the curve; a dash if neither does, or if one stopped early."""
    if improved is None or original is None or improved.failure or original.failure:
        return "\u2013"
    difference = improved.largest - original.largest
    return "\u2013" if abs(difference) < TIE else ORIGINAL if difference > 0.0 else IMPROVED


# -- the sets B ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Settled(NonStickingPairs):
    """The pairs that slip or open in the last period of the last solution."""

    def update(self, moves: np.ndarray, state: np.ndarray, energy: np.ndarray) -> np.ndarray:
        return state != STICK


@dataclass(frozen=True, kw_only=True)
class LargerThan(NonStickingPairs):
    """The pairs with more of dp than ``limit`` (n_pairs,) [N] in the last solution; ``size`` returns dp, (n_pairs,) [N]."""

    size: Callable[[], np.ndarray]
    limit: np.ndarray

    def update(self, moves: np.ndarray, state: np.ndarray, energy: np.ndarray) -> np.ndarray:
        return moves & (self.size() > self.limit)


@dataclass(frozen=True, eq=False)
class Overheard(HarmonicBalance):
    """The equation, which stores p of all pairs at the last motion at which all were evaluated."""

    last: dict[str, np.ndarray] = field(default_factory=dict)

    def contact_forces(self, U, selected, *args, **options):
        forces = super().contact_forces(U, selected, *args, **options)
        if selected.all():
            self.last["p"] = self.full_force(forces)
        return forces

    def size(self) -> np.ndarray:
        """Return the largest coefficient of p of each pair, (n_pairs,) [N]."""
        return np.abs(self.last["p"]).reshape(self.model.n_pairs, -1).max(axis=1)


def run_of(method: str, setting: Setting, prepared: Prepared, level: float):
    """Return the problem and the set B of a method under a setting."""
    problem = prepared.problem(level)
    if method == REFERENCE:
        return problem, AllPairs()
    if method == IMPROVED:
        return problem, DissipatingPairs(energy_tolerance=EPSILON)
    if setting.slack:
        pairs, equation = prepared.structure.pairs, problem.equation
        heard = Overheard(equation.model, equation.law, equation.n_samples)
        return problem.with_equation(heard), LargerThan(size=heard.size, limit=setting.slack * pairs.mu * pairs.N0)
    return problem, Settled() if setting.settled else NonStickingPairs()


# -- the runs -----------------------------------------------------------------------------------------------------------


class Trials:
    """The runs of one level; runs common to several settings are done once."""

    def __init__(self, prepared: Prepared, level: float):
        self.prepared, self.level, self.tolerance = prepared, level, prepared.scene.solver.tolerance
        self._branches: dict = {}
        self._curves: dict = {}

    def trial(self, setting: Setting) -> Trial:
        """Run both methods under a setting, and the reference at the same frequencies."""
        exact = self.branch(REFERENCE, setting)
        once = [self.compared(method, setting, exact) for method in (ORIGINAL, IMPROVED)]
        again = [self.compared(method, setting, exact, 2) if setting.again else None for method in (ORIGINAL, IMPROVED)]
        return Trial(setting, self.level, len(exact.points), *once, *again)

    def branch(self, method: str, setting: Setting, times: int = 1):
        """Return one method's points, ``times`` at each frequency."""
        key = method, setting.of(method), times
        if key not in self._branches:
            prepared = changed(self.prepared, setting)
            problem, selection = run_of(method, setting, prepared, self.level)
            tolerance = self.tolerance if method == REFERENCE else setting.tolerance or self.tolerance
            omegas = repeated(self.frequencies(setting), times)
            self._branches[key] = at_frequencies(problem, selection, omegas, tolerance=tolerance)
        return self._branches[key]

    def frequencies(self, setting: Setting) -> list[float]:
        """Return the frequencies to solve at, in the order of the sweep [rad/s]."""
        sweep = self.prepared.sweep
        omegas = list(np.linspace(sweep.start, sweep.stop, setting.points)) if setting.rule == EQUAL else self.arc(setting.points)
        return omegas[::-1] if setting.down else omegas

    def arc(self, points: int) -> list[float]:
        """Return the frequencies that `receptance` reaches by arc length [rad/s]."""
        return advancing(self.curve(REFERENCE, points).points, self.prepared.sweep.direction)

    def curve(self, method: str, points: int):
        """Return the curve of a method with its own arc-length steps."""
        if (method, points) not in self._curves:
            problem, selection = run_of(method, Setting(points), self.prepared, self.level)
            task = BranchTask(problem, selection, self.prepared.sweep, self.prepared.steps_of(points), self.tolerance)
            self._curves[method, points] = follow_branch(task, 10 * points)
        return self._curves[method, points]

    def own(self, requested: Sequence[int]) -> list[Own]:
        """Return the peaks of curves with each method's own steps, over the finest reference, for some numbers of points."""
        curves = {n: {method: self.curve(method, n) for method in (REFERENCE, ORIGINAL, IMPROVED)} for n in requested}
        tops = {n: {method: self.highest(curve) for method, curve in of.items()} for n, of in curves.items()}
        true = tops[max(requested)][REFERENCE]
        return [
            Own(
                self.level,
                n,
                {method: len(curve.points) for method, curve in curves[n].items()},
                {method: top / true - 1.0 for method, top in tops[n].items()},
            )
            for n in requested
        ]

    @staticmethod
    def highest(curve) -> float:
        return max(float(amplitude(point.response[0])) for point in curve.points)

    def compared(self, method: str, setting: Setting, exact, times: int = 1) -> Errors:
        """Return the errors of a method, of the last solution at each frequency."""
        branch = self.branch(method, setting, times)
        points = branch.points[times - 1 :: times]
        n = min(len(points), len(exact.points))
        own, true = (np.array([point.response for point in some]) for some in (points[:n], exact.points))
        error = (np.abs(own - true[:n]) / np.abs(true).max(axis=(0, 2))[:, None]).max(axis=(1, 2))
        peak = amplitude(own[:, 0]).max() / amplitude(true[:, 0]).max() - 1.0
        omega = np.array([point.omega for point in exact.points[:n]])
        return Errors(omega, error, float(peak), branch.failure or exact.failure)


def changed(prepared: Prepared, setting: Setting) -> Prepared:
    """Return the scene with the harmonics of a setting and the phase of its load shifted: sliders start at the first sample."""
    model = prepared.model
    if setting.start:
        f, turn = model.f.copy(), np.exp(1j * np.radians(setting.start))
        turned = (model.f[:, 1] - 1j * model.f[:, 2]) * turn
        f[:, 1], f[:, 2] = turned.real, -turned.imag
        model = replace(model, f=f)
    if setting.harmonics:
        model = model.with_harmonics(Harmonics.up_to(setting.harmonics))
    return replace(prepared, response=replace(prepared.response, model=model))


def repeated(omegas: Sequence[float], times: int) -> list[float]:
    """Repeat every frequency, each time shifted a little: two equal ones in a row have no secant."""
    return [omega * (1.0 + k * NEAR) for omega in omegas for k in range(times)]


def all_trials(
    prepared: Prepared, levels: Sequence[float], chosen: Sequence[Setting], own: Sequence[int], say: Callable[[str], None]
) -> tuple[list[Trial], list[Own]]:
    """Run settings at some levels, and curves with each method's own steps, for some numbers of points.  One rank."""
    trials, peaks = [], []
    for level in levels:
        runs = Trials(prepared, level)
        for setting in chosen:
            trials.append(runs.trial(setting))
            say(" | ".join(cells(trials[-1])))
        peaks += runs.own(own)
    return trials, peaks


def cells(trial: Trial) -> list[str]:
    """Return the cells of a trial in the table."""
    tried = [f"{curve.largest:.1e}" + (" (stopped)" if curve.failure else "") for curve in (trial.original, trial.improved)]
    peaks = [f"{curve.peak:+.1e}" for curve in (trial.original, trial.improved)]
    return [f"{trial.level:g}", trial.setting.name, str(trial.solved), *tried, *peaks, trial.better]
