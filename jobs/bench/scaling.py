"""What more ranks gain, stage by stage: times on 1 and 2 ranks, work and messages on up to 16, the least time on up to 64.

    python jobs/bench/scaling.py [--sizes small paper] [--ranks small:4,8,16 paper:4,8] [--seconds 440] [--out DIR] [--again]

Writes scaling.json in DIR (results/bench) and the tables of docs/scaling.md; --again makes the tables of scaling.json as it is.
Ranks beyond the machine's cores share them: their messages and processor time are counted, their wall times are not used.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded
import argparse
import json
import shlex
import subprocess
import sys
import time
from pathlib import Path

import machine
from mpi_counter import compiled, preloading
from page_tables import put
from scaling_report import tables

ROOT = Path(__file__).parents[2]


class Runner:
    """Starts measurements, each in a job of its own."""

    def __init__(self, folder: Path, seconds: float):
        self.limit, self.start = seconds, time.monotonic()
        self.library = compiled(folder)

    def left(self) -> float:
        """Return the seconds that are left."""
        return self.limit - (time.monotonic() - self.start)

    def measure(self, request: dict, ranks: int) -> dict | None:
        """Return what scaling_of.py reports on so many ranks; None on more than two for which there is no time."""
        command = [*preloading(self.library), sys.executable, str(Path(__file__).with_name("scaling_of.py")), json.dumps(request)]
        if ranks > 1:
            command = [*shlex.split(os.environ.get("MPIRUN", "mpirun")), "--oversubscribe", "-n", str(ranks), *command]
        start, what = time.monotonic(), f"{Path(request['scene']).stem} on {ranks}"
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as job:
            try:
                printed, _ = job.communicate(timeout=max(self.left(), 0.1) if ranks > 2 else None)
            except subprocess.TimeoutExpired:
                job.terminate()  # mpirun ends its ranks
                job.communicate()
                print(f"{what}: left out, no time for it", flush=True)
                return None
        if job.returncode != 0:
            sys.exit(f"scaling.py: {shlex.join(command)} ended with status {job.returncode}")
        print(f"{what}: {time.monotonic() - start:.1f} s; {self.left():.0f} s are left", flush=True)
        return json.loads(printed.splitlines()[-1])


def scene_of(size: str) -> Path:
    """Return the scene of a size, its mesh made unless it is there."""
    mesh = ROOT / "meshes" / f"fan_{size}.msh"
    if not mesh.exists():
        command = [sys.executable, str(ROOT / "meshes" / "fan_sector.py"), "--size", size, "--out", str(mesh)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return ROOT / "jobs" / f"fan_{size}.toml"


def measured(options) -> dict[str, list[dict]]:
    """Return the runs of each size: on 1 and 2 ranks, then on more, the fewest first, as far as there is time."""
    runner = Runner(options.out.resolve(), options.seconds)
    asked = [(ranks, size) for size in options.sizes for ranks in (1, 2, *options.ranks.get(size, ()))]
    runs: dict[str, list[dict]] = {size: [] for size in options.sizes}
    for ranks, size in sorted(asked, key=lambda one: one[0]):
        run = runner.measure({"scene": str(scene_of(size)), "level": options.level, "points": options.points}, ranks)
        runs[size] += [run] if run else []
    return runs


def counted(text: str) -> tuple[str, tuple[int, ...]]:
    size, ranks = text.split(":")
    return size, tuple(map(int, ranks.split(",")))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", nargs="+", default=["small", "paper"], choices=["small", "medium", "paper"])
    parser.add_argument("--ranks", type=counted, nargs="*", default=[("small", (4, 8, 16)), ("paper", (4, 8))], help="SIZE:RANKS")
    parser.add_argument("--level", type=float, default=15.0, help="N")
    parser.add_argument("--points", type=int, default=12, help="as in a scene, along the level that is timed")
    parser.add_argument("--seconds", type=float, default=440.0, help="after which more ranks than two are no longer run")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--again", action="store_true", help="tables of what was measured before")
    options = parser.parse_args()
    options.ranks = dict(options.ranks)
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / "scaling.json"
    found: dict = json.loads(file.read_text()) if options.again else {"sizes": measured(options), "machine": machine.facts()}
    file.write_text(json.dumps(found, indent=1))
    page = {**tables(found["sizes"]), "machine": [f"- {line}" for line in machine.lines(found["machine"])]}
    put(Path("docs/scaling.md"), page)
    print(*page["summary"], sep="\n")


if __name__ == "__main__":
    main()
