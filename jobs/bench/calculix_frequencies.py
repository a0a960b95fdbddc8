"""One input file, read by CalculiX and by this program: the lowest frequencies of both, for every element type.

    python jobs/bench/calculix_frequencies.py [--ccx PATH] [--straight]

The bar of tests/verification/calculix.py, clamped at one end: curved, twisted and tapered, or straight. Everything comes from the
file, materials, sections and supports too. CalculiX prints seven digits. Its C3D8I has the incompatible modes in the mass, too, and
on distorted elements gradients of them without the factor det J_centre / det J.
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

calculix.TYPES["C3D6"] = ("wedge6", "full", True)


def deck(name: str, straight: bool) -> str:
    """Return the input file of the bar in one element type."""
    if not straight:
        return calculix.deck(name, static=False)
    as_it_was = calculix.bar
    calculix.bar = lambda kind, straight=False: as_it_was(kind, straight=True)
    try:
        return calculix.deck(name, static=False)
    finally:
        calculix.bar = as_it_was


def both(ccx: str, name: str, straight: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the eigenvalues of CalculiX and of this program."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bar.inp"
        path.write_text(deck(name, straight))
        subprocess.run([ccx, "bar"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        theirs = eigenvalues_in((Path(folder) / "bar.dat").read_text())
        return theirs, np.sort(eigenvalues(path, len(theirs)))[: len(theirs)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ccx", default=shutil.which("ccx"))
    parser.add_argument("--straight", action="store_true")
    chosen = parser.parse_args()
    if not chosen.ccx:
        sys.exit("ccx not found: install CalculiX (Debian: calculix-ccx) or give its path with --ccx")
    for name in sorted(calculix.TYPES):
        theirs, ours = both(chosen.ccx, name, chosen.straight)
        difference = abs(np.sqrt(ours / theirs) - 1.0).max()
        hertz = " ".join(f"{value:.7g}" for value in np.sqrt(theirs) / (2.0 * np.pi))
        print(f"{name:7s} {hertz} Hz  difference {difference:.1e}", flush=True)


if __name__ == "__main__":
    main()
