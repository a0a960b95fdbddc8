"""Random structures: is a point stable exactly if a small disturbance of its time integration decays?

    PYTHONPATH=solver:tests python tests/verification/random_stability.py --systems 12 [--seed 1] [--harmonics 9 --samples 256]

The structures, levels and points are those of random_systems.py.  oracles/shooting.py integrates the full system in time to the
steady state at the frequency of each point, and differences of its map of a period describe the growth of small disturbances: the
largest eigenvalue of that map is compared with the largest multiplier of the program.  Where differences of other sizes, or
in the other direction, have other eigenvalues, the map has a corner and no derivative: a slider rests exactly at its limit, where the march to its
rest position ends.  At such points two disturbed motions are integrated until the disturbance decays or grows.
Points with another steady state are not compared.  Points whose note states that their stability is uncertain are counted.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from matrix_scenes import write_matrix_scene
from oracles import shooting
from verification.random_structures import draw
from verification.random_systems import HERE, STEADY, chosen

from microslip.continuation.levels import follow_levels
from microslip.continuation.point_record import DOUBTFUL
from microslip.library.build import build
from microslip.library.prepare import prepare
from microslip.points.multipliers import BEYOND, is_stable
from microslip.scene.read import changed, read_scene

SAME = 0.02  # of the amplitude: a steady state at a larger distance is another one
SIZES = (1e-7, 1e-9, -1e-9)  # of the differences, relative to the size of the state, in both directions
CORNER = 0.005  # relative to the largest eigenvalue: these differences differ by more where the map has a corner


@dataclass
class Judged:
    """A point with its largest multiplier by the program and by time integration."""

    number: int  # of the system
    level: float
    omega: float
    slips: bool
    computed: float
    integrated: float
    at_corner: bool  # of the map: ``integrated`` is no derivative
    is_stable: bool  # by time integration
    fold: float  # smallest singular value of the derivative of (end - begin)
    is_noted: bool  # as uncertain

    @property
    def agrees(self) -> bool:
        """Whether the program and time integration agree on stability."""
        return (self.computed <= 1.0 + BEYOND) == self.is_stable


def judge(seed: int, number: int, points: int, solver: dict, steps: int, lift_off: bool) -> tuple[list[Judged], int]:
    """Return the compared points of a system, and how many are near another steady state."""
    system, judged, others = draw(seed, number, lift_off), [], 0
    output = int(np.argmax(system["output"]))
    with tempfile.TemporaryDirectory() as folder:
        path = write_matrix_scene(
            Path(folder), system, sorted(system["levels"].values()), system["omega"], outputs=[output], **{"points": 12, **solver}
        )
        scene = changed(read_scene(path), {"response": {"stability": True}})
        with build(scene, HERE) as structure:
            branches = follow_levels(prepare(structure, has_bars=True).response)
    for branch in branches:
        sizes = [float(np.hypot(*point.response[0, 1:3])) for point in branch.points]
        for i in chosen(sizes, points):
            point = branch.points[i]
            of = shooting.Point(system, branch.level, point.omega)
            steady, _ = of.by_rule(of.state_of(np.asarray(point.p)), steps)
            if steady.distance > STEADY or abs(abs(steady.amplitude) - sizes[i]) > SAME * max(sizes):
                others += 1
                continue
            computed = float(np.hypot(*point.multipliers[0]))
            assert (computed <= 1.0 + BEYOND) == is_stable(point.multipliers)
            values = bool(np.any(point.state)), computed, *integrated(of, steady, steps), DOUBTFUL in point.notes
            judged.append(Judged(number, branch.level, point.omega, *values))
    return judged, others


def integrated(of: shooting.Point, steady: shooting.Steady, steps: int) -> tuple[float, bool, bool, float]:
    """Return the results of time integration for a steady state: the last four values of :class:`Judged`."""
    sizes = [of.largest_multiplier(steady.x, steps, size) for size in SIZES]
    at_corner = np.ptp(sizes) > CORNER
    stable = of.forgets(steady.x, steps, np.random.default_rng(0)) if at_corner else sizes[1] <= 1.0 + BEYOND
    return sizes[1], at_corner, stable, steady.fold


def main():
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for name, value in (
        ("seed", 1),
        ("systems", 12),
        ("first", 0),
        ("points", 6),
        ("steps", 1024),
        ("harmonics", 9),
        ("samples", 256),
    ):
        options.add_argument(f"--{name}", type=int, default=value)
    options.add_argument("--lift-off", action="store_true")
    arguments, start = options.parse_args(), time.perf_counter()
    solver = {"harmonics": arguments.harmonics, "samples": arguments.samples}
    results = [
        judge(arguments.seed, arguments.first + i, arguments.points, solver, arguments.steps, arguments.lift_off)
        for i in range(arguments.systems)
    ]
    judged = [result for each, _ in results for result in each]
    others = sum(count for _, count in results)
    print(
        f"{len(judged)} points of {arguments.systems} systems, {others} more beside another steady state; {time.perf_counter() - start:.0f} s"
    )
    for name, some in (("all", judged), ("of which pairs move", [result for result in judged if result.slips])):
        if some:
            off = np.array([abs(result.computed - result.integrated) for result in some if not result.at_corner])
            unstable, corners, noted = (
                sum(of) for of in zip(*((not result.is_stable, result.at_corner, result.is_noted) for result in some))
            )
            alike = np.mean([result.agrees for result in some if not result.is_noted])
            print(
                f"{name}: {len(some)} points, {unstable} unstable, {corners} at a corner, {noted} noted as uncertain; the others judged alike {100.0 * alike:.1f} %; "
                f"largest multiplier off by {np.median(off):.1e} (median), {np.quantile(off, 0.95):.1e} (95 %), {off.max():.1e} (most)"
            )
    for result in judged:
        if not result.agrees or (not result.at_corner and abs(result.computed - result.integrated) > 0.05):
            print(
                f"system {result.number}, level {result.level:.4g}, omega {result.omega:.6g}: {result.computed:.5f}, integrated {result.integrated:.5f}, "
                f"{'stable' if result.is_stable else 'unstable'}{', at a corner' if result.at_corner else ''}{', noted' if result.is_noted else ''}, fold {result.fold:.1e}"
            )


if __name__ == "__main__":
    main()
