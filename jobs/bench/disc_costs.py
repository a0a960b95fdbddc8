"""The cost of the nodal diameters of a disc compared with that of a single sector: `microslip modes` of both, in turn.

    python meshes/fan_sector.py --size paper --out meshes/fan_paper.msh
    python meshes/fan_sector.py --size paper --n-blades 24 --out meshes/fan_disc_paper.msh
    python jobs/bench/disc_costs.py [--alone jobs/fan_paper.toml] [--disc jobs/fan_disc_paper.toml] [--diameters 0,3,6] [--count 9]

    python jobs/bench/disc_costs.py --points 5,10,15

Each command is a separate process: assembly, factorisation, modes with the count check, one table and its pictures.  Prints
processor time and peak memory, and the ratios of the disc to the single sector; the targets are those of all nodal diameters.
--points compares response curves with the same harmonics, samples and requested points, without error bars: Newton iterations and
processor time per point, the least of four curves of each scene in turn.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time

from page_tables import table

import microslip

TURNS = 4  # curves of each level and scene
TARGETS = {"processor time, s": 3.0, "peak memory, MiB": 1.5}


def measured(scene: str, *more: str) -> dict[str, float]:
    """Return processor time [s] and peak memory [MiB] of the modes of a scene."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "microslip", "modes", scene, "--out", folder, *more]
        silent = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
        process = os.posix_spawn(command[0], command, os.environ | {"OPENBLAS_NUM_THREADS": "1"}, file_actions=silent)
        _, status, used = os.wait4(process, 0)
    if status != 0:
        sys.exit(f"disc_costs.py: {' '.join(command)} ended with status {os.waitstatus_to_exitcode(status)}")
    return dict(zip(TARGETS, (used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0), strict=True))


def cost_of_points(structure: microslip.Structure, level: float) -> list[float]:
    """Return points, Newton iterations and processor time [ms] of a point on the curve of a level [N]."""
    start = time.process_time()
    curve = microslip.respond(structure, levels=level).results.levels[0]
    n = len(curve.newton)
    return [n, curve.newton.sum() / n, 1e3 * (time.process_time() - start) / n]


def compare_points(alone: str, disc: str, levels: list[float]) -> None:
    """Print the cost of points of both scenes at some levels [N]: the least of curves in turn, with all static columns computed."""
    keys = ["solver.modes=9", "solver.harmonics=3", "solver.samples=96", "response.points=60", "solver.error_bars=false"]
    structures = [microslip.build(microslip.read(path, keys)) for path in (alone, disc)]
    rows = []
    for level in levels:
        turns = [[cost_of_points(structure, level) for structure in structures] for _ in range(1 + TURNS)][1:]
        costs = [min(of_scene, key=lambda cost: cost[2]) for of_scene in zip(*turns)]
        ratio = f"{costs[1][2] / costs[0][2]:.2f}"
        rows.append([f"{level:g}", *(f"{a:.3g}, {b:.3g}" for a, b in zip(*costs, strict=True)), ratio, "2.5"])
    print("\n".join(table(["level, N", "points", "iterations of each", "ms of each", "ratio", "target"], rows)))
    for structure in structures:
        structure.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--alone", default="jobs/fan_paper.toml", help="scene of the single sector (%(default)s)")
    parser.add_argument("--disc", default="jobs/fan_disc_paper.toml", help="scene of the disc (%(default)s)")
    parser.add_argument("--diameters", default="", help="nodal diameters, 0,3,6 (all)")
    parser.add_argument("--count", default="9", help="modes of each (%(default)s)")
    parser.add_argument("--points", default="", help="levels [N] of curves whose points are compared, 5,10,15")
    arguments = parser.parse_args()
    if arguments.points:
        return compare_points(arguments.alone, arguments.disc, [float(level) for level in arguments.points.split(",")])
    alone = measured(arguments.alone, "--count", arguments.count)
    chosen = ["--diameters", arguments.diameters] if arguments.diameters else []
    disc = measured(arguments.disc, "--count", arguments.count, *chosen)
    rows = [
        [name, f"{alone[name]:,.1f}", f"{disc[name]:,.1f}", f"{disc[name] / alone[name]:.2f}", f"{target:g}"]
        for name, target in TARGETS.items()
    ]
    what = f"nodal diameters {arguments.diameters}" if arguments.diameters else "all nodal diameters"
    print("\n".join(table(["", "sector alone", what, "ratio", "target of all"], rows)))


if __name__ == "__main__":
    main()
