"""Random structures compared with time integration to a true steady state: are the error bars valid?

    PYTHONPATH=solver:tests python tests/verification/random_systems.py --systems 40 [--seed 1] [--harmonics 15 --samples 1024]

A structure (random_structures.py) is solved by the program at four levels, from before the first slip to gross slip; at some points
of every curve oracles/shooting.py integrates the full system in time, with an independent contact law, to a steady state, starting
at the motion of the program with sliders by theory.md, eq. (3.5).  An error bar is valid if the complex amplitude
of harmonic 1 lies within it, or within the accuracy of time integration.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import shooting
from verification.random_structures import draw, kinds

from microslip.continuation.point_record import FAR
from microslip.library.build import build
from microslip.library.follow_response import follow
from microslip.library.prepare import prepare
from microslip.messages.errors import MicroslipError
from microslip.points.branch import Branch
from microslip.points.error_parts import PARTS, total
from microslip.scene.read import read_scene

HERE = MPI.COMM_SELF
STEPS = 2048  # per period; half of them give the accuracy of time integration
STEADY = 1e-7  # distance from a steady state, relative to the stuck motion, up to which a point is compared
ROUNDING = 1e-9  # relative to the peak
FOLD = 0.01  # smallest singular value of the map of a period less 1, below which a solution is near a fold
MORE = 15  # harmonics of solutions from which integration starts again where it left the point
PUSHED = 1e-6  # relative to the stuck motion
DRIFTS = 0.1  # least ratio of a slider's drift per period to its path


@dataclass
class Judged:
    """A point of the program compared with time integration; lengths relative to the largest amplitude of its curve."""

    number: int  # of the system
    level: float
    omega: float
    H: int
    samples: int
    bar: float
    parts: dict[str, float]
    kinds: list[str]
    notes: tuple[str, ...]
    error: float = np.nan  # of the complex amplitude
    mean: float = np.nan  # error of the constant part
    own: float = np.nan  # error of time integration
    distance: float = np.inf
    drifts: float = 0.0
    history: float = 0.0  # distance of resting sliders from their position by the rule (3.5), relative to the stuck motion
    state: tuple[int, ...] = ()

    @property
    def is_steady(self) -> bool:
        return self.distance <= STEADY

    @property
    def holds(self) -> bool:
        return self.error <= self.bar + self.own + ROUNDING


@dataclass
class Computed:
    """Points of a system by the program."""

    judged: list[Judged] = field(default_factory=list)
    cases: list[tuple] = field(default_factory=list)  # (system, level, omega)
    forces: list[np.ndarray] = field(default_factory=list)  # p (n_pairs, 3, N_H)
    amplitudes: list[complex] = field(default_factory=list)  # over the peak
    means: list[float] = field(default_factory=list)
    peaks: list[float] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


def solve(seed: int, number: int, points: int, solver: dict, lift_off: bool = False) -> Computed:
    """Return some points of the curves of a system by the program, and the start of time integration."""
    system, outcome = draw(seed, number, lift_off), Computed()
    try:
        branches = followed(system, sorted(system["levels"].values()), solver)
    except MicroslipError as failure:
        return Computed(failures=[f"{number}: {failure}"])
    for branch in branches:
        if branch.failure:
            outcome.failures.append(f"{number} at {branch.level:.3g}: {branch.failure.splitlines()[0]}")
        sizes = [float(np.hypot(*point.response[0, 1:3])) for point in branch.points]
        for i in chosen(sizes, points):
            keep(outcome, number, system, branch.level, branch.points[i], max(sizes))
    return outcome


def followed(system, levels, solver: dict) -> list[Branch]:
    """Return the curves of a system at some levels by the program."""
    output = int(np.argmax(system["output"]))
    with tempfile.TemporaryDirectory() as folder:
        path = write_matrix_scene(Path(folder), system, levels, system["omega"], outputs=[output], **{"points": 60, **solver})
        with build(read_scene(path), HERE) as structure:
            return list(follow(prepare(structure, has_bars=True).response))


def chosen(sizes, points: int) -> list[int]:
    """Return the peak, two thirds of the other points near it and the rest distributed along the curve."""
    if not sizes:
        return []
    top = int(np.argmax(sizes))
    high = np.flatnonzero(np.array(sizes) >= 0.5 * sizes[top])
    near = high[np.linspace(0, len(high) - 1, 2 * points // 3).astype(int)]
    return sorted({top, *near.tolist(), *np.linspace(0, len(sizes) - 1, points - len(near)).astype(int).tolist()})


def keep(computed: Computed, number: int, system, level: float, point, peak: float) -> None:
    """Add a point of a curve of a system, whose largest amplitude is ``peak``, to the points for comparison."""
    computed.judged.append(
        Judged(
            number,
            level,
            point.omega,
            point.harmonics,
            point.samples,
            bar=float(total(point.error)[0]) / peak,
            parts=dict(zip(PARTS, point.error[0] / peak)),
            kinds=kinds(system) + ["opens"] * bool((np.asarray(point.state) == 2).any()) + ["noted"] * (FAR in point.notes),
            notes=point.notes,
            state=tuple(int(state) for state in point.state),
        )
    )
    computed.cases.append((system, level, point.omega))
    computed.forces.append(np.asarray(point.p))
    computed.amplitudes.append((point.response[0, 1] - 1j * point.response[0, 2]) / peak)
    computed.means.append(point.response[0, 0] / peak)
    computed.peaks.append(peak)


def judge(computed: list[Computed], steps: int = STEPS) -> list[Judged]:
    """Integrate all points in time, and complete their results."""
    for of in computed:
        for result, case, p, amplitude, mean, peak in zip(of.judged, of.cases, of.forces, of.amplitudes, of.means, of.peaks):
            point = shooting.Point(*case)
            steady, result.history = point.by_rule(point.state_of(p), steps)
            coarse = point.steady(steady.x, steps // 2).amplitude
            result.error, result.own = abs(steady.amplitude / peak - amplitude), abs(coarse - steady.amplitude) / peak
            result.mean, result.distance, result.drifts = abs(steady.mean / peak - mean), steady.distance, steady.drifts
            result.kinds += ["drifts"] * (result.drifts >= DRIFTS) + ["beside a fold"] * (steady.fold < FOLD)
            result.kinds += ["sliders pushed on the way"] * (result.history > PUSHED)
    return [result for of in computed for result in of.judged]


def judge_from_more(computed: Computed, i: int, steps: int = STEPS, harmonics: int = MORE) -> None:
    """Compare a point with the nearest steady state that time integration reaches from solutions with more harmonics.

    Near a fold, integration from the motion of a few harmonics may leave a nearby solution for a distant one.
    """
    result, case, amplitude, peak = computed.judged[i], computed.cases[i], computed.amplitudes[i], computed.peaks[i]
    system, level, omega = case
    for branch in followed(system, [level], {"harmonics": harmonics, "at": [omega]}):
        for solution in (point for point in branch.points if abs(point.omega / omega - 1.0) < ROUNDING):
            point = shooting.Point(*case)
            steady, history = point.by_rule(point.state_of(np.asarray(solution.p)), steps)
            error = abs(steady.amplitude / peak - amplitude)
            if steady.distance <= STEADY and error < result.error:
                result.error, result.distance, result.drifts, result.history = error, steady.distance, steady.drifts, history
                result.kinds += [f"judged from {harmonics} harmonics"] + ["beside a fold"] * (steady.fold < FOLD)


@dataclass(frozen=True)
class Share:
    """The number of points of a kind within their error bar, and the largest errors, relative to the peak."""

    points: int
    within: float
    worst: float  # error of the amplitude
    bar: float  # of that point
    beyond: float  # the largest error less its error bar
    mean: float  # the largest error of the constant part


def share(judged: list[Judged]) -> Share:
    """Return the share of some points with a steady state."""
    if not judged:
        return Share(0, np.nan, np.nan, np.nan, np.nan, np.nan)
    worst = max(judged, key=lambda result: result.error)
    return Share(
        len(judged),
        float(np.mean([result.holds for result in judged])),
        worst.error,
        worst.bar,
        max(result.error - result.bar for result in judged),
        max(result.mean for result in judged),
    )


def table(judged: list[Judged]) -> str:
    """Return the rows of all points, of those in which a pair slips or opens, and of each kind."""
    steady = [result for result in judged if result.is_steady]
    move = [result for result in steady if any(result.state)]
    rows = {"all": steady, "no pair moves": [result for result in steady if not any(result.state)], "pairs slip or open": move}
    rows |= {
        f"… {kind}": [result for result in move if kind in result.kinds]
        for kind in sorted({k for result in move for k in result.kinds})
    }
    lines = [
        "| points | number | within the bar | largest error | its bar | largest beyond a bar | of the mean |",
        "| --- " * 7 + "|",
    ]
    for name, of in rows.items():
        s = share(of)
        lines.append(
            f"| {name} | {s.points} | {100 * s.within:.1f} % | {s.worst:.1e} | {s.bar:.1e} | {s.beyond:+.1e} | {s.mean:.1e} |"
        )
    return "\n".join(lines)


def outside(judged: list[Judged]) -> list[Judged]:
    """Return the steady points beyond their error bar, the worst first."""
    too_small = [result for result in judged if result.is_steady and not result.holds]
    return sorted(too_small, key=lambda result: result.bar - result.error)


def main():
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--systems", type=int, default=40)
    options.add_argument("--first", type=int, default=0, help="number of the first system")
    options.add_argument("--points", type=int, default=6, help="of each curve, at most")
    for key, kind in (("harmonics", int), ("samples", int), ("accuracy", float)):
        options.add_argument(f"--{key}", type=kind)
    arguments, start = options.parse_args(), time.perf_counter()
    solver = {key: value for key in ("harmonics", "samples", "accuracy") if (value := getattr(arguments, key)) is not None}
    outcomes = [solve(arguments.seed, arguments.first + i, arguments.points, dict(solver)) for i in range(arguments.systems)]
    solved = time.perf_counter()
    judged = judge(outcomes)
    for failure in (failure for result in outcomes for failure in result.failures):
        print(f"failed: {failure}")
    unsteady = [result for result in judged if not result.is_steady]
    print(f"\n{len(judged)} points of {len(outcomes)} systems, {len(unsteady)} without a steady state")
    print(f"program {solved - start:.0f} s, time integration {time.perf_counter() - solved:.0f} s; its own error up to ", end="")
    print(f"{max(result.own for result in judged if result.is_steady):.1e} of the peak\n\n{table(judged)}\n")
    for result in outside(judged):
        parts = ", ".join(f"{name} {value:.1e}" for name, value in result.parts.items() if value > 0.0)
        print(
            f"system {result.number}, level {result.level:.4g}, omega {result.omega:.6g}, H {result.H}, {result.samples} samples: error {result.error:.1e}, "
            f"bar {result.bar:.1e} ({parts}), mean {result.mean:.1e}, drifts {result.drifts:.2f}, history {result.history:.0e}, states {result.state}, {', '.join(result.kinds)}; "
            f"{'; '.join(result.notes)}"
        )


if __name__ == "__main__":
    main()
