"""Trade of several scenes, and the page of the documentation made of it.

    python jobs/bench/trade_docs.py                                                     # all four scenes, docs/trade.md
    python jobs/bench/trade_docs.py jobs/fan_small.toml --seconds 60                    # one of them again; the page has all

Each scene's section is kept beside its results, results/NAME_trade/section.md, from which the page is put together.
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
from microslip.studies.trade.story import KNOBS, SECONDS, Asked, trade
from microslip.studies.trade.study import TARGETS, Study

SCENES = {
    "jobs/fan_paper.toml": 900.0,
    "jobs/fan_small.toml": SECONDS,
    "jobs/lap_joint.toml": SECONDS,
    "jobs/spatial.toml": SECONDS,
}
WITHOUT_METHODS = ("jobs/fan_paper.toml",)  # rubin alone takes six minutes there: docs/bench_methods.md compares them
MEANING = (
    "More accuracy costs time; this page says how much, and what to state in a scene for 1 %, 0.1 % and 0.01 % of the peak. `microslip trade "
    "SCENE.toml` measures on a scene of your own what is shown here for four. Of all that was run nothing lies left of the black line in a picture, "
    "faster and as good; on the right a dot above the diagonal is a point whose error bar holds its error."
)
ABOUT = (
    "All runs of a scene are solved at the same frequencies, so that they compare point by point. An error is the difference of "
    "the complex amplitude of harmonic 1 of the first output from that of the reference, over the reference's peak on the same level; "
    "`error %` is the largest of all points.",
    "The **reference** has more harmonics, samples and modes than the runs. It is solved beside coarser ones, each with half as much "
    "of one of these; what their differences leave to come, as a geometric series with the ratio seen (taken as at least 1.25 and at "
    "most 4), is what the reference itself may be wrong by. A smaller error is shown as `< ...`, a choice is made only where error and that "
    "together are within the accuracy asked.",
    "`corrected %` is what the corrected amplitude of the error bar is off by, in the time of `+ bars s`. `own %` is what a knob alone does: the difference from the finest value of the same knob, all others as in the base; of harmonics "
    "and methods, from the reference. `time s` is the wall time of the response, `CPU s` its processor time, by which runs are ranked and compared, `+ bars s` the processor time with error bars, which a run has unless its scene says no (an accuracy always has them); the set-up of a row, modes and "
    "reduction, stands apart, and what all rows share (mesh, factor, static columns) is not in it. The time of m modes is read off a straight line "
    "between two eigensolutions that were timed. `bar %` is the largest error bar; `covered %` the share of the points under their bar, `bar/error` the "
    "median, both over the points whose error is above what the reference is known to.",
)
LIMITS = (
    "Times are those of one run on the machine above; a response under a second is solved twice, and the smaller time counts. Differences "
    "of a few per cent between rows mean nothing.",
    "Two levels a scene, some 20 points each. Where a curve has several solutions at a frequency, runs might find different ones; "
    "an error near 100 % says so.",
    "The error bar covers modes, harmonics, samples, dropped pairs and solver, not the mesh, nor the model of the joint.",
    "What did not fit into the time is listed as left out: `--seconds` gives more.",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--seconds", type=float, help="for each scene (default: as in SCENES)")
    parser.add_argument("--out", type=Path, default=Path("docs"))
    options = parser.parse_args()
    comm = MPI.COMM_WORLD
    for name in options.scenes:
        scene, folder = read_scene(name), Path("results", f"{Path(name).stem}_trade")
        start, asked = time.perf_counter(), options.seconds or SCENES.get(name, SECONDS)
        knobs = tuple(knob for knob in KNOBS if knob != "method" or name not in WITHOUT_METHODS)
        study = trade(scene, comm, folder, Asked(knobs=knobs, seconds=asked))
        if comm.rank == 0:
            said = "\n".join(section(name, study, time.perf_counter() - start))
            (folder / "section.md").write_text(said)
    if comm.rank == 0:
        write(comm.size, options.out)


def write(n_ranks: int, out: Path) -> None:
    """Write the page and its pictures, of all scenes that have been run."""
    (out / "img").mkdir(parents=True, exist_ok=True)
    sections = []
    for name in SCENES:
        folder = Path("results", f"{Path(name).stem}_trade")
        if (folder / "section.md").exists():
            shutil.copyfile(folder / "trade.png", out / "img" / f"trade_{Path(name).stem}.png")
            sections.append((folder / "section.md").read_text().splitlines())
    picture = next(line for line in sections[0] if line.startswith("!["))
    sections[0].remove(picture)
    lines = [MEANING, "", picture, "", *map(in_short, sections), "", "## How to read the tables", ""]
    for paragraph in ABOUT:
        lines += [paragraph, ""]
    for section in sections:
        lines += [*section, ""]
    lines += ["## Limits", "", *(f"- {line}" for line in LIMITS)]
    measured = [
        "`python jobs/bench/trade_docs.py`",
        *machine.lines(machine.facts()),
        f"{n_ranks} rank{'s' if n_ranks > 1 else ''}, {time.strftime('%Y-%m-%d')}.",
    ]
    (out / "trade.md").write_text(machine.page("Speed against accuracy", lines, measured))


def in_short(section: list[str]) -> str:
    """Return what a scene's section says of its choices, in a line."""
    choices = (line.replace("--seconds", "`--seconds`") for line in section if line.startswith("for "))
    return f"- **{section[0].removeprefix('## ')}**: {'. '.join(line[0].upper() + line[1:] for line in choices)}."


def section(name: str, study: Study, seconds: float) -> list[str]:
    """Return what is said of one scene."""
    head = [COLUMNS[key] for key in SHOWN]
    cells = [[cell.replace("<", "&lt;") for cell in row] for row in rows(study)]
    reference, *known = reference_lines(study)
    lines = [
        f"## {study.title}",
        "",
        f"`microslip trade {name}`, {seconds:.0f} s, {time.strftime('%Y-%m-%d')}.",
        "",
        f"![{study.title}](img/trade_{study.name}.png)",
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
