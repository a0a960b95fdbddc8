"""One input file, read by CalculiX and by this program: the lowest frequencies of both, for every element type.

    python jobs/bench/calculix_frequencies.py [--ccx PATH] [--straight] [--pushed FORCE | --bent FORCE]

The bar of tests/verification/calculix.py, clamped at one end: curved, twisted and tapered, or straight. Everything comes from the
file, materials, sections and supports too. CalculiX prints seven digits. Its C3D8I has the incompatible modes in the mass, too, and
on distorted elements gradients of them without the factor det J_centre / det J.

With --pushed the straight bar vibrates about a static step, pushed along its length by FORCE [N], which is taken over from the
file, too; shown beside the difference is by how much the force changes the frequencies of CalculiX. With --bent it is bent sideways, in a
step with NLGEOM, and vibrates about the large displacement.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2] / "tests")]

from calculix_set import eigenvalues, eigenvalues_in  # noqa: E402
from verification import calculix  # noqa: E402

LENGTH = 4.0  # m


def deck(name: str, straight: bool) -> str:
    """Return the input file of the bar in one element type."""
    return calculix.deck(name, static=False, made=calculix.bar(calculix.TYPES[name][0], straight))


def loaded(text: str, name: str, force: float, *, is_large: bool) -> str:
    """Return an input file with a step before its vibration, a force shared by the end's nodes: along the bar, or across it."""
    points, _, _ = calculix.bar(calculix.TYPES[name][0], straight=True)
    end = (np.flatnonzero(np.isclose(points[:, 2], LENGTH)) + 1).tolist()
    own = -force / len(end)
    loads = "".join(f"{node}, {1 if is_large else 3}, {own:.12e}\n" for node in end)
    return text.replace(
        "*STEP", f"*STEP{', NLGEOM' if is_large else ''}\n*STATIC\n*CLOAD\n{loads}*END STEP\n*STEP, PERTURBATION", 1
    )


def both(ccx: str, text: str, pairing: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the eigenvalues of CalculiX and of this program, whose joints may have another ``pairing``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bar.inp"
        path.write_text(text)
        subprocess.run([ccx, "bar"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        theirs = eigenvalues_in((Path(folder) / "bar.dat").read_text())
        return theirs, np.sort(eigenvalues(path, len(theirs), pairing=pairing))[: len(theirs)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ccx", default=shutil.which("ccx"))
    parser.add_argument("--straight", action="store_true")
    parser.add_argument("--pushed", type=float, metavar="FORCE")
    parser.add_argument("--bent", type=float, metavar="FORCE")
    chosen = parser.parse_args()
    force = chosen.pushed if chosen.bent is None else chosen.bent
    if not chosen.ccx:
        sys.exit("ccx not found: install CalculiX (Debian: calculix-ccx) or give its path with --ccx")
    for name in sorted(calculix.TYPES):
        text = deck(name, chosen.straight or force is not None)
        free = both(chosen.ccx, text)[0] if force is not None else None
        if force is not None:
            text = loaded(text, name, force, is_large=chosen.bent is not None)
        theirs, ours = both(chosen.ccx, text)
        difference = abs(np.sqrt(ours / theirs) - 1.0).max()
        hertz = " ".join(f"{value:.7g}" for value in np.sqrt(theirs) / (2.0 * np.pi))
        shift = f", changed by up to {abs(np.sqrt(theirs / free) - 1.0).max():.1e}" if free is not None else ""
        print(f"{name:7s} {hertz} Hz  difference {difference:.1e}{shift}", flush=True)


if __name__ == "__main__":
    main()
