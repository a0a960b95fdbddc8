"""CalculiX's verification examples with *FREQUENCY and solid elements: which are read, and which give the stored frequencies.

    python jobs/bench/calculix_set.py [FOLDER] [--only NAME ...]

FOLDER holds the inputs and the printed results of CalculiX, NAME.inp and NAME.dat.ref (Debian: calculix-ccx-test, unpacked).
Each input is read whole, in its units and without additions: supports, springs, equations and rigid bodies come from the file, or
the file is refused with the keywords that are not supported.  Frequencies agree if they differ by no more than the last of the
seven printed digits.
"""

from __future__ import annotations

import argparse
import gzip
import re
import sys
from pathlib import Path

import numpy as np

from microslip.parallel.petsc import initialise

initialise()

from mpi4py import MPI  # noqa: E402

from microslip.formats.model import FileModel  # noqa: E402
from microslip.formats.read import read_model  # noqa: E402
from microslip.library.build import from_mesh  # noqa: E402
from microslip.library.complete import complete  # noqa: E402
from microslip.linear.joint_springs import linearise  # noqa: E402
from microslip.messages.errors import CaseError, ConvergenceError, MeshError  # noqa: E402
from microslip.modes.eigen import lowest_modes  # noqa: E402
from microslip.observe.log import RunLog  # noqa: E402
from microslip.scene.read import changed, scene_of  # noqa: E402

FOLDER = Path("/usr/share/doc/calculix-ccx-test/examples/test")
PRINTED = 1.5e-6  # relative: seven digits of an eigenvalue; the frequency is its square root
UNFELT = {"*DASHPOT", "*ELEMENT, TYPE=DASHPOTA", "*CONTACT PAIR"}
ROW = re.compile(r"^\s+\d+((?:\s+-?\d\.\d+E[+-]\d+){3,4})\s*$", re.MULTILINE)


def stored(folder: Path, name: str) -> np.ndarray:
    """Return the stored eigenvalues of an input."""
    plain, packed = folder / f"{name}.dat.ref", folder / f"{name}.dat.ref.gz"
    return eigenvalues_in(plain.read_text(errors="replace") if plain.exists() else gzip.open(packed, "rt").read())


def eigenvalues_in(text: str) -> np.ndarray:
    """Return the eigenvalues [rad2/s2] of the first table that CalculiX printed; with friction it prints only frequencies."""
    table = text.split("E I G E N V A L U E   O U T P U T")
    if len(table) < 2:
        return np.zeros(0)
    rows = ROW.findall(re.split(r"P A R T I C I P A T I O N|E I G E N V A L U E", table[1])[0])
    values = [[float(word) for word in row.split()] for row in rows]
    return np.sort([row[0] if len(row) == 4 else row[0] ** 2 for row in values])


def scene_for(path: Path, model: FileModel, ignore: tuple[str, ...]):
    """Return the smallest scene that reads the file: one load and one output at a node that is free to move."""
    free = np.zeros((len(model.points), 3), dtype=bool)
    for cells in model.cells:
        if cells.kind.startswith(("tet", "hex", "wedge")):
            free[cells.nodes] = True
    for support in model.supports:
        if support.group is not None:
            free[np.ix_(model.groups[support.group].nodes, np.array(["xyz".index(axis) for axis in support.fix]))] = False
    if model.equations is not None:
        free[model.equations.nodes] = False
    for tie in model.ties:
        for block in model.groups[tie.surfaces[0]].cells:
            free[model.cells[block].nodes] = False
    node, axis = np.argwhere(free)[0]
    at = tuple(float(value) for value in model.points[node])
    along = tuple(float(value) for value in np.eye(3)[axis])
    tables = {
        "model": {"mesh": path.name, "units": "m-kg-s", "ignore": ignore},
        "loads": ({"position": at, "direction": along},),
        "outputs": ({"name": "out", "position": at, "direction": along},),
        "damping": {"ratio": 0.01},
        "response": {"levels": (1.0,), "frequencies": (1.0, 2.0)},
    }
    return scene_of(tables, path.parent / "scene.toml")


