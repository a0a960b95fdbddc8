"""Warnings that a point solves only the truncated equations, checked by time integration: false alarms and missed points.

    python jobs/bench/false_alarms.py [--points 1000] [--seed 21] [--first 0] [--harmonics 3] [--without-lift-off]

Draws random systems (tests/verification/random_structures.py) until this number of points is judged: 2 to 12 degrees of freedom,
1 to 4 pairs, by default with levels at which pairs open.  Time integration from each point reaches a steady state, the solution
of the full equations near the point; if it is far away, further integrations start from solutions with 15 harmonics, and the
nearest steady state counts.  Errors, bars and amplitudes are relative to the peak.  A false alarm is a warning at a point with an
error below 1 % of the peak.  A missed point has an error above 1.5 bars and above 1 % of the peak without a warning.  Points
beside a fold and points without a steady state are counted separately.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests")]

from verification.random_systems import FAR, Judged, judge, judge_from_more, solve  # noqa: E402  initialises PETSc

WRONG = 1e-2  # of the peak
BEYOND = 1.5  # bars


def kind(point: Judged) -> str:
    """Return the class of a point, by its note and its error."""
    if not point.is_steady:
        return "without a steady state"
    if "beside a fold" in point.kinds:
        return "beside a fold, noted" if FAR in point.notes else "beside a fold"
    if FAR in point.notes:
        return "false alarms" if point.error < WRONG else "noted and wrong"
    return "missed" if point.error > max(WRONG, BEYOND * point.bar) else "neither noted nor missed"


def main() -> None:
    """Print a line for each noted or missed point, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=21)
    parser.add_argument("--first", type=int, default=0, help="number of the first system")
    parser.add_argument("--harmonics", type=int, default=3)
    parser.add_argument("--steps", type=int, default=512, help="of time integration, a period")
    parser.add_argument("--without-lift-off", action="store_true")
    given, start = parser.parse_args(), time.process_time()
    counts: Counter[str] = Counter()
    opens, n_judged, number = 0, 0, given.first
    while n_judged < given.points:
        result = solve(given.seed, number, 6, {"harmonics": given.harmonics}, not given.without_lift_off)
        counts["curves that ended early"] += len(result.failures)
        for i, point in enumerate(judge([result], given.steps)):
            if kind(point) == "missed":
                judge_from_more(result, i, given.steps)
            what = kind(point)
            counts[what] += 1
            opens, n_judged = opens + ("opens" in point.kinds), n_judged + point.is_steady
            if FAR in point.notes or what == "missed" or any("judged from" in of for of in point.kinds):
                print(
                    f"system {number}, level {point.level:.4g}, omega {point.omega:.6g}: {what}, error {point.error:.1e}, "
                    f"bar {point.bar:.1e}, amplitude {abs(result.amplitudes[i]):.2g}, {', '.join(point.kinds)}",
                    flush=True,
                )
        number += 1
        print(f"{n_judged} points up to system {number - 1}, {opens} with pairs that open: {dict(counts)}", flush=True)
    print(
        f"{n_judged} points of {number - given.first} systems judged, {opens} with pairs that open; {time.process_time() - start:.0f} s of the processor"
    )
    print(*(f"{name:26} {n}" for name, n in sorted(counts.items())), sep="\n")


if __name__ == "__main__":
    main()
