"""Methods compared on one scene: the same points, law, tangents and tolerance.

    python jobs/bench/methods.py [SCENE.toml] [--levels 1 15] [--points 98] [--dense-points 8] [--rubin-points 2]
        [--out DIR] [--page docs/bench_methods.md]

SCENE is jobs/fan_paper.toml by default.  Writes bench_methods.csv in DIR (results/bench); its tables and the plot
img/bench_methods.png go there too, or with --page into that page and its folder.

At each level a run of `receptance` by arc length selects the frequencies.  There, every method is solved from its own last two
points: `receptance`, `adaptive`, `adaptive-energy`; the condensed full set by dense Newton (all pairs, relative DOFs); plain
Rubin by dense Newton (all absolute interface DOFs).  The two dense methods are solved only at some points, spread along the curve
and including its peak, from the curve's two points before each; the table shows how many.  --dense-points 0 means all points;
--rubin-points 0 none: one LU of its size then stands for a point, a lower bound.
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from microslip.parallel.petsc import initialise

initialise()
import machine
from comparison import ARC, CONDENSED, REFERENCE, RUBIN, RUBIN_BOUND, Comparison, Effort, Row
from condensed import CondensedFullSet, solve_dense
from mpi4py import MPI
from prepared import Prepared, prepare
from rubin import PlainRubin, build_rubin
from stopwatch import Stopwatch

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.continuation.follow import follow_branch
from microslip.continuation.grid import advancing, at_frequencies, secant
from microslip.continuation.iterate import Iterate
from microslip.continuation.task import BranchTask
from microslip.points.branch import Point
from microslip.points.selection import AllPairs, DissipatingPairs, NonStickingPairs, Selection
from microslip.receptance.motions import output_motion


class Laps:
    """Processor time and contact evaluations from lap to lap."""

    def __init__(self, watch: Stopwatch):
        self.watch = watch
        self.lap()

    def lap(self) -> tuple[float, int]:
        """Return time and evaluations since the last lap."""
        now = time.process_time(), self.watch.calls["contact"]
        start, self.start = getattr(self, "start", now), now
        return now[0] - start[0], now[1] - start[1]


def contact_counter() -> Stopwatch:
    return Stopwatch([(ElasticCoulomb, "cycle", "contact")])


def of_branch(method: str, run: Callable, level: float, watch: Stopwatch) -> tuple[Row, list]:
    """Return the row and the points of a run that reports its points to ``on_point``."""
    row, laps = Row(level, method), Laps(watch)

    def on_point(point) -> None:
        row.add(len(row.index), point.omega, point.response, Effort(*laps.lap(), point.newton, point.krylov, point.unknowns))

    branch = run(on_point=on_point)
    row.failure = branch.failure
    return row, branch.points


def spread(n: int, n_wanted: int, peak: int) -> list[int]:
    """Return ``n_wanted`` of n points, all if 0: equally spaced in number, the nearest replaced by the peak."""
    if n_wanted == 0 or n_wanted >= n:
        return list(range(n))
    chosen = np.linspace(0, n - 1, n_wanted + 2)[1:-1].round().astype(int)
    chosen[np.argmin(np.abs(chosen - peak))] = peak
    return sorted(set(chosen.tolist()))


def start_of(problem, points, i: int) -> tuple[Iterate, float]:
    """Return the guess for point i, on the secant through the two before, and |U| of the last; of the linear curve if none."""
    harmonics = problem.equation.harmonics
    before = [Iterate(point.U, (point.omega,), harmonics) for point in points[max(i - 2, 0) : i]]
    before = before or [linear_iterate(problem, points[0].omega)]
    return secant(before[0] if len(before) == 2 else None, before[-1], points[i].omega), float(np.linalg.norm(before[-1].U))


def linear_iterate(problem, omega: float) -> Iterate:
    """Return the linear response at a frequency [rad/s]."""
    equation = problem.equation
    return Iterate(equation.linear_motion(problem.at((omega,))), (omega,), equation.harmonics)


def condensed_at(problem, points, chosen: list[int], tolerance: float, watch: Stopwatch) -> Row:
    """Solve the condensed full set at some points of a level."""
    newton, row, laps = CondensedFullSet(problem, tolerance), Row(problem.level, CONDENSED), Laps(watch)
    for i in chosen:
        omega, (guess, size) = points[i].omega, start_of(problem, points, i)
        laps.lap()
        solution = newton.correct(guess, size)
        equation = problem.equation
        p = equation.full_force(equation.contact_forces(solution.iterate.U, equation.every_pair, tangents=False))
        response = output_motion(equation.model, problem.level, omega, p)
        row.add(i, omega, response, Effort(*laps.lap(), solution.newton, 0, newton.unknowns))
        row.failure = row.failure or solution.failure
    return row


def rubin_at(rubin, problem, points, chosen: list[int], tolerance: float, watch: Stopwatch) -> Row:
    """Solve plain Rubin at some points of a level, from its own coordinates under the forces at the two points before."""
    newton, row, laps = PlainRubin(rubin, problem, tolerance), Row(problem.level, RUBIN), Laps(watch)
    for i in chosen:
        omega, size = points[i].omega, start_of(problem, points, i)[1]
        before = points[max(i - 2, 0) : i] or points[:1]
        harmonics, N_H = problem.equation.harmonics, problem.equation.model.N_H
        starts = [
            Iterate(newton.motion_under(point.p.reshape(-1, N_H), point.omega), (point.omega,), harmonics) for point in before
        ]
        guess = secant(starts[0] if len(starts) == 2 else None, starts[-1], omega)
        newton.seconds_of_measure = 0.0
        laps.lap()
        x, iterations, failure = newton.correct(guess.U, omega, size)
        cpu, evaluations = laps.lap()
        own = 1.0 - newton.seconds_of_measure / cpu  # without the time of the common residual measure
        row.add(i, omega, rubin.outputs @ x, Effort(own * cpu, evaluations, iterations, 0, newton.unknowns))
        row.failure = row.failure or failure
    return row


def rubin_bound(level: float, n_unknowns: int) -> Row:
    """Return a lower bound of plain Rubin's time per point: one dense LU of its size."""
    A, row = np.random.default_rng(1).standard_normal((n_unknowns, n_unknowns)), Row(level, RUBIN_BOUND)
    start = time.process_time()
    solve_dense(A, np.ones(n_unknowns))
    effort = Effort(time.process_time() - start, 0, 1, 0, n_unknowns)
    row.add(-1, np.nan, np.full((1, 1), np.nan), effort)
    return row


