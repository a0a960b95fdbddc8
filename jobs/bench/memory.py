"""The memory that `microslip check` predicts for a run, stage by stage, compared with that of the run.

    python jobs/bench/memory.py [SCENE.toml ...] [--ranks 1 2] [--out DIR] [--page docs/costs.md]

Scenes are jobs/fan_small.toml, jobs/lap_joint.toml and jobs/fan_paper.toml by default.  Each is checked and run on each number of
ranks (mpirun, or $MPIRUN), in separate jobs.  Prints a table, also into a page, and writes memory.json in DIR (results/bench_memory).
Both numbers are the peak resident memory of all ranks together until the end of a stage.
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MICROSLIP_CACHE", "off")  # no set-up comes from the cache
import argparse
import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import machine
from page_tables import put, table

SCENES = ("jobs/fan_small.toml", "jobs/lap_joint.toml", "jobs/fan_paper.toml")
FORESEEN = re.compile(r"^ {11}(\S.*?) {2,}(\d+) +(\d+)( measured)?$")
TAKEN = re.compile(r"^(\S.*?) {2,}[\d.]+ +[\d.]+% +(\d+) +(\d+)$")
WITHIN = 0.3


def program(arguments: list[str], ranks: int) -> str:
    """Return the output of the program on this number of ranks."""
    command = [sys.executable, "-m", "microslip", *arguments]
    if ranks > 1:
        command = [*shlex.split(os.environ.get("MPIRUN", "mpirun")), "--oversubscribe", "-n", str(ranks), *command]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"memory.py: {shlex.join(command)} ended with status {done.returncode}")
    return done.stdout


def stages(text: str, pattern: re.Pattern) -> dict[str, tuple[float, float]]:
    """Return the memory of all ranks and of the largest at the end of each stage [MiB], from the lines that match."""
    matches = [pattern.match(line) for line in text.splitlines()]
    return {one[1]: (float(one[2]), float(one[3])) for one in matches if one is not None}


def compared(foreseen: dict, taken: dict) -> list[dict]:
    """Return the stages that both have, in their order."""
    return [
        {"stage": name, "foreseen": foreseen[name], "taken": taken[name], "ratio": foreseen[name][0] / taken[name][0]}
        for name in foreseen
        if name in taken
    ]


def measure(scene: str, ranks: int, folder: Path) -> dict:
    """Return the predicted and the measured memory of a scene."""
    foreseen = stages(program(["check", scene], ranks), FORESEEN)
    out = folder / f"{Path(scene).stem}_{ranks}"
    shutil.rmtree(out, ignore_errors=True)  # or it would be continued
    program(["run", scene, "--out", str(out)], ranks)
    rows = compared(foreseen, stages((out / "run.log").read_text(), TAKEN))
    print(scene, ranks, [f"{one['stage']} {one['ratio']:.2f}" for one in rows], flush=True)
    return {"scene": Path(scene).stem, "ranks": ranks, "stages": rows}


def measured(runs: list[dict]) -> list[str]:
    """Return the table of all runs: the measured memory of all ranks by stage, and the ratio of the estimate to it."""
    titles, cells = ["stage"], {stage["stage"]: [stage["stage"]] for run in runs for stage in run["stages"]}
    for run in runs:
        titles += [f"{run['scene']}, {run['ranks']} rank{'s' * (run['ranks'] > 1)}", "ratio"]
        by_name = {stage["stage"]: stage for stage in run["stages"]}
        for name, row in cells.items():
            stage = by_name.get(name)
            row += [f"{stage['taken'][0]:,.0f}", f"{stage['ratio']:.2f}"] if stage else ["", ""]
    return table(titles, cells.values())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--out", type=Path, default=Path("results/bench_memory"))
    parser.add_argument("--page", type=Path, help="page of the documentation that gets the table")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    runs = [measure(scene, ranks, options.out) for scene in options.scenes for ranks in options.ranks]
    (options.out / "memory.json").write_text(json.dumps(runs, indent=1))
    lines = measured(runs)
    print(*lines, "", *machine.items(), sep="\n")
    if options.page:
        put(options.page, {"memory": lines, "memory_machine": machine.items()})
    worst = max(abs(stage["ratio"] - 1.0) for one in runs for stage in one["stages"])
    print(f"at worst {worst:.0%} off")
    return int(worst > WITHIN)


if __name__ == "__main__":
    sys.exit(main())
