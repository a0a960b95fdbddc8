"""Timed runs of settings at given frequencies, on one structure with its modes."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from ...continuation.accuracy import Accuracy, accuracy_of
from ...continuation.grid import solved_at, task_at
from ...continuation.levels import ResponseProblem, frequency_sweep
from ...continuation.problems import ForcedResponse
from ...continuation.settings import ResponseSettings
from ...error_estimate.correction import Estimate
from ...error_estimate.estimate import ErrorEstimator
from ...fourier.harmonics import Harmonics
from ...library.build import Structure
from ...library.prepare import Prepared, prepare
from ...library.settings import reduction_settings, response_settings
from ...messages.errors import MicroslipError
from ...modes.eigen import Modes, first_of
from ...points.branch import Branch, Point
from ...points.error_parts import total
from ...receptance.truncated_modes import EnrichedModel
from ...scene.read import changed
from ...scene.schema import Scene
from .study import Curve, Run, Setting

SHORT = 1.0  # s: a shorter response is solved again, and the smaller time is used


class Clock:
    """The remaining time, the same on all ranks."""

    def __init__(self, comm: MPI.Comm, seconds: float):
        self.comm, self.seconds, self._start = comm, seconds, time.perf_counter()

    @property
    def spent(self) -> float:
        """Seconds since the start.  Collective: one broadcast."""
        return self.comm.bcast(time.perf_counter() - self._start)

    def left(self, share: float = 1.0) -> float:
        """Return the seconds until the fraction ``share`` of the time is spent.  Collective: one broadcast."""
        return share * self.seconds - self.spent


class Bench:
    """Data shared by all runs.  Every method is collective on the structure's communicator."""

    def __init__(self, scene: Scene, structure: Structure):
        self.scene, self.structure = scene, structure
        self.comm = structure.comm
        settings = response_settings(scene)
        self.sweep = frequency_sweep(settings, structure.modes.omega_n)
        self.least_harmonics = settings.loaded
        self.modes: Modes = structure.modes
        self.has_all_modes = len(structure.modes.omega_n) == structure.n_dof
        highest = max(self.sweep.start, self.sweep.stop)
        in_range = int(np.count_nonzero(structure.modes.omega_n <= highest))
        self.least_modes = self.comm.bcast(max(settings.band.mode or 1, in_range))  # fewer modes miss a resonance
        self.modes_seconds: dict[int, float] = {}  # measured time by number of modes
        self._first: dict[int, Structure] = {}  # structures by number of modes
        self._prepared: dict[tuple, Prepared] = {}

    # -- set-up ------------------------------------------------------------------------------------------------

    def more_modes(self, n_modes: int) -> None:
        """Compute modes again if ``n_modes`` exceeds the present number, and measure the time."""
        modes, seconds = self._timed_modes(n_modes)
        self.modes_seconds[len(modes.omega_n)] = seconds
        n_dof = self.structure.n_dof
        self.has_all_modes = self.has_all_modes or n_modes == n_dof or len(modes.omega_n) < n_modes
        if len(modes.omega_n) > len(self.modes.omega_n):
            self.modes, self._first = modes, {}

    def _timed_modes(self, n_modes: int) -> tuple[Modes, float]:
        start = time.perf_counter()
        proves = reduction_settings(self.scene).verify_modes
        modes = self.structure.lowest_modes(n_modes, proves, allows_fewer=True)
        return modes, self.comm.bcast(time.perf_counter() - start)

    def setup_of_modes(self, n_modes: int) -> float:
        """Return the time of ``n_modes`` modes [s], interpolated linearly between measured values.  Local."""
        known = sorted(self.modes_seconds.items())
        return float(np.interp(n_modes, [n for n, _ in known], [seconds for _, seconds in known])) if known else 0.0

    def prepared(self, setting: Setting) -> Prepared:
        """Return the prepared problem of a setting; reductions to the structure's modes and statics are cached.

        Raises
        ------
        CaseError, ConvergenceError, ResourceError : the method cannot be used here; on every rank
        """
        key = (setting.method, setting.modes)
        if key not in self._prepared:
            ready = self._prepare(setting)
            if ready.reduction.leaves_out == "basis":
                return ready
            self._prepared[key] = ready
        ready = self._prepared[key]
        if setting.energy_tolerance is None:
            return ready
        selection = replace(ready.reduction.selection, energy_tolerance=setting.energy_tolerance)  # type: ignore[type-var]
        return replace(ready, reduction=replace(ready.reduction, selection=selection))

    def _prepare(self, setting: Setting) -> Prepared:
        if setting.modes not in self._first:
            self._first[setting.modes] = self.structure.with_modes(first_of(self.modes, setting.modes))
        prepared = prepare(self._first[setting.modes], self.scene_of(setting), has_bars=True)
        return replace(prepared, seconds=self.comm.bcast(prepared.seconds))

    def scene_of(self, setting: Setting) -> Scene:
        """Return the scene with the [solver] of a setting.  Local."""
        solver = {
            "method": setting.method,
            "modes": setting.modes,
            "samples": setting.samples,
            "tolerance": setting.tolerance,
            "harmonics": max(setting.harmonics, self.least_harmonics),
            "accuracy": setting.accuracy,
            "accuracy_of": setting.accuracy_of,
        }
        if setting.energy_tolerance is not None:
            solver["energy_tolerance"] = setting.energy_tolerance
        return changed(self.scene, {"solver": solver})

    # -- response ----------------------------------------------------------------------------------------------

    def response(self, prepared: Prepared, setting: Setting) -> ResponseProblem:
        """Return the data shared by all levels for a setting.  Local."""
        model = prepared.model.with_harmonics(Harmonics.up_to(setting.harmonics))
        settings = replace(prepared.response.settings, samples=setting.samples, tolerance=setting.tolerance)
        selection = prepared.reduction.selection
        return replace(prepared.response, settings=settings, model=model, selection=selection, sweep=self.sweep)

    def accuracy_of(self, setting: Setting, problem: ForcedResponse) -> Accuracy | None:
        """Return a new choice of harmonics and samples for a branch; None if the setting has no accuracy."""
        if setting.accuracy is None:
            return None
        settings = response_settings(self.scene)
        free = replace(settings, accuracy=setting.accuracy, keeps=frozenset(), tolerance=ResponseSettings.tolerance)
        return accuracy_of(replace(free, is_corrected=setting.is_corrected), problem.equation)

    def run(
        self, parameter: str, value: str, setting: Setting, omegas: Mapping[float, Sequence[float]], bars: bool = True
    ) -> Run:
        """Return the timed results of a setting at the frequencies of each level, including failures."""
        try:
            prepared = self.prepared(setting)
        except MicroslipError as problem:
            return not_run(parameter, value, setting, str(problem))
        timed = self._timed_branches(prepared, setting, omegas, bars)
        if timed.wall < SHORT and not any(branch.failure for branch in timed.branches):
            second = self._timed_branches(prepared, setting, omegas, bars=False)
            if second.wall < timed.wall:
                timed = replace(
                    timed,
                    wall=second.wall,
                    cpu=second.cpu,
                    wall_with_bars=timed.wall_with_bars + second.wall - timed.wall,
                    cpu_with_bars=timed.cpu_with_bars + second.cpu - timed.cpu,
                )
        failure = "; ".join(branch.why_ended for branch in timed.branches if branch.failure)
        unknowns = max((point.unknowns for branch in timed.branches for point in branch.points), default=0)
        curves, corrected = self.comm.bcast(
            tuple(tuple(curve_of(branch, of) for branch in timed.branches) for of in (setting.is_corrected, True))
        )
        has_bars = bars or setting.accuracy is not None
        return Run(
            parameter,
            value,
            setting,
            prepared.seconds + self.setup_of_modes(setting.modes),
            timed.wall,
            timed.cpu,
            timed.wall_with_bars,
            timed.cpu_with_bars,
            unknowns,
            curves,
            failure or None,
            corrected if has_bars else (),
        )

    def _timed_branches(self, prepared: Prepared, setting: Setting, omegas, bars: bool) -> Timed:
        """Return the branches of all levels and their times; error bars are timed separately unless the response needs them."""
        start, branches, spent = stopwatch(), [], np.zeros(2)
        response = self.response(prepared, setting)
        for level, points in omegas.items():
            problem = response.at_level(level)
            accuracy = self.accuracy_of(setting, problem)
            enriched = prepared.response.enriched
            estimator = TimedEstimator(enriched) if enriched and (bars or accuracy) else None
            task = task_at(problem, response.selection, list(points), setting.tolerance, estimator, accuracy)
            branches.append(solved_at(task, list(points)))
            if estimator is not None and accuracy is None:
                spent += estimator.spent
        (wall, cpu), (wall_of_bars, cpu_of_bars) = self.comm.bcast((stopwatch() - start, spent))
        return Timed(branches, float(wall - wall_of_bars), float(cpu - cpu_of_bars), float(wall), float(cpu))


