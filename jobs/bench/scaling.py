"""The gain of more ranks: the same run on several numbers of ranks, stage by stage, and a point of the response.

    python jobs/bench/scaling.py [--sizes small paper] [--ranks 1 2] [--level 15] [--points 12] [--out DIR]

Writes the measured tables of docs/scaling.md; runs and their logs go to DIR (results/scaling).  Times are the program's own, of
the slowest rank; ranks beyond the machine's cores share them, so their times are not meaningful.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import machine
from page_tables import put, table

from microslip.results.fields import read_run
from microslip.results.read import read_results

ROOT = Path(__file__).parents[2]
READING = "model file and pairs"
SET_UP = (READING, "partition", "assembly", "factor of the stuck structure", "modes", "reduction")
POINT = "a point of the response"
MORE = (4, 16, 64)  # ranks of the least times
Stages = dict[str, tuple[float, float]]  # s, and MiB of all ranks at its end, by name


def scene_of(size: str) -> Path:
    """Return the scene of a size, its mesh made unless it is there."""
    mesh = ROOT / "meshes" / f"fan_{size}.msh"
    if not mesh.exists():
        command = [sys.executable, str(ROOT / "meshes" / "fan_sector.py"), "--size", size, "--out", str(mesh)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return ROOT / "jobs" / f"fan_{size}.toml"


def stages_of(scene: Path, ranks: int, level: float, points: int, folder: Path) -> Stages:
    """Run a scene at one level on this number of ranks without a cache, and return its stages and a point."""
    launch = [*shlex.split(os.environ.get("MPIRUN", "mpirun")), "-n", str(ranks)] if ranks > 1 else []
    values = ("--set", f"response.levels=[{level:g}]", "--set", f"response.points={points}")
    command = [*launch, sys.executable, "-m", "microslip", "run", str(scene), *values, "--fresh", "--out", str(folder)]
    environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ, "MICROSLIP_CACHE": "off"}
    subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
    path = str(folder / "results.h5")
    stages: Stages = {}
    for stage in read_run(path).stages:
        name = READING if stage.name in ("model file", "mesh and contact pairs") else stage.name
        stages[name] = (stages.get(name, (0.0, 0.0))[0] + stage.seconds, stage.memory)
    (curve,) = read_results(path, motion=False).levels
    return {**{name: stages[name] for name in SET_UP}, POINT: (float(curve.seconds.mean()), stages["response"][1])}


def seconds(value: float) -> str:
    """Return a time, in ms below a second."""
    return f"{value:.3g} s" if value >= 1.0 else f"{1e3 * value:.3g} ms"


def gain(times: list[float]) -> list[str]:
    """Return the times on each number of ranks, and the speed-up of the last over the first."""
    return [*map(seconds, times), f"{times[0] / times[-1]:.2f}"]


def shared(ranks: list[int], times: list[float]) -> tuple[float, float]:
    """Return the parts a and p [s] of T = a + p / ranks through the first and the last time; p = 0 where more ranks gain nothing."""
    p = max((times[0] - times[-1]) / (1.0 / ranks[0] - 1.0 / ranks[-1]), 0.0)
    return times[0] - p / ranks[0], p


def tables(sizes: dict[str, dict[int, Stages]]) -> dict[str, list[str]]:
    """Return the page's tables by name, from the stages of each size and number of ranks."""
    made, rows, least = {}, [], []
    for size, runs in sizes.items():
        ranks, first = [f"{n} rank{'s' if n > 1 else ''}" for n in runs], next(iter(runs.values()))
        memory = [[f"{run[name][1]:,.0f}" for run in runs.values()] for name in first]
        cells = [[name, *gain([run[name][0] for run in runs.values()]), *of] for name, of in zip(first, memory)]
        times = [f"time, {n}" for n in ranks]
        titles = ("stage, times and memory", *times, "times as fast", *(f"MiB, {n}" for n in ranks))
        made[f"{size}-measured"] = table(titles, cells)
        sums = [sum(run[name][0] for name in run if name != POINT) for run in runs.values()]
        points, target = [run[POINT][0] for run in runs.values()], [*runs][-1] / [*runs][0]
        for what, values in (f"set-up of {size}", sums), (f"a point of {size}", points):
            rows.append([what, f"{target:g}", *gain(values), f"{target * values[-1] / values[0]:.2f}"])
            alone, p = shared([*runs], values)
            least.append([what, *map(seconds, (alone, p, *(alone + p / n for n in MORE)))])
        made["summary"] = table(("what", "target, speed-up", *times, "speed-up", "ratio"), rows)
        made["least"] = table(("what", "not shared, a", "shared, p", *(f"{n} ranks" for n in MORE)), least)
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", nargs="+", default=["small", "paper"], choices=["small", "medium", "paper"])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--level", type=float, default=15.0, help="N")
    parser.add_argument("--points", type=int, default=12, help="as in a scene, along the level that is timed")
    parser.add_argument("--out", type=Path, default=Path("results/scaling"))
    options = parser.parse_args()
    runs: dict[str, dict[int, Stages]] = defaultdict(dict)
    for size in options.sizes:
        for ranks in options.ranks:
            folder = options.out / f"{size}_{ranks}"
            runs[size][ranks] = stages_of(scene_of(size), ranks, options.level, options.points, folder)
            print(f"{size} on {ranks}: a point {seconds(runs[size][ranks][POINT][0])}", flush=True)
    page = {**tables(runs), "machine": machine.items()}
    put(Path("docs/scaling.md"), page)
    print(*page["summary"], sep="\n")


if __name__ == "__main__":
    main()