def at_level(prepared: Prepared, rubin, level: float, dense_points: int, rubin_points: int) -> list[Row]:
    """Run every method on one level."""
    problem, solver, model = prepared.problem(level), prepared.scene.solver, prepared.model
    task = BranchTask(problem, AllPairs(), prepared.sweep, prepared.steps, solver.tolerance)
    follow = partial(follow_branch, task, 10 * prepared.scene.response.points)
    with contact_counter() as watch:
        row, curve = of_branch(ARC, follow, level, watch)
        rows, omegas = [row], advancing(curve, prepared.sweep.direction)
        points: list[Point] = []
        energy = DissipatingPairs(energy_tolerance=solver.energy_tolerance)
        selections: dict[str, Selection] = {REFERENCE: AllPairs(), "adaptive": NonStickingPairs(), "adaptive-energy": energy}
        for method, selection in selections.items():
            solve = partial(at_frequencies, problem, selection, omegas, tolerance=solver.tolerance)
            row, branch = of_branch(method, solve, level, watch)
            rows.append(row)
            points = branch if method == REFERENCE else points
        peak = int(np.argmax([np.abs(point.response[:, 1:3]).max() for point in points]))
        rows.append(condensed_at(problem, points, spread(len(points), dense_points, peak), solver.tolerance, watch))
        if rubin is None:
            rows.append(rubin_bound(level, (6 * model.n_pairs + model.n_modes + len(model.f)) * model.N_H))
        else:
            rows.append(rubin_at(rubin, problem, points, spread(len(points), rubin_points, peak), solver.tolerance, watch))
    return rows


def notes(prepared: Prepared, rubin) -> list[str]:
    """Return the notes below the table."""
    model, solver = prepared.model, prepared.scene.solver
    columns = next(stage for stage in prepared.stages if stage.name.startswith("static columns"))
    of_rubin = (
        "Plain Rubin was not solved: one dense LU of its size stands for a point, a lower bound."
        if rubin is None
        else (
            f"Plain Rubin has {rubin.n_modes} modes of the free bodies, {6 * rubin.n_pairs} interface DOFs and {rubin.n_loads} of the "
            "load; its difference is that of another truncated basis."
        )
    )
    return [
        f"Scene {prepared.scene.name}: {prepared.structure.linearised.system.n_dof:,} DOF, {model.n_pairs} pairs, {model.n_modes} "
        f"modes, H = {model.N_H // 2}, {solver.samples} samples, tolerance {solver.tolerance:g}, one rank.",
        *machine.lines(machine.facts()),
        f"Matrix product {machine.matrix_product_rate():.1f} GFLOP/s, memory {machine.memory_bandwidth():.1f} GB/s, one process.",
        f"All methods start from the secant through the two points before. {of_rubin}",
        f"The static columns of all pairs, {columns.seconds:.2f} s, were solved for before and serve all methods but plain Rubin.",
        "Evaluations are passes of the contact law over pairs, that for the record included. Differences are the largest of any "
        "harmonic of the response, relative to its peak, at the points both solved. Speed-ups are ratios of processor time a point.",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default="jobs/fan_paper.toml")
    parser.add_argument("--levels", type=float, nargs="+", help="N; those of the scene unless given")
    parser.add_argument("--points", type=int, help="of a level; those of the scene unless given")
    parser.add_argument("--dense-points", type=int, default=8, help="points of the condensed full set a level; 0: all")
    parser.add_argument("--rubin-points", type=int, default=2, help="points of plain Rubin a level; 0: none, one LU instead")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--page", type=Path, help="page that gets the tables, and img/ beside it the plot; in DIR unless given")
    options = parser.parse_args()
    prepared = prepare(options.scene, MPI.COMM_SELF, options.points)
    for stage in prepared.stages:
        print(f"{stage.name:<40}{stage.seconds:>9.3f} s{stage.memory:>8.0f} MiB", flush=True)
    rubin = build_rubin(prepared.structure, prepared.scene) if options.rubin_points > 0 else None
    rows, head = [], notes(prepared, rubin)
    for level in options.levels or prepared.scene.response.levels:
        solved = at_level(prepared, rubin, level, options.dense_points, options.rubin_points)
        print(f"level {level:g} N: " + ", ".join(f"{row.method} {1e3 * row.mean('cpu'):.3g} ms" for row in solved), flush=True)
        rows += solved
    print(*Comparison(rows).write(head, options.out, options.page or options.out / "bench_methods.md"), sep="\n")


if __name__ == "__main__":
    main()
