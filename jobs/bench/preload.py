"""The effect of computed preload: the blade with uniform pressure, with the pressure of its rotation, and with stress stiffening.

    python jobs/bench/preload.py [--levels 1 5 10]

Needs meshes/fan_small.msh (python meshes/fan_sector.py --size small --out meshes/fan_small.msh).  Prints a table: the joint at
rest, the first frequency with the closed pairs stuck, and at each level the peak per newton, its frequency, slipping and open
pairs.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
from pathlib import Path

import numpy as np

from microslip.scene.read import changed

JOBS = Path(__file__).parents[1]


def row(name: str, scene, levels) -> str:
    """Return a line of the table."""
    with microslip.build(scene) as structure:
        pairs, N = structure.pairs, np.maximum(structure.pairs.N0, 0.0)
        curves = microslip.respond(structure, levels=levels).results.levels
        rest = [f"{(N > 0.0).sum()} of {len(N)}", f"{N.sum() / 1e3:.1f} kN", f"{(N / pairs.area).max() / 1e6:.0f} MPa"]
        rest.append(f"{structure.modes.frequency[0]:.2f} Hz")
    for level in curves:
        amplitude = np.hypot(*level.response[:, 0, 1:3].T)
        i = int(np.argmax(amplitude))
        moving = f"{(level.state[i] == 1).sum()}, {(level.state[i] == 2).sum()}"
        rest.append(f"{1e3 * amplitude[i] / level.level:.3f} mm/N at {level.frequency[i]:.2f} Hz; {moving}")
    return f"| {' | '.join([name, *rest])} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--levels", type=float, nargs="+", default=[1.0, 5.0, 10.0])
    levels = parser.parse_args().levels
    at_speed = microslip.read(JOBS / "fan_speed.toml")
    cases = {
        "uniform 50 MPa, not turning": microslip.read(JOBS / "fan_small.toml"),
        "computed, not stiffened": changed(at_speed, {"statics": {"stress_stiffening": False}}),
        "computed, at speed": at_speed,
    }
    head = [
        "preload",
        "closed at rest",
        "normal force",
        "largest pressure",
        "first frequency",
        *(f"{level:g} N" for level in levels),
    ]
    print(f"| {' | '.join(head)} |\n| {' | '.join(['---'] * len(head))} |")
    for name, scene in cases.items():
        print(row(name, scene, levels), flush=True)


if __name__ == "__main__":
    main()
