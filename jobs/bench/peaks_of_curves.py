"""The cost of ``peaks = true`` compared with that of the curves alone: Newton solves and processor time.

    python jobs/bench/peaks_of_curves.py jobs/fan_small.toml jobs/lap_joint.toml --times 3

With the levels and settings of each scene, on one rank, the structure built once; curves and curves with peaks in turn.  The last
number is the time of the search for a higher solution on another part of the curve (``on_higher_piece``), of the last run.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded

# isort: split
import argparse
import time
from unittest.mock import patch

import numpy as np

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

from mpi4py import MPI

from microslip.continuation.corrector import Corrector
from microslip.continuation.maximum import _Search

ON_HIGHER_PIECE = _Search.on_higher_piece


class Clock:
    """Processor time in ``on_higher_piece`` [s]."""

    seconds = 0.0

    def timed(self, search, maximum):
        """Return the method's result, timed."""
        clock = time.process_time()
        try:
            return ON_HIGHER_PIECE(search, maximum)
        finally:
            self.seconds += time.process_time() - clock


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("scenes", nargs="+")
    options.add_argument("--times", type=int, default=3, help="of which the median counts")
    given = options.parse_args()
    for path in given.scenes:
        solves, seconds = np.zeros((2, given.times), dtype=int), np.zeros((2, given.times))
        with microslip.build(microslip.read(path), MPI.COMM_SELF) as structure:
            microslip.respond(structure, peaks=True)  # computes the static columns of both
            for i in range(given.times):
                for with_peaks in (False, True):
                    of_pieces = Clock()
                    with (
                        patch.object(Corrector, "correct", autospec=True, side_effect=Corrector.correct) as correct,
                        patch.object(_Search, "on_higher_piece", lambda *of, to=of_pieces: to.timed(*of)),
                    ):
                        clock = time.process_time()
                        curves = microslip.respond(structure, peaks=with_peaks)
                        seconds[int(with_peaks), i] = time.process_time() - clock
                    solves[int(with_peaks), i] = correct.call_count
        n_peaks, (without, with_peaks) = sum(map(len, curves.peaks.values())), np.median(seconds, axis=1)
        print(
            f"{path}: {n_peaks} peaks; {solves[0, 0]} and {solves[1, 0]} solves, {(solves[1, 0] - solves[0, 0]) / n_peaks:.0f} a peak; "
            f"{without:.2f} and {with_peaks:.2f} s: {with_peaks / without:.2f}; on other pieces {of_pieces.seconds:.3f} s"
        )


if __name__ == "__main__":
    main()
