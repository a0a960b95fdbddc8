"""Trade of several scenes: the measured parts of docs/trade.md.

python jobs/bench/trade_docs.py                                                     # all four scenes, docs/trade.md
python jobs/bench/trade_docs.py jobs/fan_small.toml --seconds 60                    # measures one of them again
python jobs/bench/trade_docs.py --draw                                              # the page from stored measurements

A measurement is stored in results/SCENE_trade/measured.json.  The first table of the page has rows of all stored measurements.
"""

from __future__ import annotations

import os

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import argparse
import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from microslip.parallel.petsc import initialise

initialise()
import machine
import numpy as np
from mpi4py import MPI
from page_tables import put, table

from microslip.scene.read import read_scene
from microslip.studies.trade import command
from microslip.studies.trade.report import (
    COLUMNS,
    SHOWN,
    accuracy_sentences,
    choice_lines,
    failure_lines,
    mesh_lines,
    reference_lines,
    rows,
    validation_lines,
    write_trade,
)
from microslip.studies.trade.study import TARGETS, Check, Curve, Reference, Run, Setting, Study

SCENES = {
    "jobs/fan_paper.toml": 900.0,
    "jobs/fan_small.toml": command.SECONDS,
    "jobs/lap_joint.toml": command.SECONDS,
    "jobs/spatial.toml": command.SECONDS,
}
WITHOUT_METHODS = ("jobs/fan_paper.toml",)  # rubin alone takes six minutes there: docs/bench_methods.md compares them
CHOSEN = "scene", "target, % of the peak", "error measured, %", "ratio", "response, s", "set-up, s", "command"


@dataclass(frozen=True)
class Measured:
    """A study of a scene, and the conditions of its measurement."""

    scene: str
    study: Study
    seconds: float
    date: str
    machine: list[str]  # processor, versions, ranks


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--seconds", type=float, help="for each scene (default: as in SCENES)")
    parser.add_argument("--draw", action="store_true", help="write the page and pictures from stored measurements")
    parser.add_argument("--out", type=Path, default=Path("docs"))
    options = parser.parse_args()
    comm = MPI.COMM_WORLD
    for name in () if options.draw else options.scenes:
        measure(name, comm, options.seconds or SCENES.get(name, command.SECONDS))
    if comm.rank == 0:
        write_page(options.scenes, options.out)


def measure(name: str, comm: MPI.Comm, seconds: float) -> None:
    """Measure a scene and store the result.  Collective."""
    start, parameters = time.perf_counter(), [key for key in command.PARAMETERS if key != "method" or name not in WITHOUT_METHODS]
    study = command.study(read_scene(name), comm, folder_of(name), command.Request(parameters=tuple(parameters), seconds=seconds))
    if comm.rank == 0:
        date, ranks = time.strftime("%Y-%m-%d"), f"{comm.size} rank{'s' if comm.size > 1 else ''}"
        facts = [*machine.lines(machine.facts()), f"{ranks}, {date}."]
        stored(name).write_text(to_json(Measured(name, study, time.perf_counter() - start, date, facts)))


def write_page(names: Sequence[str], out: Path) -> None:
    """Write the parts of the page that belong to scenes, and the first table from all stored measurements.  Local."""
    everything = [from_json(stored(name).read_text()) for name in dict.fromkeys([*SCENES, *names]) if stored(name).exists()]
    parts: dict[str, list[str]] = {"chosen": table(CHOSEN, [row for each in everything for row in chosen(each)])}
    (out / "img").mkdir(parents=True, exist_ok=True)
    for each in everything:
        if each.scene in names:
            folder, stem = folder_of(each.scene), Path(each.scene).stem
            write_trade(each.study, read_scene(each.scene), str(folder))
            shutil.copyfile(folder / "trade.png", out / "img" / f"trade_{stem}.png")
            parts[stem], parts["machine"] = section(each), [f"- {line}" for line in each.machine]
    put(out / "trade.md", parts)


def folder_of(name: str) -> Path:
    """Return the folder of the results of a scene.  Local."""
    return Path("results", f"{Path(name).stem}_trade")


def stored(name: str) -> Path:
    """Return the file of the measurement of a scene.  Local."""
    return folder_of(name) / "measured.json"


# -- the parts of the page ----------------------------------------------------------------------------------------------


