"""Maxima listed by ``peaks = true`` on curves of random structures, compared with those of fine sweeps.

    python jobs/bench/random_peaks.py [--systems 200] [--first 0] [--points 30] [--reference 150] [--samples 1024] [--show 1e-5]

The structures are those of ``tests/verification/sharp_peaks.py --small``: 3 to 5 degrees of freedom, 1 or 2 pairs, 2 outputs, one
level with slip.  A sweep has ``--reference`` points; the intervals beside each of its maxima are refined three times by a factor
of six.  Its maxima count if they exceed 5 % of the largest and the curve falls by 1 % on both sides.  The corresponding listed
maximum is that between these two places with the nearest amplitude; it is missed if it is lower by more than 1e-3.  Differences
are relative to the sweep; a positive amplitude difference means that the listed maximum is higher.
"""

from __future__ import annotations

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests")]

from verification.sharp_peaks import BEYOND, FAINT, HALF_POWER, LOWER, response_of, sampled  # noqa: E402  initialises PETSc

from microslip.continuation.branch_points import iterate_of  # noqa: E402
from microslip.continuation.constraint_rows import Plane  # noqa: E402
from microslip.continuation.iterate import Iterate  # noqa: E402
from microslip.continuation.outputs import output_at  # noqa: E402
from microslip.continuation.point_solver import PointSolver, Workspace  # noqa: E402
from microslip.library.follow_response import follow  # noqa: E402
from microslip.points.branch import Branch  # noqa: E402
from microslip.points.selection import AllPairs  # noqa: E402
from microslip.points.sweep import Sweep  # noqa: E402

PARTS, ROUNDS = 6, 3  # of each interval about a maximum of the sweep
FALL = 0.01  # of a maximum, by which the curve falls on both sides of it
ASIDE = 3.0  # of its length, at most, from the chord of an interval to the solution


@dataclass
class Maximum:
    """A maximum of a fine sweep, and the listed one."""

    name: str
    omega: float  # rad/s
    size: float  # m
    by_points: float  # m, the highest point of the curve about it
    listed: tuple[float, float]  # rad/s, m; the size is 0 if none is listed near it

    @property
    def higher(self) -> float:
        """Relative height of the listed maximum above this one [-]."""
        return self.listed[1] / self.size - 1.0

    @property
    def shift(self) -> float:
        """Relative difference of its frequency from the sweep's [-]."""
        return abs(self.listed[0] / self.omega - 1.0)


class Sweeper:
    """More solutions between the points of a sweep, each on a plane across the chord between two others."""

    def __init__(self, problem, branch: Branch, tolerance: float):
        self.problem, self.branch = problem, branch
        self.workspace = Workspace(problem.equation)
        omega, _ = sampled(branch)
        self.solver = PointSolver(problem, AllPairs(), Sweep(omega.min(), omega.max()), tolerance, self.workspace)
        self.every = problem.equation.every_pair

    def maximum(self, output: int, i: int) -> tuple[float, float]:
        """Return frequency [rad/s] and amplitude [m] of the highest solution about point i."""
        harmonics = self.problem.equation.harmonics
        row = [iterate_of(self.branch.points[k], self.problem, harmonics) for k in (i - 1, i, i + 1)]
        for _ in range(ROUNDS):
            before, here, after = (there.parameter for there in row)
            is_folded = (here - before) * (after - here) <= 0.0
            row = [there for a, b in zip(row, row[1:]) for there in (a, *self.between(a, b, is_folded))] + row[-1:]
            sizes = [self.size(there, output) for there in row]
            k = int(np.clip(np.argmax(sizes), 1, len(row) - 2))
            row = row[k - 1 : k + 2]
        return row[1].parameter, max(sizes)

    def between(self, a: Iterate, b: Iterate, is_folded: bool) -> list[Iterate]:
        """Return the solutions that Newton's method finds between two others, at fixed frequencies or across their chord."""
        size, force, there = self.solver.norm(a.U), self.solver.force(a, self.every), []
        rows = [((b.U - a.U) / size, tuple(self.solver.d_nu(a, b))), (np.zeros_like(a.U), (1.0,))]
        for share in np.arange(1, PARTS) / PARTS:
            about = Iterate(a.U + share * (b.U - a.U), (a.parameter + share * (b.parameter - a.parameter),), a.harmonics)
            for row in rows[:1] if is_folded else rows[::-1]:
                solution, _ = self.solver.solve(about, Plane(about, *row), size, self.every, force)
                aside = self.solver.norm(solution.iterate.U - about.U)
                if solution.failure is None and aside <= ASIDE * self.solver.norm(b.U - a.U):
                    there.append(solution.iterate)
                    break
        return there

    def size(self, there: Iterate, output: int) -> float:
        """Return the amplitude of an output at a solution [m]."""
        return abs(output_at(self.problem.equation, self.problem.at(there.parameters), there.U, self.every, output))


