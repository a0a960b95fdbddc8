"""Random structures against time integration to a true steady state: do the error bars hold?

    PYTHONPATH=solver:tests python tests/verification/random_systems.py --systems 40 [--seed 1] [--harmonics 15 --samples 1024]

A structure (random_structures.py) is solved by the program at four levels, from before the first slip to gross slip; at some points
of every curve oracles/shooting.py integrates the full system in time, with a contact law of its own, to a steady state, beginning
at the motion that the program found and with sliders where theory.md, eq. (3.5) puts them.  A bar holds if the complex amplitude
of harmonic 1 lies within it, or within what time integration itself is known to.
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
STEPS = 2048  # a period; half of them tell how well it is known
STEADY = 1e-7  # distance from a steady state, over the stuck motion, up to which a point is judged
ROUNDING = 1e-9  # of the peak
FOLD = 0.01  # smallest singular value of a period less 1, below which a solution lies beside a fold
MORE = 15  # harmonics of solutions from which integration begins where it has left the point
PUSHED = 1e-6  # over the stuck motion
DRIFTS = 0.1  # of a slider's way that a period leaves, at least


@dataclass
class Judged:
    """A point of the program beside time integration; lengths over the largest amplitude of its curve."""

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
    own: float = np.nan  # of time integration
    distance: float = np.inf
    drifts: float = 0.0
    history: float = 0.0  # how far resting sliders were left from where the rule (3.5) puts them, over the stuck motion
    state: tuple[int, ...] = ()

    @property
    def is_steady(self) -> bool:
        return self.distance <= STEADY

    @property
    def holds(self) -> bool:
        return self.error <= self.bar + self.own + ROUNDING


@dataclass
class Found:
    """What the program made of a system."""

    judged: list[Judged] = field(default_factory=list)
    cases: list[tuple] = field(default_factory=list)  # (system, level, omega)
    forces: list[np.ndarray] = field(default_factory=list)  # p (n_pairs, 3, N_H)
    amplitudes: list[complex] = field(default_factory=list)  # over the peak
    means: list[float] = field(default_factory=list)
    peaks: list[float] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


def solve(seed: int, number: int, points: int, solver: dict, lift_off: bool = False) -> Found:
    """Return some points of the curves of a system by the program, and where time integration is to begin."""
    system, outcome = draw(seed, number, lift_off), Found()
    try:
        branches = followed(system, sorted(system["levels"].values()), solver)
    except MicroslipError as failure:
        return Found(failures=[f"{number}: {failure}"])
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
    """Return the peak, two thirds of the others near it and the rest spread along the curve."""
    if not sizes:
        return []
    top = int(np.argmax(sizes))
    high = np.flatnonzero(np.array(sizes) >= 0.5 * sizes[top])
    near = high[np.linspace(0, len(high) - 1, 2 * points // 3).astype(int)]
    return sorted({top, *near.tolist(), *np.linspace(0, len(sizes) - 1, points - len(near)).astype(int).tolist()})


def keep(computed: Found, number: int, system, level: float, point, peak: float) -> None:
    """Add a point of a curve of a system, whose largest amplitude is ``peak``, to those to be judged."""
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


def judge(computed: list[Found], steps: int = STEPS) -> list[Judged]:
    """Integrate all points in time, and complete what is known of them."""
    for of in computed:
        for one, case, p, amplitude, mean, peak in zip(of.judged, of.cases, of.forces, of.amplitudes, of.means, of.peaks):
            point = shooting.Point(*case)
            steady, one.history = point.by_rule(point.state_of(p), steps)
            coarse = point.steady(steady.x, steps // 2).amplitude
            one.error, one.own = abs(steady.amplitude / peak - amplitude), abs(coarse - steady.amplitude) / peak
            one.mean, one.distance, one.drifts = abs(steady.mean / peak - mean), steady.distance, steady.drifts
            one.kinds += ["drifts"] * (one.drifts >= DRIFTS) + ["beside a fold"] * (steady.fold < FOLD)
            one.kinds += ["sliders pushed on the way"] * (one.history > PUSHED)
    return [one for of in computed for one in of.judged]


def judge_from_more(computed: Found, i: int, steps: int = STEPS, harmonics: int = MORE) -> None:
    """Judge a point again by the nearest steady state that time integration reaches from solutions with more harmonics.

    Beside a fold, integration that begins at the motion of a few harmonics may leave a solution nearby for one far away.
    """
    one, case, amplitude, peak = computed.judged[i], computed.cases[i], computed.amplitudes[i], computed.peaks[i]
    system, level, omega = case
    for branch in followed(system, [level], {"harmonics": harmonics, "at": [omega]}):
        for solution in (point for point in branch.points if abs(point.omega / omega - 1.0) < ROUNDING):
            point = shooting.Point(*case)
            steady, history = point.by_rule(point.state_of(np.asarray(solution.p)), steps)
            error = abs(steady.amplitude / peak - amplitude)
            if steady.distance <= STEADY and error < one.error:
                one.error, one.distance, one.drifts, one.history = error, steady.distance, steady.drifts, history
                one.kinds += [f"judged from {harmonics} harmonics"] + ["beside a fold"] * (steady.fold < FOLD)


@dataclass(frozen=True)
class Share:
    """How many points of a kind lie within their bar, and the largest error beyond the bars; over the peak."""

    points: int
    within: float
    worst: float  # error of the amplitude
    bar: float  # of that point
    beyond: float  # the largest error less what the bar says
    mean: float  # the largest error of the constant part


def share(judged: list[Judged]) -> Share:
    """Return it of some points that came to a steady state."""
    if not judged:
        return Share(0, np.nan, np.nan, np.nan, np.nan, np.nan)
    worst = max(judged, key=lambda one: one.error)
    return Share(
        len(judged),
        float(np.mean([one.holds for one in judged])),
        worst.error,
        worst.bar,
        max(one.error - one.bar for one in judged),
        max(one.mean for one in judged),
    )


def table(judged: list[Judged]) -> str:
    """Return the rows of the kinds of points, of all, and of those in which a pair slips or opens."""
    steady = [one for one in judged if one.is_steady]
    move = [one for one in steady if any(one.state)]
    rows = {"all": steady, "no pair moves": [one for one in steady if not any(one.state)], "pairs slip or open": move}
    rows |= {f"… {kind}": [one for one in move if kind in one.kinds] for kind in sorted({k for one in move for k in one.kinds})}
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
    """Return the steady points beyond their bar, the worst first."""
    too_small = [one for one in judged if one.is_steady and not one.holds]
    return sorted(too_small, key=lambda one: one.bar - one.error)


def main():
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--systems", type=int, default=40)
    options.add_argument("--first", type=int, default=0, help="number of the first system")
    options.add_argument("--points", type=int, default=6, help="of each curve, at most")
    for key, kind in (("harmonics", int), ("samples", int), ("accuracy", float)):
        options.add_argument(f"--{key}", type=kind)
    asked, start = options.parse_args(), time.perf_counter()
    solver = {key: value for key in ("harmonics", "samples", "accuracy") if (value := getattr(asked, key)) is not None}
    outcomes = [solve(asked.seed, asked.first + i, asked.points, dict(solver)) for i in range(asked.systems)]
    solved = time.perf_counter()
    judged = judge(outcomes)
    for failure in (failure for one in outcomes for failure in one.failures):
        print(f"failed: {failure}")
    unsteady = [one for one in judged if not one.is_steady]
    print(f"\n{len(judged)} points of {len(outcomes)} systems, {len(unsteady)} without a steady state")
    print(f"program {solved - start:.0f} s, time integration {time.perf_counter() - solved:.0f} s; its own error up to ", end="")
    print(f"{max(one.own for one in judged if one.is_steady):.1e} of the peak\n\n{table(judged)}\n")
    for one in outside(judged):
        parts = ", ".join(f"{name} {value:.1e}" for name, value in one.parts.items() if value > 0.0)
        print(
            f"system {one.number}, level {one.level:.4g}, omega {one.omega:.6g}, H {one.H}, {one.samples} samples: error {one.error:.1e}, "
            f"bar {one.bar:.1e} ({parts}), mean {one.mean:.1e}, drifts {one.drifts:.2f}, history {one.history:.0e}, states {one.state}, {', '.join(one.kinds)}; "
            f"{'; '.join(one.notes)}"
        )


if __name__ == "__main__":
    main()
