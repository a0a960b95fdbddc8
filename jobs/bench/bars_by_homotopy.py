"""Error bars from the solution of the enriched problem, reached by homotopy in the added harmonics, against those in use.

    python jobs/bench/bars_by_homotopy.py [--seed 21] [--systems 1 25 35] [--harmonics 3] [--without-lift-off] [--at-once]

The contact law receives the share s of the motion in the added harmonics, U_n = U_lin,n - G_n p_n(U_low + s U_high) for all n:
s = 0 is the point itself, s = 1 the enriched problem (2 H + 3 harmonics, twice the samples, all pairs).  Newton's method solves
for increasing s; a step of s that fails is halved.  This replaces the error bar only at points where the bar of the corrected
amplitude, without truncated modes, exceeds a tenth of the amplitude ("far").  Random systems
(tests/verification/random_structures.py); errors are measured by time integration with 512 steps per period.  Amplitudes, errors
and bars are relative to the largest amplitude of the curve; the numbers at the end of a row are medians over far points.  The
homotopy is repeated from a motion perturbed by 1e-8, to see whether rounding decides its result.
``--at-once``: from s = 0 to 1 in one step.
"""

from __future__ import annotations

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import sys
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests")]

from oracles import shooting  # noqa: E402
from verification import random_systems  # noqa: E402  initialises PETSc

from microslip.continuation.point_record import FAR  # noqa: E402
from microslip.error_estimate import estimate as bars  # noqa: E402
from microslip.error_estimate.correction import OF_HARMONICS, SAFETY, Estimate  # noqa: E402
from microslip.harmonic.balance import HarmonicBalance  # noqa: E402
from microslip.harmonic.linearisation import Linearisation  # noqa: E402
from microslip.harmonic.operating_point import ContactForces, OperatingPoint  # noqa: E402
from microslip.points.error_parts import PARTS  # noqa: E402

LONG = 0.1  # bar over the amplitude
MOST_NEWTON, MOST_OF_ALL, LEAST_STEP, FIRST_STEP = 8, 80, 1.0 / 64.0, 0.25
TOLERANCE, ROUNDING, SAME = 1e-4, 1e-8, 1e-2  # of the motion, of the motion, of the amplitude
SOLVED_FOR = [PARTS.index(name) for name in ("harmonics", "samples", "pairs")]
in_use = bars.ErrorEstimator.at


@dataclass
class Homotopy:
    """The enriched problem solved at a point; one rank."""

    wider: HarmonicBalance
    at: OperatingPoint
    high: np.ndarray  # (N_H,) bool: coefficients of the added harmonics
    solver: Any
    tolerance: float
    newton: int = 0  # iterations

    def at_share(self, V: np.ndarray, share: float) -> tuple[np.ndarray, ContactForces] | None:
        """Return the motion (n_pairs, 3, N_H) that solves the equations at a share, and its forces; None without one."""
        coupled, here = np.where(self.high, share, 1.0), None
        for _ in range(MOST_NEWTON):
            linear, residual = here or self.linearised(V, coupled)
            if (miss := np.linalg.norm(residual)) <= self.tolerance:
                return V, linear.forces
            self.newton += 1
            tangents = linear.P * np.tile(coupled, 3)
            scaled = replace(linear, forces=replace(linear.forces, P=tangents))
            step, _, is_found = scaled.solve_several(-residual.reshape(1, -1, len(coupled)), self.solver)
            for part in (1.0, 0.5, 0.25, 0.1) if is_found else ():
                there = self.linearised(V + part * step.reshape(V.shape), coupled)
                if np.linalg.norm(there[1]) < miss:
                    V, here = V + part * step.reshape(V.shape), there
                    break
            else:
                return None
        return (V, here[0].forces) if here and np.linalg.norm(here[1]) <= self.tolerance else None

    def linearised(self, V: np.ndarray, coupled: np.ndarray) -> tuple[Linearisation, np.ndarray]:
        forces = self.wider.contact_forces(V * coupled, self.wider.every_pair, tangents=True)
        linear = Linearisation.of(self.wider, self.at, forces)
        return linear, self.wider.residual(V, self.at, forces, linear.G)

    def amplitude(self, start: np.ndarray, at_once: bool) -> np.ndarray | None:
        """Return cos 1, then sin 1, of the outputs at the share 1, from the motion of the point; None if the homotopy stops earlier."""
        self.newton = 0
        solution, share, step = self.at_share(start, 0.0), 0.0, 1.0 if at_once else FIRST_STEP
        before: tuple[np.ndarray, float] | None = None
        while solution is not None and share < 1.0:
            if self.newton >= MOST_OF_ALL:
                return None
            V, following = solution[0], min(1.0, share + step)
            ahead = V if before is None else V + (V - before[0]) * (following - share) / (share - before[1])
            spent = self.newton
            there = self.at_share(ahead, following)
            if there is None:
                step /= 2.0
                if at_once or step < LEAST_STEP:
                    return None
                continue
            before, solution, share = (V, share), there, following
            step *= 2.0 if self.newton - spent <= 3 else 1.0
        if solution is None:
            return None
        return bars.output_amplitude(self.wider.model_at(self.at), self.at, self.wider.full_force(solution[1]))


