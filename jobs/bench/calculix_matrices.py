"""Stiffness and mass matrices of every element kind, compared entry by entry with those that CalculiX stores.

    PYTHONPATH=solver:tests python jobs/bench/calculix_matrices.py [path of ccx]

Needs ``ccx`` (Debian: calculix-ccx).  For each element type CalculiX assembles a curved, twisted and tapered bar with *FREQUENCY,
SOLVER=MATRIXSTORAGE.  (For C3D8I the bar is straight, the incompatible modes are condensed, and the mass of the nodes is
compared.)  Its job.sti, job.mas and job.dof are read as for a scene, and compared with K and M of the same nodes and elements.
The largest difference is relative to the largest entry; CalculiX writes 14 digits.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from small_fe import assemble
from verification.calculix import STEEL, TYPES, bar, deck

from microslip.formats.matrices.read import read_matrix


def stored(ccx: str, name: str, straight: bool):
    """Return K, M and the row numbers, 3 node + direction from 0, as CalculiX stores them."""
    text = deck(name, static=straight)
    head, _, _ = text.partition("*STEP")
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder) / "bar.inp"
        job.write_text(head + "*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n6\n*END STEP\n")
        subprocess.run([ccx, "bar"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        K = read_matrix(job.with_suffix(".sti"), "stiffness", "K")
        M = read_matrix(job.with_suffix(".mas"), "mass", "M")
    return K.matrix, M.matrix, 3 * (K.dofs.nodes - 1) + K.dofs.directions - 1


def differences(ccx: str, name: str) -> tuple[int, float, float]:
    """Return the number of rows, and the largest difference of K and of M over their largest entries."""
    kind, integration, incompatible = TYPES[name]
    points, nodes, _ = bar(kind, straight=incompatible and kind == "hex8")
    own = assemble(kind, points, nodes, *STEEL, integration, incompatible)
    K, M, rows = stored(ccx, name, straight=incompatible and kind == "hex8")
    theirs = [A.toarray() for A in (K, M)]
    is_node = rows < 3 * len(points)  # CalculiX stores the incompatible modes of C3D8I as additional nodes
    theirs = [condensed(theirs[0], is_node), theirs[1][np.ix_(is_node, is_node)]]
    at = rows[is_node]
    of_K, of_M = (float(np.abs(A.tocsr()[at][:, at] - B).max() / np.abs(B).max()) for A, B in zip(own, theirs))
    return len(at), of_K, of_M


def condensed(K: np.ndarray, retained: np.ndarray) -> np.ndarray:
    """Return the stiffness condensed to the retained rows (no force on the others)."""
    if retained.all():
        return K
    own, others, between = (K[np.ix_(i, j)] for i, j in ((retained, retained), (~retained, ~retained), (retained, ~retained)))
    return own - between @ np.linalg.solve(others, between.T)


def main() -> None:
    ccx = sys.argv[1] if len(sys.argv) > 1 else shutil.which("ccx")
    if ccx is None:
        sys.exit("ccx not found; in Debian: apt install calculix-ccx")
    print("| element | rows | stiffness | mass |\n| --- | --- | --- | --- |")
    for name in TYPES:
        n, K, M = differences(ccx, name)
        print(f"| {name} | {n} | {K:.1e} | {M:.1e} |")


if __name__ == "__main__":
    main()