def tops(omega: np.ndarray, amplitude: np.ndarray) -> Iterator[tuple[int, float, float]]:
    """Yield the maxima of a sweep that count: the point, and the frequencies on both sides where the curve is 1 % lower."""
    for i in np.flatnonzero((amplitude[1:-1] > amplitude[:-2]) & (amplitude[1:-1] >= amplitude[2:])) + 1:
        beyond = np.flatnonzero((amplitude < (1.0 - FALL) * amplitude[i]) | (amplitude > amplitude[i]))
        before, behind = beyond[beyond < i][-1:], beyond[beyond > i][:1]
        ends = np.concatenate([before, behind])
        if len(ends) == 2 and (amplitude[ends] < amplitude[i]).all() and amplitude[i] > FAINT * amplitude.max():
            yield int(i), *np.sort(omega[ends[0] : ends[1] + 1])[[0, -1]]


def compare(number: int, points: int, reference: int, samples: int) -> tuple[list[Maximum], int] | None:
    """Return the maxima of the sweep of a system, and the number of listed ones; None where a curve ends early."""
    with response_of(7, number, True, samples) as response:
        (few,), (dense,) = (
            follow(replace(response, settings=replace(response.settings, points=n, peaks=n == points)))
            for n in (points, reference)
        )
        if few.failure or dense.failure:
            return None
        sweeper, (omega, amplitude) = Sweeper(response.at_level(dense.level), dense, response.settings.tolerance), sampled(few)
        maxima, at = [], sampled(dense)
        for output in range(amplitude.shape[1]):
            for i, low, high in tops(at[0], at[1][:, output]):
                if dense.points[i - 1].segment != dense.points[i + 1].segment:
                    continue  # the end of the range
                place, size = sweeper.maximum(output, i)
                low, high = low * (1.0 - BEYOND), high * (1.0 + BEYOND)
                near = [
                    (peak.omega, abs(peak.amplitude)) for peak in few.peaks if peak.output == output and low <= peak.omega <= high
                ]
                listed = min(near, key=lambda peak: abs(peak[1] - size), default=(np.nan, 0.0))
                of_points = amplitude[(low <= omega) & (omega <= high), output].max(initial=0.0)
                maxima.append(Maximum(f"system {number}, output {output}", place, size, of_points, listed))
        sweeper.workspace.destroy()
        return maxima, len(few.peaks or ())


def main() -> None:
    """Compare and print."""
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for key, default in (("systems", 200), ("first", 0), ("points", 30), ("reference", 150), ("samples", 1024)):
        options.add_argument(f"--{key}", type=int, default=default)
    options.add_argument("--show", type=float, default=1e-5, help="each difference of an amplitude beyond this")
    given, start = options.parse_args(), time.process_time()
    maxima, n_listed, n_early = list[Maximum](), 0, 0
    for number in range(given.first, given.first + given.systems):
        result = compare(number, given.points, given.reference, given.samples)
        if result is None:
            n_early += 1
            continue
        maxima, n_listed = maxima + result[0], n_listed + result[1]
        for each in result[0]:
            if abs(each.higher) > given.show:
                print(
                    f"{each.name}: {each.size:.6g} m at {each.omega:.8g} rad/s, listed {each.higher:+.1e}, {each.shift:.1e} off",
                    flush=True,
                )
    listed = [each for each in maxima if each.higher > -LOWER]
    print(f"systems {given.systems}, of which {n_early} have a curve that ends early; {time.process_time() - start:.0f} s")
    print(f"maxima of the fine sweep {len(maxima)}, listed {n_listed}, missed {len(maxima) - len(listed)}")
    if not listed:
        return
    for share in (HALF_POWER, 0.99):
        print(
            f"listed, but no point of the curve at {share:g} of it: {sum(each.by_points < share * each.size for each in listed)}"
        )
    higher, shift = (np.array([getattr(each, key) for each in listed]) for key in ("higher", "shift"))
    print(
        f"amplitude at most {-higher.min():.1e} lower, {higher.max():.1e} higher; beyond 1e-5: {sum(higher < -1e-5)}, {sum(higher > 1e-5)}"
    )
    print(f"frequency at most {shift.max():.1e} off; {sum(shift > 1e-5)} beyond 1e-5")


if __name__ == "__main__":
    main()
