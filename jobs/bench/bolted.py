"""The effect of non-matching meshes and of a computed preload in a bolted lap: jobs/bolted_lap.toml and variants of the joint.

    python jobs/bench/bolted.py [--levels 0.2 1 4]

Generates the meshes.  Prints a table: contact points, closed points at rest, largest pressure, frequency of the mode with the
closed points stuck, and at each level the peak per newton and its frequency.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from microslip.scene.read import changed, scene_of

JOBS = Path(__file__).parents[1]
sys.path.insert(0, str(JOBS.parent / "meshes"))

from bolted_lap import BoltedLap, bolted_lap  # noqa: E402
from msh import write_msh  # noqa: E402

UNIFORM = 1.637e7  # Pa: three bolts of 6 kN on the area of the lap


def cases(folder: Path) -> dict[str, microslip.Scene]:
    """Return the scene with other meshes and pairings, by name."""
    paths = {matching: folder / f"matching_{matching}.msh" for matching in (0, 1, 2)}
    for matching, path in paths.items():
        write_msh(str(path), bolted_lap(BoltedLap(matching=matching)))

    def scene(matching: int, **lap):
        whole = microslip.read(JOBS / "bolted_lap.toml")
        return changed(whole, {"model": {"mesh": str(paths[matching])}}, {"lap": lap})

    return {
        "the scene: meshes differ, mortars on plate 1": scene(0),
        "meshes differ, cells of plate 1": scene(0, pairing="points"),
        "both meshed as plate 1, mortars": scene(1, pairing="mortar"),
        "both meshed as plate 1, cells": scene(1, pairing="points"),
        "both meshed as plate 1, nodes": scene(1),
        "meshes differ, mortars on plate 2": scene(0, surfaces=("lap_2", "lap_1")),
        "meshes differ, cells of plate 2": scene(0, surfaces=("lap_2", "lap_1"), pairing="points"),
        "both meshed as plate 2, mortars": scene(2, pairing="mortar"),
        "both meshed as plate 2, cells": scene(2, pairing="points"),
        "both meshed as plate 2, nodes": scene(2),
        "the scene, uniform 16.4 MPa": without_statics(scene(0), preload=UNIFORM),
    }


def without_statics(scene, preload: float):
    """Return the scene with a given preload [Pa] on the lap and without bolt forces."""
    raw = scene.model_dump(exclude_unset=True)
    raw["joints"] = [joint | {"preload": preload} for joint in raw["joints"]]
    return scene_of({name: table for name, table in raw.items() if name != "statics"}, scene.path)


def row(name: str, scene, levels) -> str:
    """Return a line of the table."""
    with microslip.build(scene) as structure:
        pairs, N = structure.pairs, np.maximum(structure.pairs.N0, 0.0)
        curves = microslip.respond(structure, levels=levels).results.levels
        rest = [f"{pairs.n_pairs}", f"{(N > 0.0).sum()}", f"{(N / pairs.area).max() / 1e6:.1f} MPa"]
        rest.append(f"{structure.modes.frequency[1]:.2f} Hz")
    for level in curves:
        amplitude = np.hypot(*level.response[:, 0, 1:3].T)
        i = int(np.argmax(amplitude))
        rest.append(f"{1e6 * amplitude[i] / level.level:.1f} µm/N at {level.frequency[i]:.2f} Hz")
    return f"| {' | '.join([name, *rest])} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--levels", type=float, nargs="+", default=[0.2, 1.0, 4.0])
    levels = parser.parse_args().levels
    head = ["lap", "points", "closed", "largest pressure", "mode 2", *(f"{level:g} N" for level in levels)]
    print(f"| {' | '.join(head)} |\n| {' | '.join(['---'] * len(head))} |")
    with tempfile.TemporaryDirectory() as folder:
        for name, scene in cases(Path(folder)).items():
            print(row(name, scene, levels), flush=True)


if __name__ == "__main__":
    main()
