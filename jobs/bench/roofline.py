"""How far the kernels of a point are from the limits of the processor: contact forces, products with rows of G and with tangents.

    python jobs/bench/roofline.py [SCENE.toml] [--level 15] [--points 98] [--calls 60]

SCENE is jobs/fan_paper.toml by default.  The response at the level is computed once; its kernel calls are then repeated one by
one (a sample of those of the contact law).  Times are processor time, the least of several runs.  Operations are those that the
formulas need: steps of the law in which a slider stays or moves, their derivatives, two periods of the march (the second shows
that the cycle repeats).  Bytes are operands read once and results written once.  The limit is the larger of two times: operations
over the rate of a matrix product, and bytes over the rate of reading an array of that size, mostly from a cache.  All numbers are
means per point.
"""

from __future__ import annotations

import argparse
import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
from collections import Counter
from unittest.mock import patch

import numpy as np
from kernels import least
from machine import facts
from page_tables import table

from microslip.parallel.petsc import everyone, initialise

initialise()

from prepared import prepare

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.contact.law import STICK
from microslip.continuation import follow
from microslip.continuation.task import BranchTask
from microslip.fourier.coefficients import synthesis_matrix
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.newton_solver import NewtonSolver
from microslip.points.selection import AllPairs
from microslip.receptance.rows import Rows

# floating-point operations, counted in elastic_coulomb.c
STAYS, MOVES, FORCES = 8, 135, 12  # of a step in which the slider stays, moves (circle_step); of p at a sample (find_forces)
MAP = 200  # of the derivatives of a step (sliding_map)


class Calls:
    """The calls of the kernels in a run."""

    def __init__(self) -> None:
        self.cycles: list[tuple] = []
        self.rows: Counter = Counter()  # by (m, n, N, bytes of a number)
        self.tangents: Counter = Counter()  # by (m, 3 N_H, bytes of a number)

    def of(self, run) -> None:
        """Record the calls of a run."""
        cycle, combined, multiply = ElasticCoulomb.cycle, Rows.combined, NewtonSolver._multiply

        def noted_cycle(law, U, n_samples, tangents=True, harmonics=None):
            self.cycles.append((law, U.copy(), n_samples, tangents, harmonics))
            return cycle(law, U, n_samples, tangents, harmonics)

        def noted_rows(rows, p):
            self.rows[*rows.shape, p.shape[1], np.dtype(rows.precision).itemsize] += 1
            return combined(rows, p)

        def noted_product(solver, x, out):
            self.tangents[*solver._P.shape[:2], solver._P.itemsize] += 1
            return multiply(solver, x, out)

        with (
            patch.object(ElasticCoulomb, "cycle", noted_cycle),
            patch.object(Rows, "combined", noted_rows),
            patch.object(NewtonSolver, "_multiply", noted_product),
        ):
            run()


def moving_steps(law: ElasticCoulomb, U: np.ndarray, n_samples: int, harmonics: Harmonics | None) -> np.ndarray:
    """Return the number of steps of a period in which the slider of each pair moves, (n,), by the return map."""
    du = np.tensordot(synthesis_matrix(harmonics or Harmonics.full(U.shape[2]), n_samples), U, axes=(1, 2))
    p, moves = np.zeros((law.n_pairs, 3 + law.n_memory)), np.zeros(law.n_pairs, dtype=int)
    for j in (*range(n_samples), *range(n_samples)):
        moves = moves * (j > 0)
        p, _, state = law.step(du[j], p)
        moves += state != STICK
    return moves


def of_cycle(law, U, n_samples, tangents, harmonics) -> tuple[float, float]:
    """Return the operations and bytes of a cycle."""
    moves, N_H = moving_steps(law, U, n_samples, harmonics), U.shape[2]
    moves = moves[law.cycle(U, n_samples, False, harmonics).active]
    m, n_moves, samples = len(moves), moves.sum(), 6 * n_samples * N_H  # operations from harmonics to samples, and back
    flop = m * (2 * samples + FORCES * n_samples) + 2 * (MOVES * n_moves + STAYS * (m * n_samples - n_moves))
    size = 2 * U.nbytes
    if tangents:
        flop += n_moves * (MAP + 42 * N_H + 12 * N_H**2)  # W after each step, sum of F (x) W
        size += 8 * m * (3 * N_H) ** 2
    return flop, size