def eigenvalues(path: Path, n: int, ignore: tuple[str, ...] = (), pairing: str | None = None) -> np.ndarray:
    """Return the lowest eigenvalues of an input file; ``pairing`` replaces that of its joints."""
    model = read_model(path)
    scene, _ = complete(scene_for(path, model, ignore), model)
    if pairing is not None:
        scene = changed(scene, {}, {joint.name: {"pairing": pairing} for joint in scene.joints})
    _, rest, _ = from_mesh(scene, model, MPI.COMM_SELF, RunLog(MPI.COMM_SELF, screen=False))
    linearised = linearise(rest.system, rest.pairs, str(path))
    modes = lowest_modes(linearised, min(n, rest.system.n_dof), verify=False)
    linearised.destroy()
    return modes.omega_n**2


def compared(path: Path, folder: Path) -> tuple[str, str]:
    """Return "agrees", "agrees*", "differs" or "refused", and the difference or the refused keywords.

    The star marks inputs with features that do not enter the stored frequencies and that the scene ignores by name: dashpots, which
    CalculiX leaves out; contact, which CalculiX includes only in a *STEP, PERTURBATION.
    """
    reference = stored(folder, path.stem)
    try:
        return judged(eigenvalues(path, max(len(reference), 1)), reference)
    except (CaseError, ConvergenceError, MeshError) as problem:
        refused = _keywords(str(problem))
    ignored = tuple(refused.split("; "))
    if not set(ignored) <= UNFELT:
        return "refused", refused
    verdict, words = judged(eigenvalues(path, max(len(reference), 1), ignored), reference)
    return f"{verdict}*", f"{words}; [model] ignore: {refused}"


def judged(values: np.ndarray, reference: np.ndarray) -> tuple[str, str]:
    """Return whether eigenvalues agree with the stored ones, and a text with the difference of the frequencies."""
    if not len(reference):
        return "differs", "nothing to compare with"
    values = np.sort(values)[: len(reference)]
    if len(values) < len(reference):
        return "differs", f"{len(values)} modes of {len(reference)}"
    worst = float((abs(values - reference) / np.maximum(abs(reference), 1e-9 * abs(reference).max())).max() / 2.0)
    return ("agrees" if worst <= PRINTED else "differs"), f"{len(values)} frequencies, {worst:.1e}"


def _keywords(message: str) -> str:
    """Return the keywords that the message suggests to ignore, or the message."""
    takes = re.search(r"\[model\] ignore takes ([^\n]*)", message)
    return "; ".join(re.findall(r'"([^"]*)"', takes[1])) if takes else " ".join(message.split())[:150]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    parser.add_argument("--only", nargs="*", default=[])
    chosen = parser.parse_args()
    counts: dict[str, int] = {}
    for path in sorted(chosen.folder.glob("*.inp")):
        text = path.read_text(errors="replace")
        types = set(re.findall(r"^\*ELEMENT.*TYPE\s*=\s*(\w+)", text, re.MULTILINE | re.IGNORECASE))
        if not re.search(r"^\*FREQUENCY", text, re.MULTILINE | re.IGNORECASE) or not any(
            t.upper().startswith("C3D") for t in types
        ):
            continue
        if chosen.only and path.stem not in chosen.only:
            continue
        verdict, words = compared(path, chosen.folder)
        counts[verdict] = counts.get(verdict, 0) + 1
        print(f"{path.stem:14s} {'/'.join(sorted(types)):24s} {verdict:8s} {words}", flush=True)
    n = sum(counts.values())
    if not n:
        sys.exit(f"{chosen.folder}: no inputs with *FREQUENCY and solids; state the folder of CalculiX's test examples")
    print(f"{n} inputs: " + ", ".join(f"{count} {verdict} ({count / n:.0%})" for verdict, count in sorted(counts.items())))


if __name__ == "__main__":
    main()