class Bars:
    """Replaces the error estimate of far points, and counts the outcomes."""

    def __init__(self, at_once: bool):
        self.counts: Counter[str] = Counter()
        self.at_once = at_once

    def estimate(self, estimator: bars.ErrorEstimator, equation: Any, U: np.ndarray, at: Any, selected: Any, of_all: Any = None):
        first = in_use(estimator, equation, U, at, selected, of_all)
        if first is None or first.adjoint is None:
            return first
        forces = equation.contact_forces(U, selected, tangents=False)
        amplitude = bars.output_amplitude(equation.model_at(at), at, equation.full_force(forces))
        of_modes = first.parts[:, PARTS.index("modes")]
        is_far = first.remaining - SAFETY * of_modes > LONG * sizes(amplitude)
        self.counts.update(points=1, far=int(is_far.any()))
        solved = self.solved(estimator, equation, U, at) if is_far.any() else None
        return first if solved is None else enriched(first, solved - amplitude, of_modes, is_far)

    def solved(self, estimator: bars.ErrorEstimator, equation: Any, U: np.ndarray, at: Any) -> np.ndarray | None:
        exact = estimator.exact(equation)
        more = bars.extended(exact.harmonics)
        samples = max(bars.FINER * exact.n_samples, bars.SAMPLES * (more.highest + 1))
        wider = exact.of(estimator.enriched_model(exact.model, more)).resolved(more, samples)
        high = exact.harmonics.carry(np.ones_like(U), more)[0, 0] == 0.0
        V = exact.harmonics.carry(U, more)
        way = Homotopy(wider, at, high, estimator.forward_solver, TOLERANCE * float(np.linalg.norm(V)))
        amplitude = way.amplitude(V, self.at_once)
        self.counts.update({"found": int(amplitude is not None), "Newton iterations": way.newton})
        moved = V * (1.0 + ROUNDING * np.random.default_rng(1).standard_normal(V.shape))
        again = way.amplitude(moved, self.at_once)
        if amplitude is None or again is None:
            self.counts["found by rounding"] += (amplitude is None) != (again is None)
        else:
            self.counts["another by rounding"] += bool(np.linalg.norm(again - amplitude) > SAME * np.linalg.norm(amplitude))
        return amplitude


def sizes(values: np.ndarray) -> np.ndarray:
    """Return the sizes of cos 1, then sin 1, of the outputs."""
    cos, sin = np.split(values, 2)
    return np.hypot(cos, sin)


def enriched(first: Estimate, change: np.ndarray, of_modes: np.ndarray, is_far: np.ndarray) -> Estimate:
    """Return the estimate whose far outputs have the change by the enriched problem's solution."""
    parts, size = first.parts.copy(), sizes(change)
    parts[is_far, SOLVED_FOR[0]], parts[:, SOLVED_FOR[1:]] = (
        size[is_far],
        np.where(is_far[:, None], 0.0, parts[:, SOLVED_FOR[1:]]),
    )
    cos, sin = np.split(change, 2)
    remaining = SAFETY * (of_modes + OF_HARMONICS * size + parts[:, PARTS.index("solver")])
    return replace(
        first,
        parts=parts,
        correction=np.where(is_far, cos - 1j * sin, first.correction),
        remaining=np.where(is_far, remaining, first.remaining),
        is_near=True,
    )


