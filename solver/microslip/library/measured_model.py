"""Measured rows, computed by a structure with other numbers: points of a curve or peaks, with their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..contact.law import STICK
from ..continuation.grid import solved_at, task_at
from ..continuation.levels import ResponseProblem, follow_level, response_problem
from ..continuation.peak_at import PeakPoint, Starts, peak_near
from ..continuation.peak_curves import linear_peaks
from ..continuation.point_record import HELD
from ..continuation.tops import maxima
from ..continuation.ways_out import MOSTLY
from ..formats.measured import Measured
from ..fourier.harmonics import Harmonics
from ..harmonic.balance import HarmonicBalance
from ..messages.errors import ConvergenceError
from ..points.branch import Branch
from ..points.sensitivities import of_size
from ..receptance.other_springs import with_springs
from ..receptance.springs import SpringChange
from ..results.sensitivities import Varied
from .build import Structure
from .fitted_numbers import Fitted
from .prepare import prepare
from .respond import scene_with
from .sample_peaks import UNKNOWN_WIDTH, starts_at

if TYPE_CHECKING:
    from mpi4py import MPI

OF_AMPLITUDE, OF_PHASE, OF_FREQUENCY = 0.02, 0.03, 1e-3  # default deviations: of the largest amplitude; rad; of the frequency
SAME_WEIGHTS = 0.1  # relative change of these deviations at which the fit is left as it is
MOST_PRECISE = 1e-3  # of such a deviation before, at least, where the residuals vanish


class MeasuredModel:
    """The measured rows as the structure has them at values of the numbers.  Collective."""

    def __init__(self, structure: Structure, scene: Any, rows: Measured, fitted: Sequence[Fitted]):
        self.structure, self.scene, self.rows, self.fitted = structure, scene, rows, list(fitted)
        self.evaluations, self.failure = 0, ""
        stated = np.stack([rows.deviation, rows.deviation_of_phase, rows.deviation_of_frequency])
        largest = np.array([np.nanmax(rows.amplitude[rows.output == k], initial=0.0) for k in rows.output])
        usual = np.stack([OF_AMPLITUDE * largest, np.full(rows.n, OF_PHASE), OF_FREQUENCY * rows.frequency])
        self.deviations = np.where(np.isfinite(stated), stated, usual)
        target = np.stack([rows.amplitude, rows.phase, rows.frequency if rows.of_peaks else np.full(rows.n, np.nan)])
        self.target, self.counts = target, np.isfinite(target)
        self.is_stated = np.isfinite(stated)[self.counts]  # (n_residuals,) bool, the deviation
        kind = np.nonzero(self.counts)[0]
        self.unstated = [rows for k in range(3) if (rows := ~self.is_stated & (kind == k)).any()]  # (n_residuals,) bool each
        self._known: tuple[bytes, np.ndarray, np.ndarray] | None = None
        self._peaks: dict[tuple[float, int, float], _KnownPeak] = {}
        self.fit = rows

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Return the residuals over their deviations; inf where there is no response."""
        return self._at(x)[0]

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Return their derivatives by x, (n_residuals, k)."""
        return self._at(x)[1]

    def reweigh(self, variance: np.ndarray) -> bool:
        """Update unstated deviations by the ``variance`` of residuals (n_residuals,); return whether they change.  Local.

        Without stated deviations only their ratios count, and the largest remains.
        """
        if len(self.unstated) + self.is_stated.any() < 2:
            return False
        scale = np.sqrt(variance if self.is_stated.any() else variance / max(variance.max(), 1e-300))
        scale = np.where(self.is_stated, 1.0, np.maximum(scale, MOST_PRECISE))
        if np.abs(scale - 1.0).max() <= SAME_WEIGHTS:
            return False
        self.deviations[self.counts] *= scale
        if self._known is not None:
            x, residuals, jacobian = self._known
            self._known = x, residuals / scale, jacobian / scale[:, None]
        return True

    def _at(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._known is None or self._known[0] != x.tobytes():
            self.evaluations += 1
            try:
                computed = self._computed([each.value(x_i) for each, x_i in zip(self.fitted, x)])
            except (ConvergenceError, ValueError) as problem:
                self.failure = f"there is no response: {problem}"
                computed = np.full_like(self.target, np.inf), np.zeros((*self.target.shape, len(x)))
            self._known = (x.tobytes(), *self.structure.comm.bcast(self._as_residuals(x, *computed)))
        return self._known[1], self._known[2]

    def _as_residuals(self, x: np.ndarray, values: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        difference = values - self.target
        with np.errstate(invalid="ignore"):
            difference[1] = np.where(np.isfinite(difference[1]), np.angle(np.exp(1j * difference[1])), difference[1])
        self.fit = replace(self.rows, amplitude=values[0], phase=values[1], frequency=values[2])
        by_x = [each.value(x_i) if each.is_log else 1.0 for each, x_i in zip(self.fitted, x)]
        scaled = rates * by_x / self.deviations[:, :, None]
        return (difference / self.deviations)[self.counts], scaled[self.counts]

    def _computed(self, values: list[float]) -> tuple[np.ndarray, np.ndarray]:
        """Return amplitude, phase and frequency of the rows, (3, n), and their derivatives by the numbers, (3, n, k)."""
        of, varied = self._problem(values), [
            replace(each.varied, weights=np.array(1.0 / value)) if each.varied.number == "damping" else each.varied
            for each, value in zip(self.fitted, values)
        ]  # fmt: skip
        responses, rates = np.zeros((3, self.rows.n)), np.zeros((3, self.rows.n, len(values)))
        for level in np.unique(self.rows.level):
            chosen = np.flatnonzero(self.rows.level == level)
            rows = self.rows.rows(chosen)
            at = _peaks_near(of, level, rows, varied, self._peaks) if rows.of_peaks else _points_at(of, level, rows, varied)
            responses[:, chosen], rates[:, chosen] = at
        return responses, rates

    def _problem(self, values: list[float]) -> ResponseProblem:
        """Return the problem with these values; contact stiffness by (4.7)."""
        ratio = [value for each, value in zip(self.fitted, values) if each.varied.number == "damping"]
        scene = scene_with(self.scene, {"ratio": ratio[0]}, {}) if ratio else self.scene
        prepared = prepare(self.structure, scene, has_bars=False)
        law, model = prepared.response.law, prepared.model
        for each, value in zip(self.fitted, values):
            varied = each.varied
            if varied.number != "damping":
                law = law.with_parameters(varied.number, varied.pairs, value * varied.weights)
        K_J = law.stiffness.ravel()
        dK = K_J - prepared.response.law.stiffness.ravel()
        if dK.any():
            model = with_springs(model, SpringChange(dK, K_J, model.stated_damping))
        settings = replace(prepared.response.settings, peaks=False, stability=False, sensitivities=False, accuracy=None, at=())
        if not self.rows.of_peaks:
            return replace(prepared.response, settings=settings, model=model, law=law, enriched=None)
        return response_problem(settings, model, law, prepared.response.selection, self.structure.excited.omega_n)


def _points_at(of: ResponseProblem, level: float, rows: Measured, varied: Sequence[Varied]) -> tuple[np.ndarray, np.ndarray]:
    """Return amplitude, phase and frequency of rows of a level (3, n), and their derivatives (3, n, k).  Collective."""
    omegas, place = np.unique(2.0 * np.pi * rows.frequency, return_inverse=True)
    order = slice(None, None, -1) if of.settings.direction == "down" else slice(None)
    problem = replace(of.at_level(level), equation=HarmonicBalance.of_all(of.model, of.law, of.settings.samples))
    task = replace(task_at(problem, of.selection, list(omegas[order]), of.settings.tolerance), has_sensitivities=True)
    branch: Branch = solved_at(task, list(omegas[order]))
    if branch.failure or len(branch.points) < len(omegas):
        raise ConvergenceError(branch.failure or "points are missing")
    points = branch.points[order]
    responses, rates = np.zeros((3, rows.n)), np.zeros((3, rows.n, len(varied)))
    for i, (j, k) in enumerate(zip(place, rows.output)):
        cos, sin = points[j].response[k, 1:3]
        responses[:, i] = np.hypot(cos, sin), np.arctan2(-sin, cos), rows.frequency[i]
        for m, each in enumerate(varied):
            d_cos, d_sin = each.rate(points[j].by_pairs[k], points[j].by_common[k])
            rates[:2, i, m] = of_size(cos, sin, d_cos, d_sin)
    return responses, rates


@dataclass(frozen=True, eq=False)
class _KnownPeak:
    """Where the search for the peak of a row begins: a peak with other values of the numbers, or the top of a curve."""

    starts: Starts
    harmonics: Harmonics
    n_samples: int
    is_held: bool  # its mean slip, by springs
    width: float  # rad/s, of the linear peak
    share: float  # of the pairs that do not stick

    def peak(self, of: ResponseProblem, level: float, output: int) -> PeakPoint | str:
        """Return the smooth peak near by with its derivatives, or why there is none.  Collective."""
        problem = of.at_level(level)
        equation = problem.equation.resolved(self.harmonics, self.n_samples)
        equation = equation.holding(np.zeros((equation.n_owned, 2)) if self.is_held else None)
        forced, tolerance = problem.with_equation(equation), of.settings.tolerance
        return peak_near(forced, output, self.starts, self.width, tolerance, needs_width=lambda point: False, has_rates=True)

    def at(self, peak: PeakPoint, comm: MPI.Comm) -> _KnownPeak:
        """Return it with a peak as the next guess.  Collective."""
        share = comm.bcast(float((peak.point.state != STICK).mean()))
        return replace(self, starts=(peak.iterate, None, None), share=share)


def _near_on_curve(of: ResponseProblem, level: float, branch: Branch, output: int, omega: float) -> _KnownPeak:
    """Return the top of a curve nearest to a frequency.  Collective.  ConvergenceError without one."""
    tops = of.model.comm.bcast([i for k, i in maxima(branch) if k == output])
    if not tops:
        raise ConvergenceError(
            branch.failure or f"at {level:g} N output {output + 1} has no peak within the range of frequencies"
        )
    top = min(tops, key=lambda i: abs(branch.points[i].omega - omega))
    here = branch.points[top].omega
    linear = min(linear_peaks(of, of.model, output), key=lambda peak: abs(peak.omega - here), default=None)
    width = UNKNOWN_WIDTH * here if linear is None else linear.width
    return _KnownPeak(*starts_at(of, level, branch, output, top), HELD in branch.points[top].notes, width, 0.0)


def _peaks_near(
    of: ResponseProblem, level: float, rows: Measured, varied: Sequence[Varied], known: dict[tuple[float, int, float], _KnownPeak]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the same of the peaks nearest to the rows, from those ``known`` by level, output and frequency.  Collective.

    Along a curve where one is not known, Newton's method fails, or springs begin or cease to hold its mean slip.
    """
    comm, branch = of.model.comm, None
    responses, rates = np.zeros((3, rows.n)), np.zeros((3, rows.n, len(varied)))
    for i, (frequency, k) in enumerate(zip(rows.frequency, rows.output)):
        key = level, int(k), float(frequency)
        near = known.get(key)
        peak = near.peak(of, level, int(k)) if near else ""
        there = None if near is None or isinstance(peak, str) else near.at(peak, comm)
        if near is None or there is None or (near.share < MOSTLY) != (there.share < MOSTLY):
            branch = branch or follow_level(of, level)
            near = _near_on_curve(of, level, branch, int(k), 2.0 * np.pi * frequency)
            peak = near.peak(of, level, int(k))
            there = None if isinstance(peak, str) else near.at(peak, comm)
        if isinstance(peak, str) or there is None or peak.by_pairs is None or peak.by_common is None:
            why = peak if isinstance(peak, str) else "no solutions next to it"
            raise ConvergenceError(f"at {level:g} N, output {k + 1}, the peak near {frequency:.6g} Hz: {why}")
        known[key] = there
        cos, sin = comm.bcast(peak.point.response[k, 1:3])
        responses[:, i] = peak.amplitude, np.arctan2(-sin, cos), peak.iterate.parameter / (2.0 * np.pi)
        rates[:, i] = np.array([each.rate(peak.by_pairs, peak.by_common) for each in varied]).T
    return responses, rates
