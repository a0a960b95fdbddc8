"""Two blocks pressed on each other, one input file read by CalculiX and by this program: frequencies about the pressed state.

    python jobs/bench/calculix_contact.py [--ccx PATH] [--refine N] [--stiffness K ...]

One block stands on another, together a steel bar of 1 x 1.5 x 4 m, with linear contact (K [N/m3] in units of Young's modulus per
metre) and friction high enough to stick.  Forces on the end press the blocks in a static step; *STEP, PERTURBATION follows.
Everything comes from the file: the contact pair becomes a joint, the forces become [statics].  --refine divides every edge of the
elements.  On matching meshes both programs use the consistent stiffness of the springs; on non-matching meshes CalculiX has
points in the intersections of faces, and the joint integrates over the slave faces.  --pairing selects another pairing of the
joint.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2] / "tests")]

from box_meshes import box  # noqa: E402
from calculix_frequencies import both  # noqa: E402
from verification import calculix  # noqa: E402

PRESSURE = 3e5  # Pa, a strain of 1.4e-6: CalculiX' springs have the areas of the deformed faces
SIZE = (1.0, 1.5)  # m


def deck(name: str, cells: tuple[tuple[int, int, int], ...], stiffness: float) -> str:
    """Return the input file of two blocks of ``cells`` elements along each side, in one element type."""
    lines, n_nodes, n_elements, first = [], 0, 0, 0.0
    for i, n in enumerate(cells):
        points, nodes = box(calculix.TYPES[name][0], n, (*SIZE, 2.0), (0.0, 0.0, first))
        lines += block_lines(name, f"BLOCK{i}", points, nodes, n_nodes, n_elements)
        layer = np.arange(len(nodes)).reshape(n)[:, :, -1 if i == 0 else 0].ravel() + n_elements + 1
        lines += [f"*SURFACE, NAME=SIDE{i}", *(f"{element}, {'S2' if i == 0 else 'S1'}" for element in layer)]
        end = np.flatnonzero(np.isclose(points[:, 2], 4.0 * i)) + n_nodes + 1
        lines += [f"*NSET, NSET=END{i}", *(f"{node}," for node in end)]
        n_nodes, n_elements, first = n_nodes + len(points), n_elements + len(nodes), 2.0
    force = -PRESSURE * SIZE[0] * SIZE[1] / len(end)
    young, poisson, density = calculix.STEEL
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{young}, {poisson}", "*DENSITY", f"{density}"]
    lines += [f"*SOLID SECTION, ELSET=BLOCK{i}, MATERIAL=STEEL" for i in range(2)]
    lines += ["*BOUNDARY", "END0, 1, 3", "*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE", "SIDE1, SIDE0"]
    lines += ["*SURFACE INTERACTION, NAME=DRY", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{stiffness:.6e}"]
    lines += ["*FRICTION", f"1E3, {0.5 * stiffness:.6e}", "*STEP", "*STATIC", "1., 1.", "*CLOAD", f"END1, 3, {force:.12e}"]
    lines += ["*END STEP", "*STEP, PERTURBATION", "*FREQUENCY", "8", "*END STEP", ""]
    return "\n".join(lines)


def block_lines(name: str, block: str, points: np.ndarray, nodes: np.ndarray, n_nodes: int, n_elements: int) -> list[str]:
    """Return the nodes and elements of a block; CalculiX reads at most 20 characters a number, and 16 numbers a line."""
    lines = ["*NODE", *(f"{n_nodes + i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(points, 1))]
    lines.append(f"*ELEMENT, TYPE={name}, ELSET={block}")
    for i, element in enumerate(nodes + n_nodes + 1, n_elements + 1):
        rest = element[14:]
        lines.append(", ".join(map(str, [i, *element[:14]])) + ("," if len(rest) else ""))
        lines += [", ".join(map(str, rest))] if len(rest) else []
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ccx", default=shutil.which("ccx"))
    parser.add_argument("--refine", type=int, default=1)
    parser.add_argument("--stiffness", type=float, nargs="+", default=[1.0, 10.0, 100.0])
    parser.add_argument("--pairing", choices=("points", "nodes", "projected"))
    chosen = parser.parse_args()
    if not chosen.ccx:
        sys.exit("ccx not found: install CalculiX (Debian: calculix-ccx) or give its path with --ccx")
    coarse, finer = (tuple(chosen.refine * n for n in cells) for cells in ((2, 2, 2), (3, 3, 2)))
    for name in ("C3D8", "C3D20", "C3D20R"):
        for stiffness in chosen.stiffness:
            for words, cells in (("matching", (coarse, coarse)), ("other", (coarse, finer)))[
                : 1 if chosen.pairing == "nodes" else 2
            ]:
                theirs, ours = both(chosen.ccx, deck(name, cells, stiffness * calculix.STEEL[0]), chosen.pairing)
                theirs = np.sort(theirs)
                difference = np.sqrt(ours / theirs) - 1.0
                hertz = " ".join(f"{value:.7g}" for value in np.sqrt(theirs[:2]) / (2.0 * np.pi))
                shown = " ".join(f"{value:+.1e}" for value in difference)
                print(f"{name:7s} {words:9s} K {stiffness:5g} E/m  {hertz} Hz  {shown}", flush=True)


if __name__ == "__main__":
    main()