@dataclass
class Row:
    """A point compared with time integration, over the peak."""

    error: float
    bar: float
    left: float  # error of the corrected amplitude
    rest: float  # its bar
    own: float  # of the time integration
    is_far: bool  # with the bars in use

    def values(self) -> tuple[float, float, float, float]:
        return self.error, self.bar, self.left, self.rest


def curves(seed: int, number: int, H: int, lift_off: bool) -> tuple[random_systems.Computed, list[tuple[complex, float]], float]:
    """Return points of a system, their corrected amplitudes and bars, and the processor's time [s]."""
    corrected: list[tuple[complex, float]] = []
    keep, began = random_systems.keep, time.process_time()

    def keep_all(result, number, system, level, point, peak):
        keep(result, number, system, level, point, peak)
        cos, sin = np.asarray(point.corrected)[0]
        corrected.append((complex(cos, -sin) / peak, float(point.error_corrected[0]) / peak))

    random_systems.keep = keep_all
    try:
        result = random_systems.solve(seed, number, 6, {"harmonics": H}, lift_off)
    finally:
        random_systems.keep = keep
    return result, corrected, time.process_time() - began


def summary(name: str, rows: list[Row], seconds: float) -> str:
    """Return a line: points within their bars, and medians of the far points."""
    far = [row for row in rows if row.is_far]
    within = sum(row.error <= row.bar + row.own + random_systems.ROUNDING for row in rows)
    left = sum(row.left <= row.rest + row.own + random_systems.ROUNDING for row in rows)
    medians = np.median([row.values() for row in far], axis=0) if far else np.zeros(4)
    of = "error {:.2g}, bar {:.2g}; corrected {:.2g}, {:.2g}".format(*medians)
    return f"  {name}: {len(rows)} points, within {within}, corrected {left}; {len(far)} far: {of}; {seconds:.1f} s"


def main() -> None:
    """Print the counts after each system."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=21)
    parser.add_argument("--systems", type=int, nargs="+", default=[1, 25, 35])
    parser.add_argument("--harmonics", type=int, default=3)
    parser.add_argument("--without-lift-off", action="store_true")
    parser.add_argument("--at-once", action="store_true")
    given, new = parser.parse_args(), None
    new = Bars(given.at_once)
    ways = {"in use": in_use, "homotopy": lambda *values, **named: new.estimate(*values, **named)}
    rows: dict[str, list[Row]] = {name: [] for name in ways}
    seconds = dict.fromkeys(ways, 0.0)
    for number in given.systems:
        by = {}
        for name, way in ways.items():
            bars.ErrorEstimator.at = way  # type: ignore[method-assign]
            by[name] = curves(given.seed, number, given.harmonics, not given.without_lift_off)
            seconds[name] += by[name][2]
        result, corrected, _ = by["in use"]
        for i, (one, case, p, amplitude, peak) in enumerate(
            zip(result.judged, result.cases, result.forces, result.amplitudes, result.peaks)
        ):
            point = shooting.Point(*case)
            steady, _ = point.by_rule(point.state_of(p), 512) if any(one.state) else (None, None)
            if steady is None or steady.distance > random_systems.STEADY:
                continue
            true = steady.amplitude / peak
            own = abs(point.steady(steady.x, 256).amplitude / peak - true)
            is_far = FAR in one.notes or corrected[i][1] > LONG * abs(amplitude)
            for name, (these, of, _) in by.items():
                error = abs(true - these.amplitudes[i])
                rows[name].append(Row(error, these.judged[i].bar, abs(true - of[i][0]), of[i][1], own, is_far))
        print(f"up to system {number}: {dict(new.counts)}", flush=True)
        print(*(summary(name, of, seconds[name]) for name, of in rows.items()), sep="\n", flush=True)


if __name__ == "__main__":
    main()
