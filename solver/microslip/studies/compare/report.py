"""Comparison of methods at the same points: the table, compare.csv and compare.png.  Rank 0 only."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import matplotlib
import numpy as np
from matplotlib.lines import Line2D

from ...observe.screen_table import screen_table
from ...points.branch import Point
from ...results.layout import log_scale
from ...results.measures import AMPLITUDE, Shown
from ...results.style import LINEAR, RC, SERIES_COLOURS, WIDTH, Page, Titled, some, with_prefix
from ...system.files import make_folder
from ..records import cell, write_csv

_MOST_LEVELS = 4  # levels in the picture
_FLOOR = 1e-12  # least difference on a logarithmic axis
_COLOURS = (*SERIES_COLOURS, "#1a1a1a", "#8a8a8a")


class Solved(Protocol):
    """The points of one method, in order."""

    @property
    def points(self) -> list[Point]:
        """The points, in order."""


@dataclass(frozen=True)
class Row:
    """Results of one method at the frequencies of one level."""

    level: float  # N
    method: str
    setup: float  # s, time of the reduction
    points: list[Point]  # converged, in order
    failure: str | None  # reason of an early end
    shown: Shown = AMPLITUDE  # quantity of the first output

    @property
    def frequency(self) -> np.ndarray:
        """Return (n,) Hz."""
        return np.array([point.omega for point in self.points]) / (2.0 * np.pi)

    @property
    def top(self) -> int:
        """Return the index of the point where the first output is largest."""
        return int(np.argmax(np.abs(self.values)))

    @property
    def values(self) -> np.ndarray:
        """Return the values of the first output: amplitude of harmonic 1, for statics the mean, (n,), in its unit."""
        return np.array([self.shown.of(point.response[0]) for point in self.points])


def differences(row: Solved, reference: Solved) -> np.ndarray:
    """Return the largest difference of all harmonics and outputs over the reference's peak at each common point, (n,) [-]."""
    n = min(len(row.points), len(reference.points))
    exact = np.array([point.response for point in reference.points])
    peak = np.abs(exact).max(axis=(0, 2), initial=0.0)[:, None]
    values = np.array([point.response for point in row.points[:n]])
    return (np.abs(values - exact[:n]) / np.where(peak > 0.0, peak, 1.0)).max(axis=(1, 2)) if n else np.empty(0)


def energy_difference(row: Row, reference: Row) -> float:
    """Return the largest difference of the friction loss over the largest of the reference; nan if the reference has no loss."""
    exact = np.array([point.friction for point in reference.points])
    values = np.array([point.friction for point in row.points])
    n, most = min(len(values), len(exact)), np.abs(exact).max(initial=0.0)
    return float(np.abs(values[:n] - exact[:n]).max(initial=0.0) / most) if most > 0.0 and n else float("nan")


COLUMNS: dict[str, tuple[str, Callable[[Row, Row], Any]]] = {  # heading, and the value from a row with points and its reference
    "level_N": ("level N", lambda row, _: row.level),
    "method": ("method", lambda row, _: row.method),
    "setup_s": ("set-up s", lambda row, _: row.setup),
    "ms_a_point": ("ms a point", lambda row, _: 1e3 * float(np.mean([point.seconds for point in row.points]))),
    "points": ("points", lambda row, _: len(row.points)),
    "evaluations": ("Newton", lambda row, _: sum(point.newton for point in row.points)),
    "unknowns_min": ("unknowns min", lambda row, _: min(point.unknowns for point in row.points)),
    "unknowns_max": ("max", lambda row, _: max(point.unknowns for point in row.points)),
    "peak_m": ("peak m", lambda row, _: float(row.values[row.top])),
    "peak_Hz": ("at Hz", lambda row, _: float(row.frequency[row.top])),
    "difference_percent": ("difference %", lambda row, reference: 100.0 * float(differences(row, reference).max(initial=0.0))),
    "energy_difference_percent": ("of energy %", lambda row, reference: 100.0 * energy_difference(row, reference)),
    "failure": ("failure", lambda row, _: row.failure or ""),
    "unit": ("unit", lambda row, _: row.shown.unit),  # unit of the peak, also if the column name has another one
}
_ALWAYS = ("level_N", "method", "setup_s", "points", "failure", "unit")  # columns known without points


