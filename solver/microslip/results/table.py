"""frf.csv: one row for each converged point and output, written to disk with the point."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable
from contextlib import suppress

from ..points.branch import QUANTITIES, Branch, Point
from ..points.quantities import Column
from ..system.files import atomic_write, file_errors

_LATER = ("corrected", "error_corrected", "multipliers", "neutral")  # columns are added at the end
_AFTER_UNIT = [quantity for quantity in QUANTITIES if quantity.field in _LATER]
_FIRST, *_REST = (
    quantity for quantity in QUANTITIES if quantity not in _AFTER_UNIT
)  # the frequency is before the name of the output
COLUMNS = (
    Column("level_N", "level"),
    Column("point", "number of the point on its curve, from 0"),
    *_FIRST.columns,
    Column("output", "name of the output"),
    *(column for quantity in _REST for column in quantity.columns),
    Column("unit", "unit of the output: that of its amplitude, mean and error bar, also if their columns end in `_m`"),
    *(column for quantity in _AFTER_UNIT for column in quantity.columns),
)
NAME = "frf.csv"


def write_table(path: str, columns: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table with the names of its columns.  Local.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        file.write(_as_csv([columns, *rows]))


def _as_csv(rows: Iterable[Iterable[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode(errors="backslashreplace")


class ResponseTable:
    """The table of a run, created with its header.  Rank 0 only.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """

    def __init__(self, folder: str, outputs: tuple[str, ...], units: tuple[str, ...]):
        self.path = os.path.join(folder, NAME)
        self.outputs, self.units = outputs, units
        with file_errors(self.path):
            self._begin(self.path)

    def _begin(self, path: str) -> None:
        """Open a file and write the header."""
        self._file, self._length = open(path, "wb", buffering=0), 0
        try:
            self._append([[column.name for column in COLUMNS]])
        except OSError:
            self._file.close()
            raise

    def _append(self, rows: Iterable[Iterable[object]]) -> None:
        """Write rows, all of them or none: rows cut short by a full disk are removed."""
        data = _as_csv(rows)
        try:
            written = 0
            while written < len(data):
                written += self._file.write(data[written:])
        except OSError:
            with suppress(OSError):  # of a device
                self._file.truncate(self._length)
            raise
        self._length += written

    def add(self, level: float, i: int, point: Point) -> None:
        """Append the ``i``-th point of a level [N], counted from 0; passed to the system before this returns."""
        with file_errors(self.path):
            self._append(self._row(level, i, point, k) for k in range(len(self.outputs)))

    def _row(self, level: float, i: int, point: Point, k: int) -> list[object]:
        """Return the cells of a point and its output ``k``."""
        cells = [cell for quantity in _REST for cell in quantity.cells(point, k)]
        last = [cell for quantity in _AFTER_UNIT for cell in quantity.cells(point, k)]
        return [f"{level:.13g}", i, *_FIRST.cells(point, k), self.outputs[k], *cells, self.units[k], *last]

    def is_gone(self) -> bool:
        """Return whether the file was removed or replaced."""
        try:
            return not os.path.samestat(os.stat(self.path), os.fstat(self._file.fileno()))
        except OSError:
            return True

    def put_in_order(self, branches: list[Branch]) -> None:
        """Replace the table by that of these branches, one after the other, and close it."""
        self.close()
        with atomic_write(self.path) as temporary:
            self._begin(temporary)
            for branch in branches:
                for i, point in enumerate(branch.points):
                    self.add(branch.level, i, point)
            self.close()

    def close(self) -> None:
        """Write the remaining rows and close the file."""
        with file_errors(self.path):
            self._file.close()
