"""The runs of the case study: every level by every method at the same frequencies, and their measured costs and errors."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[1] / "bench")]  # its drivers are scripts in one folder

import methods
import numpy as np
from comparison import Row
from condensed import solve_dense
from prepared import Prepared
from rubin import build_rubin

from microslip.contact.law import STICK
from microslip.continuation.follow import NOTHING, follow_branch
from microslip.continuation.grid import advancing, at_frequencies
from microslip.continuation.task import BranchTask
from microslip.fourier.coefficients import amplitude
from microslip.messages.errors import ConvergenceError
from microslip.points.selection import AllPairs, DissipatingPairs, NonStickingPairs
from microslip.studies.compare.report import differences
from microslip.system.memory import peak_memory

LU_SIZES = (100, 200, 500, 1000, 2000, 4000)  # unknowns at which one dense LU is timed
EPSILON = 1e-10  # J a cycle and pair, the paper's
MOST_LU = 12000  # unknowns; larger ones are not timed: 1.2 GB


@dataclass(frozen=True)
class Run:
    """One method along one level: its points, their times, and the dropped pairs at each."""

    row: Row
    points: list  # converged points, in the order of the frequencies
    retained: np.ndarray  # (n,) pairs in B
    dropped: np.ndarray  # (n,) pairs assumed stuck with p != 0 by the law at the computed motion
    lost: np.ndarray  # (n,) friction loss of these pairs, by the same law [J per cycle]
    carries: np.ndarray  # (n, n_pairs) bool: retained, with p != 0

    @property
    def level(self) -> float:
        return self.row.level

    @property
    def failure(self) -> str | None:
        return self.row.failure

    @property
    def frequency(self) -> np.ndarray:
        """Return (n,) Hz."""
        return np.array(self.row.omega) / (2.0 * np.pi)

    @property
    def amplitude(self) -> np.ndarray:
        """Return the amplitude of harmonic 1 of the first output, (n,) [m]."""
        return amplitude(np.array(self.row.response)[:, 0])

    @property
    def peak(self) -> int:
        return int(np.argmax(self.amplitude))

    @property
    def unknowns(self) -> np.ndarray:
        return np.array(self.row.unknowns)

    def total(self, name: str) -> float:
        """Return the sum over the points of ``cpu``, ``newton`` or ``evaluations``."""
        return float(np.sum(getattr(self.row, name)))


@dataclass
class Level:
    """The runs of one level.  ``reference`` is `receptance`: the condensed full set."""

    reference: Run
    adaptive: Run
    checked: Run  # adaptive, all pairs checked at each point
    energy: dict[float, Run]  # adaptive-energy by eps [J]
    energy_checked: dict[float, Run]
    condensed: Row | None = None  # all pairs by dense Newton at the peak, if solved
    rubin: Row | None = None  # plain Rubin at the peak, if solved: first and last level

    @property
    def level(self) -> float:
        return self.reference.level

    @property
    def improved(self) -> Run:
        """Return the run of `adaptive-energy` with the paper's tolerance; with the smallest one if it was not requested."""
        return self.energy.get(EPSILON) or self.energy[min(self.energy)]

    @property
    def slips(self) -> bool:
        return any((point.state != STICK).any() for point in self.reference.points)


@dataclass(frozen=True)
class Idle:
    """The pairs at a peak of the reference with p != 0 and a loss of at most ``EPSILON``."""

    moving: int  # pairs with p != 0
    idle: int  # pairs of these with a loss of at most EPSILON
    traction: float  # the largest constant traction of an idle pair, over mu N0


@dataclass(frozen=True)
class Step:
    """The error of `adaptive` for one number of points."""

    level: float
    rule: str  # ARC or EQUAL
    requested: int  # points
    solved: int
    spacing: float  # Hz between points next to the peak
    largest: float  # difference from `receptance` anywhere, over its peak
    at_peak: float  # relative error of the peak
    failure: str | None  # why the curve ends early


ARC, EQUAL = "steps of the arc length", "equal steps of frequency"


@dataclass
class Study:
    """All data of the figures and the page."""

    prepared: Prepared
    levels: list[Level]
    steps: list[Step]
    rubin_size: int  # unknowns of plain Rubin
    lu: dict[int, float] = field(default_factory=dict)  # processor time of one dense LU by unknowns [s]
    parts: dict[str, tuple[float, float]] = field(default_factory=dict)  # processor time [s] and peak memory [MiB] by part

    @property
    def slipping(self) -> list[Level]:
        return [level for level in self.levels if level.slips]

    @property
    def model(self) -> Any:
        return self.prepared.model

    def lu_seconds(self, unknowns) -> np.ndarray:
        """Return seconds of one dense LU: linear in the logarithms between the timed sizes, cubic beyond them."""
        sizes, times = np.array(sorted(self.lu)), np.array([self.lu[size] for size in sorted(self.lu)])
        seconds = np.exp(np.interp(np.log(unknowns), np.log(sizes), np.log(times)))
        return np.where(np.asarray(unknowns) > sizes[-1], times[-1] * (np.asarray(unknowns) / sizes[-1]) ** 3, seconds)


