"""A run, and a second one of the same structure with another friction in another folder: times by stage.

    python jobs/bench/second_run.py [SCENE.toml ...] [--ranks 1 2] [--joint 1] [--friction 0.25] [--page docs/costs.md]

The second run is done twice, with its fields on the mesh and without.  Prints a table, a row for each run, and writes it to a
page: wall time of the whole command, and of its stages as in run.log [s].
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import machine
from page_tables import put, table

ROOT = Path(__file__).parents[2]
STAGE = re.compile(r"^(\S.*?) {2,}(\d+\.\d+) +\d+\.\d+%", flags=re.M)
TITLES = "scene", "ranks", "run", "whole", "set-up", "response", "fields", "writing the factor", "pictures"
OTHERS = ("response", "fields for ParaView", "factor for other runs", "pictures")  # stages outside the set-up


def taken(scene: Path, ranks: int, folder: Path, *settings: str) -> dict[str, float]:
    """Return the times of a run by stage [s]; "whole" includes start and end."""
    launch = [os.environ.get("MPIRUN", "mpirun"), "-n", str(ranks)] if ranks > 1 else []
    command = [*launch, sys.executable, "-m", "microslip", "run", str(scene), "--out", str(folder)]
    start = time.perf_counter()
    subprocess.run([*command, *(word for one in settings for word in ("--set", one))], check=True, stdout=subprocess.DEVNULL)
    whole = time.perf_counter() - start
    stages = {name: float(seconds) for name, seconds in STAGE.findall((folder / "run.log").read_text())}
    setup = sum(seconds for name, seconds in stages.items() if name not in (*OTHERS, "total"))
    return {"whole": whole, "set-up": setup, **{name: stages.get(name, 0.0) for name in OTHERS}}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "scenes", nargs="*", type=Path, default=[ROOT / "jobs" / "fan_small.toml", ROOT / "jobs" / "fan_paper.toml"]
    )
    parser.add_argument("--ranks", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--joint", default="1", help="the name or number of the joint")
    parser.add_argument("--friction", type=float, default=0.25, help="of the second run")
    parser.add_argument("--page", type=Path, help="page of the documentation that gets the table")
    options = parser.parse_args()
    other = f"joints.{options.joint}.friction={options.friction}"
    rows = []
    for scene in options.scenes:
        for ranks in options.ranks:
            with tempfile.TemporaryDirectory() as place:
                runs = {"first": (), "second": (other,), "second, no fields": (other, "response.fields=false")}
                for i, (name, settings) in enumerate(runs.items()):
                    stages = taken(scene, ranks, Path(place) / str(i), *settings)
                    rows.append([scene.stem, str(ranks), name, *(f"{seconds:.1f}" for seconds in stages.values())])
                    print(*rows[-1], sep="; ", flush=True)
    lines = table(TITLES, rows, words=3)
    if options.page:
        put(options.page, {"second_run": lines, "second_run_machine": machine.items()})
    print(*lines, sep="\n")


if __name__ == "__main__":
    main()
