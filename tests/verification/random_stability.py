"""Random structures: is a point stable where a small disturbance of its time integration decays?

    PYTHONPATH=solver:tests python tests/verification/random_stability.py --systems 12 [--seed 1] [--harmonics 9 --samples 256]

The structures, levels and points are those of random_systems.py.  oracles/shooting.py integrates the full system in time to the
steady state beside each point, and differences of its map of a period say what becomes of small disturbances there: the largest
eigenvalue of that map beside the largest multiplier of the program.  Points whose steady state is another one are not judged.
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
from microslip.library.build import build
from microslip.library.prepare import prepare
from microslip.points.multipliers import BEYOND, is_stable
from microslip.scene.read import changed, read_scene

SAME = 0.02  # of the amplitude: a steady state further off is another one


@dataclass
class Judged:
    """A point: the largest multiplier by the program and by time integration."""

    number: int  # of the system
    level: float
    omega: float
    slips: bool
    found: float
    integrated: float

    @property
    def agrees(self) -> bool:
        """Whether both say stable, or both unstable."""
        return (self.found > 1.0 + BEYOND) == (self.integrated > 1.0 + BEYOND)


def judge(seed: int, number: int, points: int, solver: dict, steps: int, lift_off: bool) -> tuple[list[Judged], int]:
    """Return the judged points of a system, and how many have no steady state beside them."""
    system, judged, others = draw(seed, number, lift_off), [], 0
    output = int(np.argmax(system["output"]))
    with tempfile.TemporaryDirectory() as folder:
        path = write_matrix_scene(
            Path(folder), system, sorted(system["levels"].values()), system["omega"], outputs=[output], **{"points": 12, **solver}
        )
        scene = changed(read_scene(path), {"response": {"stability": True}})
        with build(scene, HERE) as structure:
            branches = follow_levels(prepare(structure, has_bars=scene.accuracy is not None).response)
    for branch in branches:
        sizes = [float(np.hypot(*point.response[0, 1:3])) for point in branch.points]
        for i in chosen(sizes, points):
            point = branch.points[i]
            of = shooting.Point(system, branch.level, point.omega)
            steady, _ = of.by_rule(of.state_of(np.asarray(point.p)), steps)
            if steady.distance > STEADY or abs(abs(steady.amplitude) - sizes[i]) > SAME * max(sizes):
                others += 1
                continue
            integrated = np.abs(np.linalg.eigvals(of.derivative(steady.x, steps) + np.eye(len(steady.x)))).max()
            found = float(np.hypot(*point.multipliers[0]))
            assert (found <= 1.0 + BEYOND) == is_stable(point.multipliers)
            judged.append(Judged(number, branch.level, point.omega, bool(np.any(point.state)), found, float(integrated)))
    return judged, others


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
    asked, start = options.parse_args(), time.perf_counter()
    solver = {"harmonics": asked.harmonics, "samples": asked.samples}
    results = [
        judge(asked.seed, asked.first + i, asked.points, solver, asked.steps, asked.lift_off) for i in range(asked.systems)
    ]
    judged = [one for found, _ in results for one in found]
    others = sum(count for _, count in results)
    print(
        f"{len(judged)} points of {asked.systems} systems, {others} more beside another steady state; {time.perf_counter() - start:.0f} s"
    )
    for name, some in (("all", judged), ("of which pairs move", [one for one in judged if one.slips])):
        if some:
            off = np.array([abs(one.found - one.integrated) for one in some])
            unstable = sum(one.integrated > 1.0 + BEYOND for one in some)
            print(
                f"{name}: {len(some)} points, {unstable} unstable; judged alike {100.0 * np.mean([one.agrees for one in some]):.1f} %; "
                f"largest multiplier off by {np.median(off):.1e} (median), {np.quantile(off, 0.95):.1e} (95 %), {off.max():.1e} (most)"
            )
    for one in judged:
        if not one.agrees or abs(one.found - one.integrated) > 0.05:
            print(
                f"system {one.number}, level {one.level:.4g}, omega {one.omega:.6g}: {one.found:.5f}, integrated {one.integrated:.5f}"
            )


if __name__ == "__main__":
    main()
