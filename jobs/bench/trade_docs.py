"""Trade of several scenes: the measured parts of docs/trade.md.

python jobs/bench/trade_docs.py                                                     # all four scenes, docs/trade.md
python jobs/bench/trade_docs.py jobs/fan_small.toml --seconds 60                    # one of them again

"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded
import argparse
import shutil
import time
from pathlib import Path

from microslip.parallel.petsc import initialise

initialise()
import machine
from mpi4py import MPI
from page_tables import put

from microslip.scene.read import read_scene
from microslip.studies.trade.report import (
    COLUMNS,
    SHOWN,
    choice_lines,
    failure_lines,
    front_lines,
    mesh_lines,
    reference_lines,
    rows,
    sentences,
    validation_lines,
)
from microslip.studies.trade.story import KNOBS, SECONDS, Request, trade
from microslip.studies.trade.study import TARGETS, Study

SCENES = {
    "jobs/fan_paper.toml": 900.0,
    "jobs/fan_small.toml": SECONDS,
    "jobs/lap_joint.toml": SECONDS,
    "jobs/spatial.toml": SECONDS,
}
WITHOUT_METHODS = ("jobs/fan_paper.toml",)  # rubin alone takes six minutes there: docs/bench_methods.md compares them


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--seconds", type=float, help="for each scene (default: as in SCENES)")
    parser.add_argument("--out", type=Path, default=Path("docs"))
    options = parser.parse_args()
    comm = MPI.COMM_WORLD
    parts: dict[str, list[str]] = {}
    for name in options.scenes:
        scene, folder = read_scene(name), Path("results", f"{Path(name).stem}_trade")
        start, asked = time.perf_counter(), options.seconds or SCENES.get(name, SECONDS)
        knobs = tuple(knob for knob in KNOBS if knob != "method" or name not in WITHOUT_METHODS)
        study = trade(scene, comm, folder, Request(knobs=knobs, seconds=asked))
        if comm.rank == 0:
            parts |= of_scene(name, study, time.perf_counter() - start)
            (options.out / "img").mkdir(parents=True, exist_ok=True)
            shutil.copyfile(folder / "trade.png", options.out / "img" / f"trade_{Path(name).stem}.png")
    if comm.rank == 0:
        ranks = f"{comm.size} rank{'s' if comm.size > 1 else ''}, {time.strftime('%Y-%m-%d')}."
        parts["machine"] = [f"- {line}" for line in (*machine.lines(machine.facts()), ranks)]
        put(options.out / "trade.md", parts)


def of_scene(name: str, study: Study, seconds: float) -> dict[str, list[str]]:
    """Return the parts of the page that are of one scene: its section, and its choices in a line."""
    lines, stem = section(name, study, seconds), Path(name).stem
    return {f"{stem}-short": [in_short(study.title, lines)], stem: lines}


def in_short(title: str, section: list[str]) -> str:
    """Return what a scene's section says of its choices, in a line."""
    choices = (line.replace("--seconds", "`--seconds`") for line in section if line.startswith("for "))
    return f"- **{title}**: {'. '.join(line[0].upper() + line[1:] for line in choices)}."


def section(name: str, study: Study, seconds: float) -> list[str]:
    """Return what is said of one scene."""
    head = [COLUMNS[key][0] for key in SHOWN]
    cells = [[cell.replace("<", "&lt;") for cell in row] for row in rows(study)]
    reference, *known = reference_lines(study)
    lines = [
        f"`microslip trade {name}`, {seconds:.0f} s, {time.strftime('%Y-%m-%d')}.",
        "",
        reference[0].upper() + reference[1:] + ":",
        "",
        *(f"- {line.strip()}" for line in known),
        "",
        *(line[0].upper() + line[1:] + "." for line in validation_lines(study)),
        "",
        "| " + " | ".join(head) + " |",
        "| " + " | ".join(["---"] * 2 + ["---:"] * (len(head) - 2)) + " |",
        *("| " + " | ".join(row) + " |" for row in cells),
        "",
    ]
    shared = ", ".join(f"{stage} {spent:.2g} s" for stage, spent in study.shared.items())
    lines += [f"Shared by all: {shared}.", "", *(f"{line[0].upper()}{line[1:]}.\n" for line in failure_lines(study))]
    lines += ["What each knob costs and buys:", "", *(f"- {line}" for line in sentences(study)), ""]
    lines += [
        "The front, of which nothing that was run is both faster and better:",
        "",
        "```text",
        *front_lines(study),
        "```",
        "",
    ]
    lines += ["What it would choose:", "", "```text"]
    for target in TARGETS:
        lines += choice_lines(study, target)
    return [*lines[:-1], "```", "", *mesh_lines(study)]


if __name__ == "__main__":
    main()
