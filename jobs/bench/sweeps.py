"""The cost of a sweep of peaks compared with curves: frictions of a scene, each by its peak alone and by its curve.

    python jobs/bench/sweeps.py [SCENE.toml] [--joint dovetail] [--frictions 0.1:0.6:11]

Prints a line for each friction: amplitude and frequency of its peak, Newton iterations and processor seconds of the peak with its
half-power width, and of the curve without peaks and error bars; then the totals.  With --alone also the largest difference in
amplitude, frequency and width from a sweep of that sample alone.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=ROOT / "jobs" / "fan_small.toml")
    parser.add_argument("--joint", default="dovetail")
    parser.add_argument("--frictions", default="0.1:0.6:11")
    parser.add_argument("--alone", action="store_true")
    arguments = parser.parse_args()
    first, last, n = arguments.frictions.split(":")
    values = np.linspace(float(first), float(last), int(n))
    scene = microslip.read(arguments.scene, ["solver.error_bars=false"])
    start = time.perf_counter()
    structure = microslip.build(scene)
    print(f"set-up {time.perf_counter() - start:.3g} s")
    times = {-1: time.process_time()}
    key = f"joints.{arguments.joint}.friction"
    table = microslip.sweep(structure, {key: values}, on_sample=lambda i, sample: times.update({i: time.process_time()}))
    ends = list(times.values())
    spent = {i: end - before for i, before, end in zip(list(times)[1:], ends, ends[1:])}
    spent[next(iter(spent))] = np.nan  # with the curve of the scene itself
    nominal = table.nominal
    print(f"the scene itself: {nominal.newton} Newton iterations of its peak, {nominal.seconds:.3g} s with its curve")
    print(
        f"{'friction':>9} {'peak m':>12} {'Hz':>10} {'slip':>5} {'Newton':>7} {'s':>7} {'curve Newton':>13} {'s':>7} {'ratio':>6}"
    )
    totals, level = np.zeros(4), max(scene.response.levels)
    for i, (value, sample) in enumerate(zip(values, table.samples)):
        start = time.process_time()
        curve = microslip.respond(structure, levels=level, friction={arguments.joint: value}).results.levels[0]
        cost = np.array([sample.newton, spent[i], curve.newton.sum(), time.process_time() - start])
        totals += cost if np.isfinite(cost).all() else 0.0
        newton, seconds, of_curve, time_of_curve = cost
        print(
            f"{value:9.3f} {sample.amplitude:12.6g} {sample.frequency:10.6g} {sample.slipping:5d} {newton:7.0f} {seconds:7.3g} "
            f"{of_curve:13.0f} {time_of_curve:7.3g} {seconds / time_of_curve:6.2f}{'  along its curve' * sample.is_followed}",
            flush=True,
        )
    if len(values) > 1:
        print(
            f"all but the first: {totals[0]:.0f} and {totals[2]:.0f} Newton iterations, {totals[1]:.3g} and {totals[3]:.3g} s: a peak takes "
            f"{totals[0] / totals[2]:.2f} of the iterations and {totals[1] / totals[3]:.2f} of the time of a curve"
        )
    if arguments.alone:
        alone = [microslip.sweep(structure, {key: [value]}).samples[0] for value in values]
        for name in ("amplitude", "frequency", "width"):
            by_itself = np.array([getattr(sample, name) for sample in alone])
            missing, difference = np.count_nonzero(np.isnan(by_itself)), np.abs(getattr(table, name) / by_itself - 1.0)
            print(f"{name}: {np.nanmax(difference):.1e} from that of each sample alone, {missing} of which are missing")


if __name__ == "__main__":
    main()
