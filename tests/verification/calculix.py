"""Compare every element kind with CalculiX on a curved, twisted and tapered bar.

    PYTHONPATH=solver:tests python tests/verification/calculix.py [path of ccx]

needs ``ccx`` (Debian: calculix-ccx). For each element type it writes a deck, runs it and prints CalculiX' lowest
frequencies of the clamped bar and the largest relative difference. CalculiX prints seven digits.

C3D8I is compared by the displacement under a tip force, on the straight bar: CalculiX has another mass and, in distorted
elements, other gradients of its incompatible modes; incompatible_modes.py has both, and what they cost.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import scipy.sparse.linalg as sla
from box_meshes import box
from small_fe import assemble, bent, dofs, frequencies

STEEL = (2.1e11, 0.3, 7800.0)  # Pa, -, kg/m3
FORCE = np.array([1e6, 2e6, 3e6])  # N, at the corner node (1, 1.5, 4) of the straight bar

# CalculiX element type: kind, integration, incompatible modes
TYPES = {
    "C3D8": ("hex8", "full", False),
    "C3D8I": ("hex8", "full", True),
    "C3D20": ("hex20", "full", True),
    "C3D20R": ("hex20", "reduced-both", True),
    "C3D4": ("tet4", "reduced-both", True),
    "C3D10": ("tet10", "reduced-both", True),
    "C3D6": ("wedge6", "reduced-both", True),
    "C3D15": ("wedge15", "reduced-both", True),
}


def bar(kind, straight=False):
    """Return points, elements and the loaded node of the bar, 2 x 2 x 4 cells; z = 0 is clamped."""
    points, nodes = box(kind, (2, 2, 4), (1.0, 1.5, 4.0))
    tip = int(np.argmin(np.linalg.norm(points - [1.0, 1.5, 4.0], axis=1)))
    return points if straight else bent(points), nodes, tip


def microslip_frequencies(kind, integration, incompatible_modes, n=6):
    points, nodes, _ = bar(kind)
    K, M = assemble(kind, points, nodes, *STEEL, integration, incompatible_modes)
    return frequencies(K, M, dofs(points[:, 2] == 0.0), n)


def microslip_tip(kind, integration, incompatible_modes):
    """Return the displacement (3,) of the loaded node of the straight bar under FORCE."""
    points, nodes, tip = bar(kind, straight=True)
    K, _ = assemble(kind, points, nodes, *STEEL, integration, incompatible_modes)
    free = np.setdiff1d(np.arange(K.shape[0]), dofs(points[:, 2] == 0.0))
    force, u = np.zeros(K.shape[0]), np.zeros(K.shape[0])
    force[3 * tip : 3 * tip + 3] = FORCE
    u[free] = sla.spsolve(K[free][:, free].tocsc(), force[free])
    return u[3 * tip : 3 * tip + 3]


def deck(name, static, made=None):
    """Return the CalculiX input of one element type; ``made`` are points, elements and loaded node of another mesh."""
    kind = TYPES[name][0]
    points, nodes, tip = made or bar(kind, straight=static)
    # CalculiX reads at most 20 characters per number.
    rows = [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(points, 1)]
    elements = []
    for i, element in enumerate(nodes + 1, 1):
        first, rest = [i, *element[:14]], element[14:]  # at most 16 numbers a line
        elements += [", ".join(map(str, first)) + ("," if len(rest) else "")]
        elements += [", ".join(map(str, rest))] if len(rest) else []
    young, poisson, density = STEEL
    clamped = [f"{i}, 1, 3" for i in np.flatnonzero(points[:, 2] == 0.0) + 1]
    if static:
        step = [
            "*STATIC",
            "*CLOAD",
            *(f"{tip + 1}, {axis}, {value}" for axis, value in enumerate(FORCE, 1)),
            "*NODE PRINT, NSET=TIP",
            "U",
        ]
    else:
        step = ["*FREQUENCY", "6"]
    return "\n".join(
        [
            "*NODE",
            *rows,
            f"*ELEMENT, TYPE={name}, ELSET=ALL",
            *elements,
            "*NSET, NSET=TIP",
            str(tip + 1),
            "*MATERIAL, NAME=STEEL",
            "*ELASTIC",
            f"{young}, {poisson}",
            "*DENSITY",
            str(density),
            "*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL",
            "*BOUNDARY",
            *clamped,
            "*STEP",
            *step,
            "*END STEP",
            "",
        ]
    )


def calculix(ccx, name, static=False, made=None):
    """Return the results printed by CalculiX: six frequencies [Hz], or the tip displacement [m]."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "bar.inp").write_text(deck(name, static, made))
        subprocess.run([ccx, "bar"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        text = (Path(folder) / "bar.dat").read_text()
    number = r"\s+(-?\d\.\d+E[+-]\d+)"
    if static:
        return np.array(re.findall(r"^\s+\d+" + 3 * number, text, re.MULTILINE)[0], dtype=float)
    rows = re.findall(r"^\s+\d+" + 4 * number, text, re.MULTILINE)[:6]
    return np.array([row[0] for row in rows], dtype=float) ** 0.5 / (2.0 * np.pi)


def main():
    ccx = sys.argv[1] if len(sys.argv) > 1 else shutil.which("ccx")
    if not ccx:
        sys.exit("ccx not found: install CalculiX (Debian: calculix-ccx) or give its path")
    for name, (kind, integration, modes) in TYPES.items():
        static = name == "C3D8I"
        ours = (microslip_tip if static else microslip_frequencies)(kind, integration, modes)
        theirs = calculix(ccx, name, static)
        values = " ".join(f"{value:.7g}" for value in theirs)
        difference = abs(ours / theirs - 1.0).max()
        unit = "tip, m" if static else "Hz"
        print(f"{name:7s} {kind:8s} {integration:13s} {unit:7s} {values}  difference {difference:.1e}")


if __name__ == "__main__":
    main()
