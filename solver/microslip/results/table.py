"""frf.csv: one row a converged point and output, on the disk as soon as the point is."""

from __future__ import annotations

import csv
import os

import numpy as np

from ..continuation.branch import Branch, Point
from ..error_estimate.components import PARTS, total
from ..parallel.files import said_of, written_whole
from .measures import amplitude, counts, phase

HEADER = (
    "level_N",
    "point",
    "frequency_Hz",
    "output",
    "amplitude_m",
    "phase_rad",
    "mean_m",
    "sticking",
    "slipping",
    "open",
    "unknowns",
    "newton",
    "friction_J",
    "damping_J",
    "input_J",
    "seconds",
    "error_m",
    *(f"error_{part}_m" for part in PARTS),
    "segment",
)
NAME = "frf.csv"


class ResponseTable:
    """The table of a run, created with its header.  Rank 0 only.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """

    def __init__(self, folder: str, outputs: tuple[str, ...]):
        self.path = os.path.join(folder, NAME)
        self.outputs = outputs
        with said_of(self.path):
            self._begin(self.path)

    def _begin(self, path: str) -> None:
        """Open a file and write the header."""
        self._file = open(path, "w", encoding="utf-8", newline="")
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(HEADER)
        self._file.flush()

    def add(self, level: float, i: int, point: Point) -> None:
        """Append the ``i``-th point of a level [N], counted from 0; flushed before this returns."""
        shared = [
            *(int(n) for n in counts(point.state)),
            point.unknowns,
            point.newton,
            *_digits(point.friction, point.damping, point.input),
            f"{point.seconds:.4g}",
        ]
        with said_of(self.path):
            for k, (name, u) in enumerate(zip(self.outputs, point.response, strict=True)):
                own = _digits(float(amplitude(u)), float(phase(u)), u[0])
                first = [*_digits(level), i, *_digits(point.omega / (2.0 * np.pi)), name]
                self._rows.writerow([*first, *own, *shared, *_bars(point, k), point.segment])
            self._file.flush()

    def put_in_order(self, branches: list[Branch]) -> None:
        """Replace the table by that of these branches, one after the other, and close it."""
        self.close()
        with written_whole(self.path) as beside:
            self._begin(beside)
            for branch in branches:
                for i, point in enumerate(branch.points):
                    self.add(branch.level, i, point)
            self.close()

    def close(self) -> None:
        with said_of(self.path):
            self._file.close()


def _bars(point: Point, k: int) -> list[str]:
    """Return the error bar of output k and its parts; empty cells where they were not asked for."""
    if point.error is None:
        return [""] * (1 + len(PARTS))
    return [f"{value:.4g}" for value in (total(point.error[k]), *point.error[k])]


def _digits(*values: float) -> list[str]:
    return [f"{value:.13g}" for value in values]
