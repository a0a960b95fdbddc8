"""Public models of other programs: which files are read, which are refused and why, and solved modes over targets.

    python jobs/real/table.py [--folder DIR] [--page docs/real_models.md] [--only WORD]

Fetches the packages of jobs/real/models.toml with their clients (pip; apt-get for Debian's, if available; git for public
repositories) into DIR, by default a temporary folder, and checks every file as `microslip check` does.  Packages that are already
in DIR (repositories as OWNER+NAME) are not fetched again.  Compressed inputs are unpacked in their folders.  Models of manuals
without a mesh file are built (built.py).  The models of the list are then solved as a user would: `microslip new`, the edited
lines of the list, `microslip modes` or `microslip run`.  Targets of CalculiX' set are its stored eigenvalues.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import gzip
import io
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "jobs" / "bench")]

from built import BUILT  # noqa: E402
from calculix_set import stored  # noqa: E402  initialises PETSc
from mpi4py import MPI  # noqa: E402
from page_tables import put, table  # noqa: E402

from microslip.messages.errors import MicroslipError  # noqa: E402
from microslip.studies.check.model_file import check_model  # noqa: E402

MODELS = Path(__file__).with_name("models.toml")
N_MODES = 6
CURVES = ("model", "program", "edited lines", "pairs", "level", "highest point", "error bar", "slip, open", "target", "ratio")
LONGEST = 7200.0  # s, time limit of a command


@dataclass(frozen=True)
class Checked:
    """The outcome of one file."""

    file: Path
    outcome: str  # "read", "refused" or "stopped": by a defect
    why: str = ""


# -- packages ------------------------------------------------------------------------------------------------------


def fetched(package: dict, folder: Path) -> Path | None:
    """Return the folder of a package, fetched if missing; None if that fails."""
    client, name, *folders = package["fetch"]
    place = folder / re.sub(r"[^\w.=-]", "+", name)
    if client == "built":
        place.mkdir(exist_ok=True)
        for file, text in BUILT.items():
            (place / file).write_text(text(), encoding="utf-8")
    elif not place.exists():
        try:
            _fetch(client, name, place, folders)
        except (OSError, subprocess.SubprocessError) as problem:
            print(f"{name}: not fetched ({problem})", flush=True)
            return None
    for packed in place.rglob("*.inp.gz"):
        packed.with_suffix("").write_bytes(gzip.decompress(packed.read_bytes()))
    return place


def _fetch(client: str, name: str, place: Path, folders: Sequence[str] = ()) -> None:
    """Fetch a package or a repository, or some folders of it, into a folder."""

    def run(*command: str) -> None:
        subprocess.run(command, cwd=scratch, check=True, timeout=LONGEST, capture_output=True)

    with tempfile.TemporaryDirectory(dir=place.parent) as scratch:
        if client == "git":
            some = ["--filter=blob:none", "--sparse"] if folders else []
            run("git", "clone", "-q", "--depth", "1", *some, f"https://github.com/{name}", "copy")
            if folders:
                run("git", "-C", "copy", "sparse-checkout", "set", *folders)
            Path(scratch, "copy").rename(place)
        elif client == "apt":
            run("apt-get", "download", "-q", name)
            (archive,) = Path(scratch).glob("*.deb")
            run("dpkg-deb", "-x", str(archive), str(place))
        else:
            sources = ["--no-binary", ":all:"] if client == "pip-source" else []
            run(sys.executable, "-m", "pip", "download", "-q", "--no-deps", *sources, "-d", scratch, name)
            (archive,) = Path(scratch).iterdir()
            shutil.unpack_archive(archive, place, "gztar" if archive.name.endswith(".gz") else "zip")


def files_of(package: dict, place: Path) -> list[Path]:
    """Return the model files of a package."""
    return sorted({path for pattern in package["files"] for path in place.glob(pattern) if path.is_file()})


# -- files that are read --------------------------------------------------------------------------------------------------


def checked(path: Path) -> Checked:
    """Return the outcome of `microslip check` for a file."""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            check_model(str(path), MPI.COMM_SELF, None)
    except MicroslipError as problem:
        return Checked(path, "refused", reason(str(problem), path))
    except Exception:  # to find such defects is the purpose
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


def package_row(package: dict, files: list[Checked] | None) -> list[str]:
    """Return the row of a package."""
    name = f"`{package['fetch'][1]}`" if package["fetch"][0] != "git" else f"github.com/{package['fetch'][1]}"
    client = {"pip": "PyPI", "pip-source": "PyPI, source", "apt": "Debian", "git": "repository"}[package["fetch"][0]]
    counts = Counter(one.outcome for one in files or ())
    numbers = (
        [str(len(files)), str(counts["read"]), str(counts["refused"]), str(counts["stopped"])] if files is not None else ["–"] * 4
    )
    return [package["name"], f"{client}: {name}", package["licence"], package["program"], *numbers]


def reason_rows(package: dict, files: list[Checked]) -> list[list[str]]:
    """Return a row for each reason to refuse files of a package."""
    counts = Counter(one.why for one in files if one.outcome != "read")
    examples = {one.why: one.file.name for one in reversed(files)}
    return [[package["name"], why.replace("|", "\\|"), examples[why], str(n)] for why, n in counts.most_common()]


# -- modes ---------------------------------------------------------------------------------------------------------


def edited(scene: Path, model: dict) -> int:
    """Apply the edited lines of a model to its scene, and return how many there are."""
    text = scene.read_text(encoding="utf-8")
    edits = [(old, new.splitlines()) for old, new in model.get("replace", ())]
    for old, new in edits:
        if f"{old}\n" not in text:
            raise ValueError(f"{scene.name}: new writes no line {old!r}")
        text = text.replace(f"{old}\n", "\n".join(new) + "\n", 1)
    added = [line for line in model.get("add", "").splitlines() if line.strip()]
    scene.write_text(text + "\n" + "\n".join(added) + "\n", encoding="utf-8")
    return len(added) + sum(len([line for line in new if line != old]) for old, new in edits)


def solved(path: Path, model: dict, command: list[str], scratch: Path) -> tuple[Path, int, str]:
    """Solve a model as a user would; return the folder of results, the number of edited lines, and the reason of a failure."""
    name = re.sub(r"\W", "_", f"{path.stem}_{model.get('case', '')}").strip("_")
    scene, out, n = scratch / f"{name}.toml", scratch / f"{name}_out", 0
    steps = [["new", str(path), "--out", str(scene)], [command[0], str(scene), *command[1:], "--out", str(out)]]
    if path.suffix == ".toml":  # a scene, of matrices
        steps = [[command[0], str(path), *command[1:], "--out", str(out)]]
    for words in steps:
        if words[0] != "new" and len(steps) > 1:
            n = edited(scene, model)
        done = subprocess.run(
            [sys.executable, "-m", "microslip", *words], capture_output=True, text=True, timeout=LONGEST, cwd=scratch
        )
        if done.returncode:
            return out, n, reason(done.stderr.strip().splitlines()[-1].removeprefix("microslip: error: "), path)
    return out, n, ""


def frequencies(out: Path, model: dict) -> np.ndarray:
    """Return the values to compare: the lowest frequencies [Hz], those of family 1 at several speeds, or a critical speed [rpm].

    For a disc with Coriolis forces: the lowest waves of each nodal diameter, backward and forward.
    """
    if "diameters" in model:
        lowest = [row for row in csv.DictReader((out / "modes.csv").open(encoding="utf-8")) if row["mode"] == "1"]
        return np.array([float(row[f"{wave}_frequency_Hz"]) for row in lowest for wave in ("backward", "forward")])
    if "critical" in model:
        rows = csv.DictReader((out / "crossings.csv").open(encoding="utf-8"))
        return np.array([float(row["speed_rpm"]) for row in rows if int(row["family"]) == model["family"]])
    if "speeds" in model:
        return np.loadtxt(out / "campbell.csv", delimiter=",", skiprows=1, ndmin=2)[:, 2]
    return np.loadtxt(out / "modes.csv", delimiter=",", skiprows=1, ndmin=2)[:, 1]


def model_row(path: Path, model: dict, program: str, scratch: Path) -> list[str]:
    """Return the row of a solved model: program, read, edited lines, targets, computed values, their ratios."""
    target, source = np.array(model.get("target", ())), model.get("source", "")
    if "CalculiX" in model["package"] and not len(target):
        target, source = np.sqrt(np.maximum(stored(path.parent, path.stem), 0.0)) / (2.0 * np.pi), "its .dat.ref"
    command = ["modes", "--count", str(model.get("count", N_MODES))]
    if "speeds" in model:
        command += ["--speeds", ",".join(map(str, model["speeds"])), "--orders", str(model.get("critical", 1))]
    if "diameters" in model:
        command += ["--diameters", ",".join(map(str, model["diameters"]))]
    out, n, why = solved(path, model, command, scratch)
    name = path.name + (f", {model['case']}" if "case" in model else "")
    unit = model.get("unit", "")
    if why:
        return [name, program, f"no: {why}", str(n), f"{_numbers(target)}{unit} ({source})", "–", "–"]
    computed = frequencies(out, model)[model.get("skip", 0) :]
    ratios = computed[: len(target)] / target[: len(computed)]
    digits = 7 if "CalculiX" in source else 4
    ends = [f"{value:.{digits}f}" for value in (ratios.min(), ratios.max())] if len(ratios) else ["–"]
    span = " to ".join(dict.fromkeys(ends))
    goal = f"{_numbers(target)}{unit} ({source})" if len(target) else source
    return [name, program, "yes", str(n), goal, _numbers(computed[: max(len(target), 1)]), span]


def curve_rows(path: Path, model: dict, program: str, scratch: Path) -> list[list[str]]:
    """Return the rows of a model's curves: edited lines, pairs, level, highest point with its bar, pairs that slip or open."""
    out, n, why = solved(path, model, ["run"], scratch)
    name = path.name + (f", {model['case']}" if "case" in model else "")
    if why:
        return [[name, program, str(n), "–", "–", f"no: {why}", *["–"] * 4]]
    points = list(csv.DictReader((out / "frf.csv").open(encoding="utf-8")))
    levels = list(dict.fromkeys(point["level_N"] for point in points))
    rows = []
    for level in levels:
        top = max((point for point in points if point["level_N"] == level), key=lambda point: float(point["amplitude_m"]))
        size, bar = float(top["amplitude_m"]), f"{100.0 * float(top['error_m']) / float(top['amplitude_m']):.2g} %"
        pairs = sum(int(top[state]) for state in ("sticking", "slipping", "open"))
        moving = f"{top['slipping']}, {top['open']}"
        goal, ratio = model.get("source", "–"), "–"
        if "peak" in model:
            ratio = f"{size / model['peak'][0]:.4f} at {float(top['frequency_Hz']) / model['peak'][1]:.4f}"
        peak = f"{size:.5g} m at {float(top['frequency_Hz']):.5g} Hz"
        rows.append([name, program, str(n), str(pairs), f"{float(level):g} N", peak, bar, moving, goal, ratio])
    return rows


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{value:.7g}" for value in values[:3]) + (", …" if len(values) > 3 else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="folder of the packages and repositories")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "real_models.md")
    parser.add_argument("--only", default="", metavar="WORD", help="only packages with this in the name; the page is not changed")
    arguments = parser.parse_args()
    listed = tomllib.loads(MODELS.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory(prefix="real_") as scratch:
        folder = Path(scratch, "packages") if arguments.folder is None else arguments.folder
        folder.mkdir(parents=True, exist_ok=True)
        packages, reasons = [], []
        rows: list[list[str]] = []
        curves: list[list[str]] = []
        for package in listed["packages"]:
            if arguments.only not in package["name"]:
                continue
            place = fetched(package, folder.absolute())
            files = [] if place is None else files_of(package, place)
            if package["fetch"][0] != "built":
                results = [checked(path) for path in files]
                packages.append(package_row(package, None if place is None else results))
                reasons += reason_rows(package, results)
                print(*packages[-1], sep=" | ", flush=True)
            for model in listed["models"]:
                paths = [path for path in files if model["package"] == package["name"] and path.name == model["file"]]
                for path in paths[:1]:
                    what = (path, model, model.get("program", package["program"]), Path(scratch))
                    new = curve_rows(*what) if model.get("curves") else [model_row(*what)]
                    (curves if model.get("curves") else rows).extend(new)
                    print(*(" | ".join(row) for row in new), sep="\n", flush=True)
    if not arguments.only:
        tables = {
            "models": table(("model", "program", "read", "edited lines", "target, Hz (source)", "found, Hz", "ratio"), rows, 7),
            "curves": table(CURVES, curves, 10),
            "packages": table(("collection", "source", "licence", "program", "files", "read", "refused", "defects"), packages, 4),
            "reasons": table(("collection", "reason", "for example", "files"), reasons, 3),
        }
        put(arguments.page, tables)


if __name__ == "__main__":
    main()
