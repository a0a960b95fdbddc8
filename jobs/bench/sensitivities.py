"""The cost of the sensitivities of a point compared with its solution, in processor time, with and without error bars.

python jobs/bench/sensitivities.py jobs/fan_small.toml [--levels 5,15]
"""

import argparse
from time import process_time

from mpi4py import MPI

import microslip


def main() -> None:
    """Measure and print, on one rank."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--levels", default="5,15", help="N, with commas")
    options = parser.parse_args()
    print("| error bars | level | points | ms a point | ms of its sensitivities | share of the rest |")
    with microslip.build(microslip.read(options.scene), MPI.COMM_WORLD) as structure:
        spent = timed()
        for bars in (True, False):
            for level in map(float, options.levels.split(",")):
                spent[:], begin = [0.0, 0], process_time()
                microslip.respond(structure, levels=[level], error_bars=bars, sensitivities=True)
                total, (own, n) = process_time() - begin, spent
                row = ("with" if bars else "without", f"{level:g} N", str(n), f"{1e3 * total / n:.1f}", f"{1e3 * own / n:.1f}")
                print("| " + " | ".join((*row, f"{own / (total - own):.2f}")) + " |", flush=True)


def timed() -> list:
    """Return seconds and number of the points whose sensitivities are computed from now on."""
    from microslip.continuation import acceptance  # after PETSc's start

    spent, of_point = [0.0, 0], acceptance.with_sensitivities

    def measured(*arguments):
        begin = process_time()
        point = of_point(*arguments)
        spent[0], spent[1] = spent[0] + process_time() - begin, spent[1] + 1
        return point

    acceptance.with_sensitivities = measured
    return spent


if __name__ == "__main__":
    main()
