"""Whole jobs from 10 to 10,000 contact pairs and from a thousand to two million degrees of freedom: time and memory.

    python jobs/bench/sizes.py [--jobs lap_10 demo ...] [--ranks 1] [--docs docs] [--readme README.md]

Each job is one `microslip run`: mesh, modes with the check of their number, all levels of the scene with error bars, fields,
pictures.  Its mesh is generated in a temporary folder; no cache is used.  Writes the table of docs/costs.md and the smaller one
of README.md, and prints the first.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import machine
from compare_commits import STAGE
from page_tables import put, table

ROOT = Path(__file__).parents[2]
SIZE = re.compile(r"^(\d+) DOF, (\d+) contact pairs", flags=re.M)
LEVEL = re.compile(r"^level \d+ of \d+: (\S+ N): (\d+) points.*?(\d+) of \d+ pairs slip", flags=re.M)
SET_UP = ("response", "fields for ParaView", "factor for other runs", "pictures", "total")  # stages outside the set-up


@dataclass(frozen=True)
class Job:
    """A scene on a generated mesh."""

    title: str
    scene: str
    mesh: str  # generator in meshes/ and its options
    settings: tuple[str, ...] = ()  # of the scene, changed for this job


MILLION = "--span 180 --chord 31 --thickness 7 --fillet 6 --neck 5 --flank 5 --lobe 9 --wall 6 --post 12 --slot 11 --ring 14"
TWO_MILLION = "--span 226 --chord 39 --thickness 9 --fillet 7 --neck 6 --flank 6 --lobe 11 --wall 8 --post 15 --slot 14 --ring 17"
JOBS = {
    "lap_10": Job("lap joint, hex8", "lap_joint", "lap_joint --kind hex8 --n-width 1"),
    "demo": Job("fan-blade sector, small mesh (the demo)", "fan_small", "fan_sector --size small"),
    "paper": Job("fan-blade sector, the mesh of the paper's size", "fan_paper", "fan_sector --size paper"),
    "lap_2000": Job(
        "lap joint, hex8", "lap_joint", "lap_joint --kind hex8 --n-overlap 54 --n-width 35 --n-free 30 --n-thickness 4"
    ),
    "lap_10000": Job(
        "lap joint, hex8",
        "lap_joint",
        "lap_joint --kind hex8 --n-overlap 124 --n-width 79 --n-free 40 --n-thickness 2",
        ("response.levels=[0.1, 0.5]",),
    ),
    "million": Job("fan-blade sector", "fan_paper", f"fan_sector --size paper {MILLION}"),
    "two_million": Job("fan-blade sector", "fan_paper", f"fan_sector --size paper {TWO_MILLION}"),
}
USUAL = "lap_10", "demo", "paper", "lap_2000"  # the others take from seven minutes to an hour
TITLES = "job", "contact pairs", "DOF", "levels; points", "pairs that slip, at most", "set-up, s", "response, s", "whole, s"


@dataclass(frozen=True)
class Cost:
    """Cost of a job: its log, wall and processor time of the whole command [s], of all ranks together."""

    log: str
    wall: float
    processor: float

    def cells(self) -> list[str]:
        """Return the cells of the row after the title of the job; the last one is the memory of all ranks [MiB]."""
        [(dof, pairs)] = SIZE.findall(self.log)
        levels, stages = LEVEL.findall(self.log), STAGE.findall(self.log)
        seconds = {name: float(spent) for name, spent, _ in stages}
        set_up = sum(spent for name, spent in seconds.items() if name not in SET_UP)
        points, slipping = sum(int(count) for _, count, _ in levels), max(int(count) for *_, count in levels)
        times = (f"{spent:.3g}" for spent in (set_up, seconds["response"], self.wall, self.processor))
        memory = max(float(memory) for *_, memory in stages)
        return [f"{int(pairs):,}", f"{int(dof):,}", f"{len(levels)}; {points}", f"{slipping:,}", *times, f"{memory:,.0f}"]


def cost(job: Job, ranks: int) -> Cost:
    """Run a job and return its cost."""
    launch = [os.environ.get("MPIRUN", "mpirun"), "-n", str(ranks)] if ranks > 1 else []
    environment = {**os.environ, "MICROSLIP_CACHE": "off", "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        generator, *options = job.mesh.split()
        mesh, results = Path(folder, "model.msh"), Path(folder, "results")
        made = [sys.executable, str(ROOT / "meshes" / f"{generator}.py"), *options, "--out", str(mesh)]
        subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
        command = [*launch, sys.executable, "-m", "microslip", "run", str(ROOT / "jobs" / f"{job.scene}.toml")]
        settings = (f'model.mesh="{mesh}"', *job.settings)
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(
            [*command, *(word for setting in settings for word in ("--set", setting)), "--out", str(results)],
            check=True,
            stdout=subprocess.DEVNULL,
            env=environment,
        )
        wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return Cost((results / "run.log").read_text(encoding="utf-8"), wall, processor)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", nargs="+", choices=JOBS, default=USUAL)
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--docs", type=Path, default=Path("docs"))
    parser.add_argument("--readme", type=Path, default=Path("README.md"))
    options = parser.parse_args()
    rows = []
    for name in options.jobs:
        rows.append([JOBS[name].title, *cost(JOBS[name], options.ranks).cells()])
        print("; ".join(rows[-1]), flush=True)
    ranks = f"{options.ranks} rank{'s' if options.ranks > 1 else ''}"
    lines = table((*TITLES, "processor, s", "memory, MiB"), rows)
    put(options.docs / "costs.md", {"sizes": lines, "sizes_machine": [f"- {ranks}.", *machine.items()]})
    small = table(
        ("contact pairs", "DOF", "points", "seconds", "MiB"), [[*row[1:3], row[3].split()[1], row[7], row[9]] for row in rows], 0
    )
    put(options.readme, {"sizes": [*small, "", f"{machine.processor()}, {ranks}, {time.strftime('%Y-%m-%d')}."]})
    print(*lines, sep="\n")


if __name__ == "__main__":
    main()
