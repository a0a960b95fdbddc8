"""The same job with the version of an earlier commit and with this one, in turn: times of the whole command and of its stages.

    python jobs/bench/compare_commits.py COMMIT [SCENE.toml ...] [--ranks 2] [--times 3] [--set KEY=VALUE ...]

The commit is checked out into a temporary folder, and its compiled files are built there with this Python.  Both versions run the
same scene and mesh, without a cache.  Prints a table for each scene: the median wall times [s] and the peak memory of all ranks
[MiB], from run.log, the whole command including start and end, and the peak of each level.
"""

from __future__ import annotations

import argparse
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import machine

ROOT = Path(__file__).parents[2]
STAGE = re.compile(r"^(\S.*?) {2,}(\d+\.\d+) +\d+\.\d+% +(\d+)", flags=re.M)
PEAK = re.compile(r"^level \d+ of \d+: (\S+ N): (\d+) points.*peak (\S+ m) .* at (\S+ Hz)", flags=re.M)


@dataclass(frozen=True)
class Run:
    """Cost and peaks of one run."""

    seconds: dict[str, float]  # by stage; "whole" is the command
    memory: float  # MiB, all ranks
    peaks: tuple[tuple[str, ...], ...]  # level, points, amplitude, frequency


@contextmanager
def version_of(commit: str) -> Iterator[Path]:
    """Yield the folder of a commit's package, built."""
    with tempfile.TemporaryDirectory() as place:
        tree = Path(place) / "tree"
        subprocess.run(["git", "worktree", "add", "--detach", str(tree), commit], cwd=ROOT, check=True, capture_output=True)
        try:
            build = [sys.executable, "setup.py", "build_ext", "--inplace"]
            subprocess.run(build, cwd=tree, check=True, capture_output=True)
            yield tree / "solver"
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(tree)], cwd=ROOT, check=True, capture_output=True)


def run(package: Path, scene: Path, ranks: int, settings: list[str]) -> Run:
    """Run a version and return its cost and peaks."""
    environment = {**os.environ, "PYTHONPATH": str(package), "MICROSLIP_CACHE": "off"}
    launch = [os.environ.get("MPIRUN", "mpirun"), "-n", str(ranks)] if ranks > 1 else []
    with tempfile.TemporaryDirectory() as folder:
        command = [*launch, sys.executable, "-m", "microslip", "run", str(scene), "--out", folder]
        start = time.perf_counter()
        subprocess.run(
            [*command, *(word for one in settings for word in ("--set", one))],
            check=True,
            stdout=subprocess.DEVNULL,
            env=environment,
        )
        whole = time.perf_counter() - start
        return read(Path(folder, "run.log").read_text(encoding="utf-8"), whole)


def read(log: str, whole: float) -> Run:
    """Return the run of a log; ``whole`` is the wall time of the command [s]."""
    stages = STAGE.findall(log)
    seconds = {name: float(taken) for name, taken, _ in stages if name != "total"}
    return Run(seconds | {"whole": whole}, max(float(memory) for *_, memory in stages), tuple(PEAK.findall(log)))


def table(before: list[Run], now: list[Run], commit: str) -> list[str]:
    """Return the lines of the table of two versions' runs."""
    names = list(dict.fromkeys(name for one in (*now, *before) for name in one.seconds if name != "whole"))
    rows = [f"| | {commit}, s | now, s | ratio |", "| --- | ---: | ---: | ---: |"]
    for name in [*names, "whole"]:
        a, b = (statistics.median(one.seconds.get(name, 0.0) for one in runs) for runs in (before, now))
        rows.append(f"| {name} | {a:.2f} | {b:.2f} | {a / b:.2f} |" if b > 0.0 else f"| {name} | {a:.2f} | {b:.2f} | |")
    memory = [max(one.memory for one in runs) for runs in (before, now)]
    rows.append(f"| memory, MiB | {memory[0]:,.0f} | {memory[1]:,.0f} | {memory[0] / memory[1]:.2f} |")
    rows += ["", f"| level | {commit}: points, peak | now: points, peak |", "| --- | --- | --- |"]
    peaks = [{level: f"{n}, {peak} at {where}" for level, n, peak, where in runs[0].peaks} for runs in (before, now)]
    for level in sorted(peaks[1], key=lambda level: float(level.split()[0])):
        rows.append(f"| {level} | {peaks[0].get(level, '–')} | {peaks[1][level]} |")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit")
    parser.add_argument("scenes", nargs="*", type=Path, default=[ROOT / "jobs" / "fan_paper.toml"])
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    arguments = parser.parse_args()
    print(*machine.lines(machine.facts()), f"Load: {os.getloadavg()[0]:.1f}.", sep="\n")
    with version_of(arguments.commit) as earlier:
        for scene in arguments.scenes:
            before, now = list[Run](), list[Run]()
            for _ in range(arguments.times):
                before.append(run(earlier, scene, arguments.ranks, arguments.settings))
                now.append(run(ROOT / "solver", scene, arguments.ranks, arguments.settings))
            head = ", ".join([scene.stem, f"{arguments.ranks} ranks", *arguments.settings])
            print(f"\n{head}", "", *table(before, now, arguments.commit), sep="\n")


if __name__ == "__main__":
    main()
