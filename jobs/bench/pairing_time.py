"""What it takes to find the contact points of large surfaces whose meshes differ.

    python jobs/bench/pairing_time.py [--kind hex20] [--cells 20 40 80] [--pairing mortar points projected]

Two blocks on each other, the lower one with 7 and 3 cells more along its sides; meshed evenly, and graded, so that the facets' sizes
differ by two for each cell along a side.  Prints the facets of both surfaces, the contact points, and the processor time of each pairing,
once each.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from time import process_time

import numpy as np

from microslip.mesh.data import Mesh
from microslip.mesh.pairing import contact_points
from microslip.mesh.read import read_mesh
from microslip.tables.joint import Joint
from microslip.tables.structure import Body, Model
from microslip.tables.structure_tables import StructureTables

sys.path.insert(0, str(Path(__file__).parents[2] / "meshes"))

from blocks import KINDS, block  # noqa: E402
from msh import write_msh  # noqa: E402

JOINT = Joint(name="joint", surfaces=("under", "on"), friction=0.3, tangential_stiffness=1e13, normal_stiffness=1e13, preload=1e6)


def meshed(kind: str, n: int, is_graded: bool, folder: Path) -> Mesh:
    """Return two blocks of a side of 1 m whose surfaces "under" and "on" touch at z = 0."""

    def mapping(divisions, low: float):
        def places(u, v, w):
            x, y = (_graded(s, cells) if is_graded else s for s, cells in zip((u, v), divisions))
            return np.stack([x, y, low + 0.1 * w], axis=-1)

        return places

    upper, lower = (n, n, 1), (n + 7, n + 3, 1)
    bodies = {
        "upper": block(kind, mapping(upper, 0.0), upper, {"z0": "under"}),
        "lower": block(kind, mapping(lower, -0.1), lower, {"z1": "on"}),
    }
    write_msh(str(folder / "blocks.msh"), bodies)
    own = {name: Body(group=name, material="steel") for name in bodies}
    model = Model(mesh=str(folder / "blocks.msh"))
    return read_mesh(StructureTables.of_file(model=model, bodies=own, joints=(JOINT,)))


def _graded(s: np.ndarray, cells: int) -> np.ndarray:
    """Return places in [0, 1] of such in even cells, (n,): cells that grow, with their mid-sides in the middle."""
    even = np.arange(cells + 1) / cells
    return np.interp(s, even, even**2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", default="hex20", choices=KINDS)
    parser.add_argument("--cells", type=int, nargs="+", default=[20, 40, 80])
    parser.add_argument("--pairing", nargs="+", default=["mortar", "points", "projected"])
    given = parser.parse_args()
    print("| facets | meshed | " + " | ".join(f"{name}: points | s" for name in given.pairing) + " |")
    print("| --- " * (2 + 2 * len(given.pairing)) + "|")
    with tempfile.TemporaryDirectory() as folder:
        for n in given.cells:
            for words, is_graded in (("evenly", False), ("graded", True)):
                mesh, cells = meshed(given.kind, n, is_graded, Path(folder)), []
                for pairing in given.pairing:
                    start = process_time()
                    found = contact_points(mesh, JOINT.with_keys(pairing=pairing))
                    cells.append(f"{found.n_points} | {process_time() - start:.1f}")
                print(f"| {n * n + (n + 7) * (n + 3)} | {words} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
