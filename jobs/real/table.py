"""Public models of other programs as their users have them: what is read, what is refused and why, and modes beside targets.

    python jobs/real/table.py [--folder DIR] [--page docs/real_models.md] [--only WORD]

Fetches the packages of jobs/real/models.toml by their clients (pip; apt-get for Debian's, where it is there) into DIR, by default
a temporary folder, and checks every file of them as `microslip check` does.  Packages that are there stay.  Models in public
repositories are read where DIR/OWNER+NAME holds a copy.  The models of the list are then solved as a user would: `microslip new`,
the edited lines of the list, `microslip modes`.  Targets of CalculiX' set are the eigenvalues that come with it.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import traceback
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "jobs" / "bench")]

from calculix_set import stored  # noqa: E402  initialises PETSc
from mpi4py import MPI  # noqa: E402
from page_tables import put, table  # noqa: E402

from microslip.messages.errors import MicroslipError  # noqa: E402
from microslip.studies.check.model_file import check_model  # noqa: E402

MODELS = Path(__file__).with_name("models.toml")
N_MODES = 6
LONGEST = 600.0  # s of a command


@dataclass(frozen=True)
class Checked:
    """What became of one file."""

    file: Path
    outcome: str  # "read", "refused" or "stopped": by a defect
    why: str = ""


# -- packages ------------------------------------------------------------------------------------------------------


def fetched(package: dict, folder: Path) -> Path | None:
    """Return the folder of a package, fetched if it is not there; None where it cannot be."""
    client, name = package["fetch"]
    place = folder / re.sub(r"[^\w.=-]", "+", name)
    if place.exists() or client == "folder":
        return place if place.exists() else None
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        try:
            if client == "apt":
                subprocess.run(["apt-get", "download", "-q", name], cwd=scratch, check=True, timeout=LONGEST, capture_output=True)
                (archive,) = Path(scratch).glob("*.deb")
                subprocess.run(["dpkg-deb", "-x", str(archive), str(place)], check=True, timeout=LONGEST)
            else:
                sources = ["--no-binary", ":all:"] if client == "pip-source" else []
                command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", *sources, "-d", scratch, name]
                subprocess.run(command, check=True, timeout=LONGEST, capture_output=True)
                (archive,) = Path(scratch).iterdir()
                shutil.unpack_archive(archive, place, "gztar" if archive.name.endswith(".gz") else "zip")
        except (OSError, subprocess.SubprocessError) as problem:
            print(f"{name}: not fetched ({problem})", flush=True)
            return None
    return place


def files_of(package: dict, place: Path) -> list[Path]:
    """Return the model files of a package."""
    return sorted({path for pattern in package["files"] for path in place.glob(pattern) if path.is_file()})


# -- what is read --------------------------------------------------------------------------------------------------


def checked(path: Path) -> Checked:
    """Return what `microslip check` makes of a file."""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            check_model(str(path), MPI.COMM_SELF, None)
    except MicroslipError as problem:
        return Checked(path, "refused", reason(str(problem), path))
    except Exception:  # a defect is what this looks for
        return Checked(path, "stopped", traceback.format_exc().strip().splitlines()[-1])
    return Checked(path, "read")


def reason(message: str, path: Path) -> str:
    """Return a message without the file and with its numbers as N, so that equal reasons are counted together."""
    text = " ".join(message.replace(str(path), path.name).split()).removeprefix("[model] mesh: ").removeprefix(f"{path.name}: ")
    text = re.sub(r"^\S+\.toml: ", "", text)
    text = re.sub(r"\(([\w*]+, )*[\w*]+\);", ";", text) if "when Ansys runs them" in text else text
    text = re.sub(r"^line \d+", "line N", re.sub(r"'[^']*\.(msh|inc|inp|nam|nod)'", "a file", text))
    text = re.sub(r"\(\d+ (line|tri|quad)\d(, \d+ (line|tri|quad)\d)*\)", "(beams or shells)", text)
    return re.sub(r"\b\d+\b", "N", text)[:170]


def package_row(package: dict, found: list[Checked] | None) -> list[str]:
    """Return the row of a package."""
    name = f"`{package['fetch'][1]}`" if package["fetch"][0] != "folder" else f"github.com/{package['fetch'][1]}"
    client = {"pip": "PyPI", "pip-source": "PyPI, source", "apt": "Debian", "folder": "repository"}[package["fetch"][0]]
    counts = Counter(one.outcome for one in found or ())
    numbers = (
        [str(len(found)), str(counts["read"]), str(counts["refused"]), str(counts["stopped"])] if found is not None else ["–"] * 4
    )
    return [package["name"], f"{client}: {name}", package["licence"], package["program"], *numbers]


def reason_rows(package: dict, found: list[Checked]) -> list[list[str]]:
    """Return a row for each reason to refuse files of a package."""
    counts = Counter(one.why for one in found if one.outcome != "read")
    examples = {one.why: one.file.name for one in reversed(found)}
    return [[package["name"], why.replace("|", "\\|"), examples[why], str(n)] for why, n in counts.most_common()]


# -- modes ---------------------------------------------------------------------------------------------------------


def edited(scene: Path, model: dict) -> int:
    """Apply the edited lines of a model to its scene, and return how many there are."""
    text = scene.read_text(encoding="utf-8")
    for old, new in model.get("replace", ()):
        if f"{old}\n" not in text:
            raise ValueError(f"{scene.name}: new writes no line {old!r}")
        text = text.replace(f"{old}\n", f"{new}\n", 1)
    added = [line for line in model.get("add", "").splitlines() if line.strip()]
    scene.write_text(text + "\n" + "\n".join(added) + "\n", encoding="utf-8")
    return len(added) + len(model.get("replace", ()))


def frequencies(path: Path, model: dict, scratch: Path) -> tuple[np.ndarray | None, int, str]:
    """Return the lowest frequencies [Hz] of a model as a user gets them, the edited lines, and why there are none."""
    scene, out, n = scratch / f"{path.stem}.toml", scratch / f"{path.stem}_modes", 0
    for command in (["new", str(path), "--out", str(scene)], ["modes", str(scene), "--count", str(N_MODES), "--out", str(out)]):
        if command[0] == "modes":
            n = edited(scene, model)
        program = [sys.executable, "-m", "microslip", *command]
        done = subprocess.run(program, capture_output=True, text=True, timeout=LONGEST, cwd=scratch)
        if done.returncode:
            return None, n, reason(done.stderr.strip().splitlines()[-1].removeprefix("microslip: error: "), path)
    return np.loadtxt(out / "modes.csv", delimiter=",", skiprows=1, ndmin=2)[:, 1], n, ""


def model_row(path: Path, model: dict, program: str, scratch: Path) -> list[str]:
    """Return the row of a solved model: program, read, edited lines, targets, what was found, their ratios."""
    target, source = np.array(model.get("target", ())), model.get("source", "")
    if "CalculiX" in model["package"] and not len(target):
        target, source = np.sqrt(np.maximum(stored(path.parent, path.stem), 0.0)) / (2.0 * np.pi), "its .dat.ref"
    found, n, why = frequencies(path, model, scratch)
    if found is None:
        return [path.name, program, f"no: {why}", str(n), f"{_numbers(target)} ({source})", "–", "–"]
    ratios = found[: len(target)] / target[: len(found)]
    said = f"{ratios.min():.7f} to {ratios.max():.7f}" if len(target) else "–"
    goal = f"{_numbers(target)} ({source})" if len(target) else source
    return [path.name, program, "yes", str(n), goal, _numbers(found), said]


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{value:.7g}" for value in values[:3]) + (", …" if len(values) > 3 else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="where packages are fetched to, and copies of repositories are")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "real_models.md")
    parser.add_argument("--only", default="", metavar="WORD", help="packages whose name holds it; the page stays as it is")
    asked = parser.parse_args()
    listed = tomllib.loads(MODELS.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory(prefix="real_") as scratch:
        folder = Path(scratch, "packages") if asked.folder is None else asked.folder
        folder.mkdir(parents=True, exist_ok=True)
        packages, reasons, solved = [], [], []
        for package in listed["packages"]:
            if asked.only not in package["name"]:
                continue
            place = fetched(package, folder.absolute())
            files = [] if place is None else files_of(package, place)
            found = [checked(path) for path in files]
            packages.append(package_row(package, None if place is None else found))
            reasons += reason_rows(package, found)
            print(*packages[-1], sep=" | ", flush=True)
            for model in listed["models"]:
                paths = [path for path in files if model["package"] == package["name"] and path.name == model["file"]]
                solved += [model_row(path, model, package["program"], Path(scratch)) for path in paths[:1]]
                if paths:
                    print(*solved[-1], sep=" | ", flush=True)
    if not asked.only:
        tables = {
            "models": table(("model", "program", "read", "edited lines", "target, Hz (source)", "found, Hz", "ratio"), solved, 7),
            "packages": table(("collection", "source", "licence", "program", "files", "read", "refused", "defects"), packages, 4),
            "reasons": table(("collection", "reason", "for example", "files"), reasons, 3),
        }
        put(asked.page, tables)


if __name__ == "__main__":
    main()