@dataclass(frozen=True)
class Timed:
    """Branches and their times, on rank 0."""

    branches: list[Branch]
    wall: float  # s, without error bars
    cpu: float  # s
    wall_with_bars: float  # s
    cpu_with_bars: float  # s


def stopwatch() -> np.ndarray:
    """Return wall and processor time of this process [s].  Local."""
    return np.array([time.perf_counter(), time.process_time()])


class TimedEstimator(ErrorEstimator):
    """Error bars with their computing time."""

    def __init__(self, enriched: EnrichedModel):
        super().__init__(enriched)
        self.spent = np.zeros(2)

    def at(self, *point: Any, **known: Any) -> Estimate | None:
        """Return the estimate at a point, and add its time to ``spent``.  Collective."""
        start = stopwatch()
        estimate = super().at(*point, **known)
        self.spent += stopwatch() - start
        return estimate


def not_run(parameter: str, value: str, setting: Setting, why: str) -> Run:
    """Return a run without results.  Local."""
    return Run(parameter, value, setting, np.nan, np.nan, np.nan, np.nan, np.nan, 0, (), why)


def curve_of(branch: Branch, is_corrected: bool = False) -> Curve:
    """Return the amplitude of harmonic 1 of the first output along a branch, cos - i sin, or the corrected one.  Local."""
    omega = np.array([point.omega for point in branch.points])
    values = [amplitude_of(point, is_corrected) for point in branch.points]
    return Curve(branch.level, omega, np.array([u for u, _ in values], dtype=complex), np.array([bar for _, bar in values]))


def amplitude_of(point: Point, is_corrected: bool) -> tuple[complex, float]:
    """Return this amplitude at a point and its bar, nan without a bar [m].  Local."""
    if is_corrected and point.corrected is not None and point.error_corrected is not None:
        return complex(point.corrected[0, 0], -point.corrected[0, 1]), float(point.error_corrected[0])
    bar = np.nan if point.error is None else float(total(point.error[0]))
    return complex(point.response[0, 1], -point.response[0, 2]), bar
