"""The cost of the Floquet multipliers of a point compared with its solution, in processor time.

    python jobs/bench/stability.py jobs/fan_small.toml --level 15 --points 40

The curve of one level is computed without stability; then the multipliers of some of its points.
"""

from __future__ import annotations

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import time
from dataclasses import replace
from unittest.mock import patch

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from mpi4py import MPI

from microslip.continuation.branch_points import harmonics_of, iterate_of
from microslip.continuation.levels import follow_level
from microslip.library.build import build
from microslip.library.prepare import prepare
from microslip.scene.read import read_scene
from microslip.stability.multipliers import multipliers_at


def main() -> None:
    """Measure and print, on one rank."""
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("scene")
    options.add_argument("--level", type=float, required=True, help="N")
    options.add_argument("--points", type=int, default=40)
    options.add_argument("--shown", type=int, default=10)
    arguments = options.parse_args()
    scene = read_scene(arguments.scene)
    with build(scene, MPI.COMM_SELF) as structure:
        response = prepare(structure, has_bars=scene.accuracy is not None).response
        response = replace(response, settings=replace(response.settings, points=arguments.points))
        clock = time.process_time()
        with patch.object(time, "perf_counter", time.process_time):  # the clock of ``point.seconds``
            branch = follow_level(response, arguments.level)
        solved, problem, spent = time.process_time() - clock, response.at_level(arguments.level), []
        slipping = [point for point in branch.points if point.state.any()]
        some = slipping[:: max(1, len(slipping) // arguments.shown)]
        print(
            f"{response.model.n_pairs} pairs, {response.model.n_modes} modes, {len(branch.points)} points, {len(slipping)} with slip"
        )
        for point in some:
            harmonics = harmonics_of(branch, point, problem.equation.harmonics)
            there = iterate_of(point, problem, harmonics)
            equation = problem.equation.resolved(harmonics, point.samples)
            clock = time.process_time()
            multipliers = multipliers_at(equation, problem.at((point.omega,)), there.U)
            spent.append(time.process_time() - clock)
            print(
                f"{point.omega / 2.0 / np.pi:10.3f} Hz, {np.count_nonzero(point.state):4d} slip or open: {1e3 * spent[-1]:7.0f} ms; "
                f"solution {1e3 * point.seconds:5.0f} ms; largest multiplier {abs(multipliers.values[0]):.5f}"
            )
        ratios = [multipliers / point.seconds for multipliers, point in zip(spent, some)]
        print(f"multipliers over the solution of the same point: {np.median(ratios):.3g} (median), {max(ratios):.3g} (most)")
        print(f"a point of the curve: {1e3 * solved / len(branch.points):.0f} ms on average, all included")
        print(f"its multipliers: {1e3 * np.median(spent):.0f} ms (median), {1e3 * max(spent):.0f} ms (most), where pairs slip")


if __name__ == "__main__":
    main()