def chosen(measured: Measured) -> list[list[str]]:
    """Return the rows of the first table: the fastest setting for each target, or the smallest error of the runs."""
    study, known, lines = measured.study, measured.study.reference.floor, []
    for target in TARGETS:
        run = study.choice(target) or study.most_accurate
        if run is None:
            lines.append(["", f"{100.0 * target:g}", "not reached", "", "", "", ""])
            continue
        is_chosen = run is study.choice(target)
        error = study.score(run).error if is_chosen else study.sure_error(run)
        error_text, ratio = f"{100.0 * error:.2g}", f"{error / target:.2g}"
        if not is_chosen:
            not_decided = f"not decided: {error_text}, reference known to {100.0 * known:.2g}"
            error_text = not_decided if study.is_undecided(target) else f"not reached: {error_text}"
        times = (f"{run.cost:.2g}", f"{run.setup:.2g}")
        lines.append(["", f"{100.0 * target:g}", error_text, ratio, *times, ""])
    lines[0][0], lines[0][-1] = f"[{study.title}](#{anchor(study.title)})", f"`microslip trade {measured.scene}`"
    return lines


def anchor(title: str) -> str:
    """Return the anchor of a heading as Markdown makes it."""
    return "".join(c for c in title.lower().replace(" ", "-") if c.isalnum() or c in "-_")


def section(measured: Measured) -> list[str]:
    """Return the section of a scene: reference, table, its remarks, and the settings of the first table."""
    study = measured.study
    head = [COLUMNS[key][0] for key in SHOWN]
    cells = [[cell.replace("<", "&lt;") for cell in row] for row in rows(study)]
    reference, *known = reference_lines(study)
    shared = ", ".join(f"{stage} {spent:.2g} s" for stage, spent in study.shared.items())
    return [
        f"`microslip trade {measured.scene}`, {measured.seconds:.0f} s, {measured.date}.",
        "",
        reference[0].upper() + reference[1:] + ":",
        "",
        *(f"- {line.strip()}" for line in known),
        "",
        *(line[0].upper() + line[1:] + "." for line in validation_lines(study)),
        "",
        *table(head, cells, 2),
        "",
        f"Shared by all: {shared}.",
        "",
        *(f"{line[0].upper()}{line[1:]}.\n" for line in failure_lines(study)),
        *(f"- {line}" for line in accuracy_sentences(study)),
        "",
        "Settings of the first table:",
        "",
        "```text",
        *"\n".join(line for target in TARGETS for line in choice_lines(study, target)).rstrip().splitlines(),
        "```",
        "",
        *mesh_lines(study),
    ]


# -- stored measurements ------------------------------------------------------------------------------------------------


def to_json(measured: Measured) -> str:
    """Return a measurement as text; arrays as real and imaginary parts."""

    def as_lists(values: Any) -> Any:
        values = np.asarray(values)
        return values.item() if values.ndim == 0 else [values.real.tolist(), values.imag.tolist()]

    return json.dumps(asdict(measured), default=as_lists)


def from_json(text: str) -> Measured:
    """Return the measurement of a text."""
    data = json.loads(text)
    study, of_reference = data["study"], data["study"]["reference"]

    def curve(of: dict[str, Any]) -> Curve:
        omega, (real, imaginary), bar = np.array(of["omega"][0]), np.array(of["u"]), np.array(of["bar"][0])
        return Curve(of["level"], omega, real + 1j * imaginary, bar)

    def run(of: dict[str, Any]) -> Run:
        curves, corrected = (tuple(map(curve, of[key])) for key in ("curves", "corrected"))
        return Run(**{**of, "setting": Setting(**of["setting"]), "curves": curves, "corrected": corrected})

    curves = {each.level: each for each in map(curve, of_reference["curves"].values())}
    checks = tuple(Check(each["parameter"], tuple(each["values"]), tuple(each["steps"])) for each in of_reference["checks"])
    reference = Reference(Setting(**of_reference["setting"]), curves, checks, of_reference["seconds"], of_reference["why"])
    runs, meshes = ([run(each) for each in study[key]] for key in ("runs", "meshes"))
    base = Setting(**study["base"])
    return Measured(**{**data, "study": Study(**{**study, "reference": reference, "base": base, "runs": runs, "meshes": meshes})})


if __name__ == "__main__":
    main()