def rates(size: float) -> tuple[float, float]:
    """Return operations and bytes per second of one process: of a matrix product, and of reading ``size`` bytes."""
    A = np.full((512, 512), 1.0)
    x, y = np.full((2, max(512, int(size / 16))), 1.0)
    return 2.0 * 512**3 / (1e-6 * least(lambda: A @ A)), 16.0 * len(x) / (1e-6 * least(lambda: x @ y))


def repeated(calls: Calls, n_points: int, n_calls: int) -> list[tuple[str, float, float, float, float]]:
    """Return for each kernel its name, operations, bytes, largest operands [bytes] and time [s], per point."""
    times, rng = [], np.random.default_rng(1)
    for name, tangents in (("contact forces", False), ("contact forces with tangents", True)):
        of_kind = [call for call in calls.cycles if call[3] is tangents]
        chosen = [of_kind[i] for i in rng.permutation(len(of_kind))[:n_calls]]
        counts = np.array([(*of_cycle(*call), 1e-6 * least(lambda: call[0].cycle(*call[1:]))) for call in chosen])  # noqa: B023
        flop, size, seconds = counts.mean(axis=0) * len(of_kind) / n_points
        times.append((name, flop, size, counts[:, 1].max(), seconds))
    totals = np.zeros((2, 3))
    for (m, n, N, width), count in calls.rows.items():
        A, p = (rng.standard_normal(shape).astype(f"f{width}") for shape in ((m, n), (m, N)))
        rows = Rows.of(A)
        totals[0] += count * np.array([2.0 * m * n * N, width * (m * n + m * N + n * N), 1e-6 * least(lambda: rows.combined(p))])  # noqa: B023
    for (m, n, width), count in calls.tangents.items():
        P, x = (rng.standard_normal(shape).astype(f"f{width}") for shape in ((m, n, n), (m, n, 1)))
        totals[1] += count * np.array([2.0 * m * n * n, width * m * n * (n + 2), 1e-6 * least(lambda: np.matmul(P, x))])  # noqa: B023
    largest = [max(m * n * width for m, n, _, width in calls.rows), max(m * n * n * width for m, n, width in calls.tangents)]
    for name, total, operands in zip(("rows of G times forces", "tangents times motion"), totals / n_points, largest):
        times.append((name, total[0], total[1], operands, total[2]))
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="jobs/fan_paper.toml")
    parser.add_argument("--level", type=float, default=15.0, help="N")
    parser.add_argument("--points", type=int, default=98)
    parser.add_argument("--calls", type=int, default=60, help="of the contact law that are repeated")
    given = parser.parse_args()
    prepared, calls = prepare(given.scene, everyone(), given.points), Calls()
    points: list = []
    task = BranchTask(prepared.problem(given.level), AllPairs(), prepared.sweep, prepared.steps, prepared.scene.solver.tolerance)
    calls.of(lambda: follow.follow_branch(task, 10 * given.points, points.append))
    rows = []
    for name, flop, size, operands, seconds in repeated(calls, len(points), given.calls):
        peak, reading = rates(operands)
        limit = max(flop / peak, size / reading)
        rows.append([name, f"{1e-6 * flop:.2f}", f"{1e-6 * size:.2f}", f"{peak / 1e9:.1f}", f"{reading / 1e9:.1f}"])
        rows[-1] += [f"{1e3 * limit:.2f}", f"{1e3 * seconds:.2f}", f"{seconds / limit:.1f}"]
    print(f"{facts()['processor']}; {len(points)} points at {given.level:g} N, {prepared.model.n_pairs} pairs")
    titles = ["kernel", "MFlop", "MB", "peak, GFlop/s", "reading, GB/s", "limit, ms", "measured, ms", "ratio"]
    print(*table(titles, rows), sep="\n")


if __name__ == "__main__":
    main()