def study(prepared: Prepared, tolerances: Sequence[float], steps: Sequence[int], rubin_points: bool, clock: Clock) -> Study:
    """Return all runs of a scene.  One rank."""
    model = prepared.model
    levels = [of_level(prepared, level, tolerances, clock) for level in prepared.scene.response.levels]
    condensed_at_peak(prepared, levels[-1], clock)
    slipping = [level for level in levels if level.slips]
    chosen = slipping[:: max(len(slipping) - 1, 1)]  # the first and the last
    all_steps = [step for level in chosen for step in of_steps(prepared, level.level, steps)]
    clock.lap("effect of the step")
    size = (6 * model.n_pairs + model.n_modes + len(model.f)) * model.N_H
    if rubin_points and prepared.structure.mesh is not None:
        rubin_at_peaks(prepared, list(dict.fromkeys([0, len(levels) - 1])), levels, clock)
    whole = Study(prepared, levels, all_steps, size)
    most = max(int(level.adaptive.unknowns.max()) for level in levels)
    for n in sorted({n for n in LU_SIZES if n < most} | {most, size} - {n for n in (size,) if n > MOST_LU}):
        whole.lu[n] = one_lu(n)
    clock.lap("dense LU of some sizes")
    whole.parts = clock.parts
    return whole


class Clock:
    """Processor time of each part and peak memory until its end, printed then."""

    def __init__(self, say: Callable[[str], None]):
        self.say, self.start = say, time.process_time()
        self.parts: dict[str, tuple[float, float]] = {}

    def lap(self, name: str) -> None:
        now = time.process_time()
        self.parts[name] = now - self.start, peak_memory() / 2**20
        self.start = now
        self.say(f"{name:<60}{self.parts[name][0]:>8.1f} s{self.parts[name][1]:>8,.0f} MiB")


def of_level(prepared: Prepared, level: float, tolerances: Sequence[float], clock: Clock) -> Level:
    """Run every method on one level, at the frequencies that `receptance` reaches by arc length."""
    problem, tolerance = prepared.problem(level), prepared.scene.solver.tolerance
    task = BranchTask(problem, AllPairs(), prepared.sweep, prepared.steps, tolerance)
    curve = follow_branch(task, 10 * prepared.scene.response.points)
    omegas = advancing(curve.points, prepared.sweep.direction)
    if len(omegas) < 3:
        why = curve.failure or "fewer than 3 points"
        raise ConvergenceError(f"receptance at {level:g} N: {why}; take a wider range or more points")
    with methods.contact_counter() as watch:
        at_omegas = partial(at_frequencies, problem, omegas=omegas, tolerance=tolerance)
        solve = partial(solved, problem, at_omegas, watch)
        reference = solve("receptance", AllPairs(), motion=True)
        result = Level(
            reference,
            solve("adaptive", NonStickingPairs(), motion=True),
            solve("adaptive, checked", NonStickingPairs(True)),
            {eps: solve(f"adaptive-energy, {eps:g} J", DissipatingPairs(False, eps)) for eps in tolerances},
            {
                eps: solve(f"adaptive-energy, {eps:g} J, checked", DissipatingPairs(True, eps))
                for eps in (tolerances[0], tolerances[-1])
            },
        )
    clock.lap(f"{level:g} N: {len(omegas)} points, {len(tolerances) + 6} runs")
    return result


def condensed_at_peak(prepared: Prepared, level: Level, clock: Clock) -> None:
    """Solve all pairs by dense Newton at the peak of a level, to check the reference."""
    problem, reference, tolerance = prepared.problem(level.level), level.reference, prepared.scene.solver.tolerance
    with methods.contact_counter() as watch:
        level.condensed = methods.condensed_at(problem, reference.points, [reference.peak], tolerance, watch)
    clock.lap(f"all pairs by dense Newton at the peak of {level.level:g} N")