def numbers(row: Row, reference: Row) -> dict[str, Any]:
    """Return the numbers of a row by the names of ``COLUMNS``; NaN without points."""
    return {name: of(row, reference) if row.points or name in _ALWAYS else float("nan") for name, (_, of) in COLUMNS.items()}


def write_comparison(rows: Sequence[Row], scene: Titled, folder: str) -> str:
    """Write compare.csv and compare.png; return the table.  Local.  The first row of each level is the reference.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(folder)
    references: dict[float, Row] = {}
    for row in rows:
        references.setdefault(row.level, row)
    ordered = [row for level in references for row in rows if row.level == level]
    records = [numbers(row, references[row.level]) for row in ordered]
    write_csv(f"{folder}/compare.csv", COLUMNS, records)
    with matplotlib.rc_context(RC):
        draw_comparison(rows, references, scene, f"{folder}/compare.png")
    return table(records, next(iter(references.values())))


def table(records: Sequence[dict], reference: Row) -> str:
    """Return the records as a table for the screen; differences are from the reference."""
    shown = reference.shown
    headings = {name: heading for name, (heading, _) in COLUMNS.items()} | {
        "level_N": f"level {shown.level_unit}".removesuffix(" 1"),
        "peak_m": f"peak {shown.unit}",
    }
    left_out = {"unit"} if any(entry["failure"] for entry in records) else {"unit", "failure"}
    names = [name for name in COLUMNS if name not in left_out]
    rows = [(entry["level_N"], [_cell(name, entry, reference.method) for name in names]) for entry in records]
    return screen_table(
        f"differences from {reference.method}, in % of its peak; set-up without factor and modes, which all share",
        [headings[name] for name in names],
        rows,
        left=("method", "failure"),
        wraps=("failure",),
    )


def _cell(name: str, entry: dict, reference: str) -> str:
    value = entry[name]
    if name in ("difference_percent", "energy_difference_percent"):
        return "reference" if entry["method"] == reference else cell(value, 2)
    return cell(value, {"peak_m": 5, "peak_Hz": 7}.get(name, 3))


def draw_comparison(rows: Sequence[Row], references: dict[float, Row], scene: Titled, path: str) -> None:
    """Draw the curves of all methods and their differences from the reference, one column per level."""
    methods = list(dict.fromkeys(row.method for row in rows))
    reference, *others = methods
    colours = dict(zip(others, _COLOURS * (1 + len(others) // len(_COLOURS))))
    handles = [Line2D([], [], label=f"{reference}, the reference", **LINEAR)]
    handles += [Line2D([], [], color=colours[method], label=method) for method in others]
    levels = some(list(references), _MOST_LEVELS)
    shown = next(iter(references.values())).shown
    heading = f"methods at the same points: {shown} of the first output; difference from the reference"
    page = Page(scene, heading, WIDTH, 4.6, handles)
    axes = page.grid(2, len(levels)).subplots(sharex=True, sharey="row", squeeze=False)
    factor, unit = with_prefix(np.concatenate([row.values for row in references.values()]), shown.unit)
    for level, (curve, error) in zip(levels, axes.T):
        exact = references[level]
        curve.plot(exact.frequency, factor * exact.values, **LINEAR)
        curve.set_title(f"{level:g} {shown.level_unit}".removesuffix(" 1"))
        for row in rows:
            if row.level == level and row.method != reference and row.points:
                curve.plot(row.frequency, factor * row.values, color=colours[row.method], lw=0.8)
                gap = np.maximum(differences(row, exact), _FLOOR)
                error.plot(exact.frequency[: len(gap)], gap, color=colours[row.method], lw=0.8)
        log_scale(error, "y")
        error.set(xlabel="frequency [Hz]")
    axes[0, 0].set_ylabel(f"{shown.name} [{unit}]")
    axes[1, 0].set_ylabel("difference / peak")
    page.save(path)
