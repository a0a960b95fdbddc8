"""What meshes that do not match cost in accuracy: the demo's blade on its disc, meshed alike, and on discs that are meshed anew.

    python jobs/bench/meshes_apart.py [--size small medium] [--levels 1 5 10]

Prints a table for each size of the blade's mesh: contact pairs, and at each level the peak per newton and how far it is from that of
nodes in pairs.  The last rows refine the disc until its own mesh no longer matters.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

import microslip
from microslip.scene.read import changed

JOBS = Path(__file__).parents[1]
sys.path.insert(0, str(JOBS.parent / "meshes"))

from fan_sector import SIZES, Divisions, Shape, fan_sector  # noqa: E402
from msh import write_msh  # noqa: E402


def discs(n: Divisions) -> dict[str, Divisions]:
    """Return the divisions of discs beside those of a blade, by name."""
    return {
        "coarser along the slot": replace(n, chord=max(2, n.chord - 1)),
        "finer along the slot": replace(n, chord=n.chord + 3),
        "finer along and across": replace(n, chord=n.chord + 3, flank=n.flank + 1),
        "twice as fine": replace(n, chord=2 * n.chord + 1, flank=2 * n.flank + 1, wall=n.wall + 1, neck=n.neck + 1),
    }


def peaks(scene, levels) -> tuple[int, np.ndarray, float]:
    """Return the number of pairs, the peak per newton at each level [m/N] and the seconds of all."""
    start = perf_counter()
    with microslip.build(scene) as structure:
        found = microslip.respond(structure, levels=levels, error_bars=False).results.levels
        n_pairs = structure.pairs.n_pairs
    amplitudes = [np.hypot(*level.response[:, 0, 1:3].T).max() / level.level for level in found]
    return n_pairs, np.array(amplitudes), perf_counter() - start


def table(size: str, levels, folder: Path) -> None:
    """Print the rows of a size of the blade's mesh."""
    scene = microslip.read(JOBS / "fan_small.toml")
    joint = scene.joints[0].name

    def case(name: str, disc: Divisions, pairing: str, first: str):
        path = folder / f"{size}_{name.replace(' ', '_').replace(':', '')}.msh"
        blade = fan_sector(Shape(), SIZES[size])["blade"]
        write_msh(str(path), {"blade": blade, "disc": fan_sector(Shape(), disc)["disc"]})
        surfaces = ("blade_root", "disc_slot") if first == "blade" else ("disc_slot", "blade_root")
        own = changed(scene, {"model": {"mesh": str(path)}}, {joint: {"pairing": pairing, "surfaces": surfaces}})
        return peaks(own, levels)

    cases = {"nodes in pairs": (SIZES[size], "nodes", "blade"), "the same meshes: cells": (SIZES[size], "points", "blade")}
    for name, disc in discs(SIZES[size]).items():
        cases[f"disc {name}: nodes of the blade"] = (disc, "projected", "blade")
        cases[f"disc {name}: cells of the blade"] = (disc, "points", "blade")
        cases[f"disc {name}: cells of the disc"] = (disc, "points", "disc")
    print(f"\nblade of the {size} mesh\n")
    print(f"| meshes | pairs | {' | '.join(f'{level:g} N [mm/N]' for level in levels)} | s |")
    print("| --- | --- | " + " | ".join(["---"] * len(levels)) + " | --- |")
    exact = None
    for name, what in cases.items():
        n_pairs, found, seconds = case(name, *what)
        exact = found if exact is None else exact
        cells = [f"{1e3 * value:.4f} ({100.0 * (value / own - 1.0):+.2f} %)" for value, own in zip(found, exact)]
        print(f"| {name} | {n_pairs} | {' | '.join(cells)} | {seconds:.1f} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", nargs="+", choices=SIZES, default=["small"])
    parser.add_argument("--levels", type=float, nargs="+", default=[1.0, 5.0, 10.0])
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for size in given.size:
            table(size, given.levels, Path(folder))


if __name__ == "__main__":
    main()