def solved(problem, at_omegas: Callable, watch, method: str, selection, motion: bool = False) -> Run:
    """Return one method at given frequencies; the motion of the pairs is stored if requested."""
    row, points = methods.of_branch(method, partial(at_omegas, selection), problem.level, watch)
    moving = np.array([moves(problem, point.U) for point in points])
    carries = np.array([point.p.any(axis=(1, 2)) for point in points])
    held = moving & ~carries
    lost = np.where(held, [point.energy for point in points], 0.0).sum(axis=1)
    in_B = (np.array(row.unknowns) // problem.equation.model.N_H - problem.equation.model.n_modes) // 3
    retained = moving.sum(axis=1) if isinstance(selection, AllPairs) else in_B
    if not motion:
        points = [replace(point, U=NOTHING, p=NOTHING) for point in points]
    return Run(row, points, retained, held.sum(axis=1), lost, carries)


def moves(problem, U: np.ndarray) -> np.ndarray:
    """Return the pairs with p != 0 under a motion, (n_pairs,) bool; some of them slip only while the cycle settles."""
    active, everything = np.zeros(len(U), dtype=bool), np.ones(len(U), dtype=bool)
    active[problem.equation.contact_forces(U, everything, tangents=False).active] = True
    return active


def idle(study: Study, level: Level) -> Idle:
    """Return the pairs with p != 0 that the energy test drops at the peak of a level."""
    top, pairs = level.reference.points[level.reference.peak], study.prepared.structure.pairs
    moving = top.p.any(axis=(1, 2))
    is_idle = moving & (top.energy <= EPSILON) & (top.state == STICK)
    limit = np.maximum(pairs.mu * pairs.N0, 1e-300)
    traction = np.linalg.norm(top.p[:, :2, 0], axis=1) / limit
    return Idle(int(moving.sum()), int(is_idle.sum()), float(traction[is_idle].max(initial=0.0)))


def errors(run: Run, reference: Run) -> np.ndarray:
    """Return at each point the largest difference of any harmonic of any output over the reference's peak, (n,) [-]."""
    return differences(run, reference)


def peak_error(run: Run, reference: Run) -> float:
    """Return the relative error of the largest amplitude of the first output on the curve."""
    return float(run.amplitude.max() / reference.amplitude.max() - 1.0)


def of_steps(prepared: Prepared, level: float, steps: Sequence[int]) -> list[Step]:
    """Return the error of `adaptive` at points that `receptance` selects, and at equal steps of frequency."""
    problem, tolerance, sweep = prepared.problem(level), prepared.scene.solver.tolerance, prepared.sweep
    done = []
    for n in steps:
        curve = follow_branch(BranchTask(problem, AllPairs(), sweep, prepared.steps_of(n), tolerance), 10 * n)
        omegas = {ARC: advancing(curve.points, sweep.direction), EQUAL: list(np.linspace(sweep.start, sweep.stop, n))}
        for rule, at in omegas.items():
            exact, late = (
                at_frequencies(problem, selection, at, tolerance=tolerance) for selection in (AllPairs(), NonStickingPairs())
            )
            done.append(step_of(level, rule, n, exact, late))
    return done


def step_of(level: float, rule: str, requested: int, exact, late) -> Step:
    """Return the errors from a pair of runs at the same frequencies."""
    responses = [np.array([point.response for point in branch.points]) for branch in (exact, late)]
    n = min(map(len, responses))
    peaks = [amplitude(response[:n, 0]) for response in responses]
    top, scale = int(np.argmax(peaks[0])), np.abs(responses[0]).max(axis=(0, 2))[:, None]
    difference = np.abs(responses[1][:n] - responses[0][:n]) / scale
    frequency = np.array([point.omega for point in exact.points]) / (2.0 * np.pi)
    spacing = float(np.abs(np.diff(frequency))[max(top - 1, 0) : top + 1].mean())
    return Step(
        level,
        rule,
        requested,
        n,
        spacing,
        float(difference.max()),
        float(peaks[1].max() / peaks[0].max() - 1.0),
        exact.failure or late.failure,
    )


def rubin_at_peaks(prepared: Prepared, chosen: list[int], levels: list[Level], clock: Clock) -> None:
    """Solve plain Rubin at the peak of some levels, from its own coordinates at the two points before."""
    rubin, tolerance = build_rubin(prepared.structure, prepared.scene), prepared.scene.solver.tolerance
    clock.lap("plain Rubin: reduction")
    with methods.contact_counter() as watch:
        for level in (levels[k] for k in chosen):
            problem, reference = prepared.problem(level.level), level.reference
            level.rubin = methods.rubin_at(rubin, problem, reference.points, [reference.peak], tolerance, watch)
            clock.lap(f"plain Rubin at the peak of {level.level:g} N")


def one_lu(n: int, repetitions: int = 2) -> float:
    """Return the processor time of one dense LU and solve of n unknowns [s]: the best of a few, or of one if it is slow."""
    best = np.inf
    for _ in range(repetitions if n < 3000 else 1):
        A = np.random.default_rng(1).standard_normal((n, n))
        start = time.process_time()
        solve_dense(A, np.ones(n))
        best = min(best, time.process_time() - start)
    return best
