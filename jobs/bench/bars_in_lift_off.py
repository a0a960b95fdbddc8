"""Error bars of a joint whose pairs all slip and lift off in every cycle, against a solution with many more harmonics.

    python jobs/bench/bars_in_lift_off.py [--harmonics 5 9 15] [--best 25] [--modes 40]

The block on the ground at 4 N, where its amplitude exceeds 0.6 of the peak: complex amplitudes compared with those of the best
set of harmonics and more modes, interpolated between its points by a spline; all relative to the peak.  The last row has the
harmonics that the scene's accuracy selects.  Needs meshes/block_on_ground.msh (the scene gives the command).
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from microslip.parallel.petsc import initialise

SCENE = Path(__file__).parents[1] / "block_on_ground.toml"
LEVEL, HIGH = 4.0, 0.6
HEAD = "| harmonics | points; outside | largest error | largest bar | error there | corrected: largest error | bar | median error; bar | s |"


def curve(structure, **keys):
    """Return the only level's curves of the only output, and their processor time [s]."""
    began = time.process_time()
    response = microslip.respond(structure, levels=[LEVEL], **keys)
    assert not response.failures, response.failures
    return response[response.outputs[0]], time.process_time() - began


def amplitude(curves):
    """Return harmonic 1, complex."""
    return curves.harmonic(1)[0]


def row(name, measured, true, peak) -> str:
    """Return a line of the table."""
    curves, seconds = measured
    values, high = amplitude(curves), np.abs(amplitude(curves)) > HIGH * peak
    exact = true(curves.frequency[0])
    error, bar = np.abs(values - exact)[high] / peak, curves.error[0][high] / peak
    left, rest = np.abs(curves.corrected[0] - exact)[high] / peak, curves.error_corrected[0][high] / peak
    there = error[bar.argmax()]
    numbers = (error.max(), bar.max(), there, left.max(), rest.max())
    of = " | ".join(f"{100.0 * number:.2g} %" for number in numbers)
    median = f"{100.0 * np.median(left):.2g} %; {100.0 * np.median(rest):.2g} %"
    return f"| {name} | {high.sum()}; {(error > bar).sum()} | {of} | {median} | {seconds:.1f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--harmonics", type=int, nargs="+", default=[5, 9, 15])
    parser.add_argument("--best", type=int, default=25)
    parser.add_argument("--modes", type=int, default=40, help="of the best")
    given = parser.parse_args()
    initialise()
    structure = microslip.build(microslip.read(SCENE))
    best, _ = curve(structure, harmonics=given.best, samples=512, modes=given.modes, error_bars=False)
    frequency, first = np.unique(best.frequency[0], return_index=True)
    true, peak = CubicSpline(frequency, amplitude(best)[first]), np.abs(amplitude(best)).max()
    print(HEAD + "\n|" + 9 * " --- |")
    for H in given.harmonics:
        print(row(H, curve(structure, harmonics=H), true, peak), flush=True)
    print(row("by accuracy", curve(structure), true, peak), flush=True)


if __name__ == "__main__":
    main()
