"""One input file, read by CalculiX and by this program: the lowest frequencies of both, for every element type.

    python jobs/bench/calculix_frequencies.py [--ccx PATH] [--straight] [--fibres AXES] [--pushed FORCE | --bent FORCE | --heated K]

The bar of tests/verification/calculix.py, clamped at one end: curved, twisted and tapered, or straight. Everything, including
materials, sections and supports, comes from the file. CalculiX prints seven digits. Its C3D8I has the incompatible modes in the
mass, too, and on distorted elements omits the factor det J_centre / det J from their gradients.

--fibres: the material is orthotropic, 14 times as stiff along axis 1 as across. Its axes are oblique to the bar, those of a
cylinder around it, or those of the model ("oblique", "cylinder", "model"); "matrix" gives the 21 constants of other oblique axes.

--pushed: the straight bar vibrates about a static step in which FORCE [N] pushes along its length; the force is read from the
file, too, and the next column shows by how much it changes the frequencies of CalculiX. --bent: the force bends the bar sideways
in a step with NLGEOM, and the bar vibrates about the large displacement. --heated: the bar, held at one end, is heated by K
kelvin and expands along axes 1, 2 and 3 by -1e-6, 3e-5 and 2e-5 1/K, which stresses it there.
"""

from __future__ import annotations

import microslip  # noqa: F401  selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
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

from microslip import elements  # noqa: E402

LENGTH = 4.0  # m
PLY = (1.4e11, 1.0e10, 2.0e10, 0.28, 0.31, 0.4, 5.0e9, 6.0e9, 3.5e9)  # E1, E2, E3, nu12, nu13, nu23, G12, G13, G23
AXES = {
    "model": "",
    "oblique": "*ORIENTATION, NAME=FIBRES\n1., 0.4, 0.8, -0.3, 1., 0.2\n3, 20.\n",
    "cylinder": "*ORIENTATION, NAME=FIBRES, SYSTEM=CYLINDRICAL\n-0.7, 0.1, 0., -0.7, 0.3, 1.\n",
    "matrix": "",
}


def deck(name: str, straight: bool) -> str:
    """Return the input file of the bar in one element type."""
    return calculix.deck(name, static=False, made=calculix.bar(calculix.TYPES[name][0], straight))


def wound(text: str, axes: str) -> str:
    """Return an input file with an orthotropic material in one of AXES in place of steel."""
    young, poisson, _ = calculix.STEEL
    head, _, tail = text.partition(f"*ELASTIC\n{young}, {poisson}\n")
    if axes == "matrix":
        oblique = elements.Directions((1.0, 0.5, 0.3), (0.0, 1.0, 0.4))
        six = elements.Anisotropic(elastic(PLY), axes=oblique).at(np.zeros((1, 1, 3))).elasticity
        values = [f"{six[i, j]:.9e}" for j in range(6) for i in range(j + 1)]
        card = ["*ELASTIC, TYPE=ANISO", *(", ".join(values[k : k + 8]) for k in (0, 8, 16))]
    else:
        card = ["*ELASTIC, TYPE=ENGINEERING CONSTANTS", ", ".join(map(str, PLY[:8])), f"{PLY[8]}, 0."]
    text = head + "\n".join([*card, tail])
    if AXES[axes]:
        text = AXES[axes] + text.replace("MATERIAL=STEEL", "MATERIAL=STEEL, ORIENTATION=FIBRES")
    return text


def elastic(ply: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    """Return the elasticity (6, 6) [Pa] of nine engineering constants."""
    a, b, c, d, e, f, g, h, i = ply
    return tuple(map(tuple, elements.orthotropic((a, b, c), (d, e, f), (g, h, i)).tolist()))


def loaded(text: str, name: str, force: float, *, is_large: bool) -> str:
    """Return an input file with a static step before its vibration: a force on the nodes of the end, along the bar or across it."""
    points, _, _ = calculix.bar(calculix.TYPES[name][0], straight=True)
    end = (np.flatnonzero(np.isclose(points[:, 2], LENGTH)) + 1).tolist()
    own = -force / len(end)
    loads = "".join(f"{node}, {1 if is_large else 3}, {own:.12e}\n" for node in end)
    return text.replace(
        "*STEP", f"*STEP{', NLGEOM' if is_large else ''}\n*STATIC\n*CLOAD\n{loads}*END STEP\n*STEP, PERTURBATION", 1
    )


def heated(text: str, kelvin: float) -> str:
    """Return an input file with orthotropic thermal expansion and a heating step before its vibration."""
    every = text.count("\n", 0, text.index("*ELEMENT")) - text.count("\n", 0, text.index("*NODE") + 6)  # number of node lines
    cold = f"*NSET, NSET=EVERY, GENERATE\n1, {every + 1}\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nEVERY, 0.\n"
    text = text.replace("*DENSITY", "*EXPANSION, TYPE=ORTHO\n-1.e-6, 3.e-5, 2.e-5\n*DENSITY", 1)
    return text.replace("*STEP", f"{cold}*STEP\n*STATIC\n*TEMPERATURE\nEVERY, {kelvin}\n*END STEP\n*STEP, PERTURBATION", 1)


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
    parser.add_argument("--heated", type=float, metavar="K")
    parser.add_argument("--fibres", choices=sorted(AXES))
    chosen = parser.parse_args()
    force = chosen.pushed if chosen.bent is None else chosen.bent
    if not chosen.ccx:
        sys.exit("ccx not found: install CalculiX (Debian: calculix-ccx) or give its path with --ccx")
    for name in sorted(calculix.TYPES):
        is_loaded = force is not None or chosen.heated is not None
        text = deck(name, chosen.straight or is_loaded)
        text = wound(text, chosen.fibres) if chosen.fibres else text
        free = both(chosen.ccx, text)[0] if is_loaded else None
        if force is not None:
            text = loaded(text, name, force, is_large=chosen.bent is not None)
        elif chosen.heated is not None:
            text = heated(text, chosen.heated)
        theirs, ours = both(chosen.ccx, text)
        difference = abs(np.sqrt(ours / theirs) - 1.0).max()
        hertz = " ".join(f"{value:.7g}" for value in np.sqrt(theirs) / (2.0 * np.pi))
        shift = f", changed by up to {abs(np.sqrt(theirs / free) - 1.0).max():.1e}" if free is not None else ""
        print(f"{name:7s} {hertz} Hz  difference {difference:.1e}{shift}", flush=True)


if __name__ == "__main__":
    main()
