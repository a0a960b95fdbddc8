"""Peaks at a hundred levels by one continuation, compared with the peaks of response curves: processor time and differences.

    python jobs/bench/peaks_over_level.py jobs/fan_small.toml --levels 5,10,15 --range 0.5,50 --values 100 [--samples 128]

Both without error bars, on one rank, the structure built once.  A curve's peak is its maximum; a peak over the level is the
solution whose neighbours, a fixed phase before and after it, have the same amplitude, or the top of the parabola through them.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import time

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from mpi4py import MPI


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("scene")
    options.add_argument("--levels", default="5,10,15", help="of the curves, N")
    options.add_argument("--range", default="0.5,50", help="of the level, N")
    options.add_argument("--values", type=int, default=100)
    options.add_argument("--samples", type=int, default=128)
    given = options.parse_args()
    levels, ends = ([float(text) for text in words.split(",")] for words in (given.levels, given.range))
    values = np.union1d(np.geomspace(ends[0], ends[1], given.values), np.array(levels))
    scene, keys = microslip.read(given.scene), {"error_bars": False, "samples": given.samples}
    with microslip.build(scene, MPI.COMM_SELF) as structure:
        microslip.respond(structure, levels=levels, **keys)  # computes the static columns of both
        clock = time.process_time()
        curves = microslip.respond(structure, levels=levels, peaks=True, **keys)
        of_curves, clock = time.process_time() - clock, time.process_time()
        over = microslip.peaks(structure, {"level": ends}, values=values.tolist(), **keys)
        of_levels = time.process_time() - clock
    highest = max(over, key=lambda curve: curve.amplitude.max())
    print(
        f"{len(levels)} curves with their peaks {of_curves:.1f} s, {len(values)} levels {of_levels:.1f} s: {of_levels / of_curves:.2f}"
    )
    print(
        f"{len(over)} peaks; {len(highest.value)} points, {np.isin(values, highest.value).sum()} of the values; {highest.points.failure}"
    )
    for level in levels:
        peak = max(curves.peaks[level], key=lambda peak: abs(peak.amplitude))
        for i in np.flatnonzero(highest.value == level):
            size, frequency = (
                highest.amplitude[i] / abs(peak.amplitude) - 1.0,
                2.0 * np.pi * highest.frequency[i] / peak.omega - 1.0,
            )
            print(f"{level:g} N: amplitude {size:+.1e}, frequency {frequency:+.1e} of the curve's peak")


if __name__ == "__main__":
    main()
