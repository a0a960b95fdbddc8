"""Results and costs of several methods at the points of some levels; table and plot."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from page_tables import put, table

ARC, REFERENCE, CONDENSED = "receptance, by arc length", "receptance", "condensed full set, dense"
FLOOR = 1e-12  # of a difference in the picture
RUBIN, RUBIN_BOUND = "plain Rubin, dense", "one LU of plain Rubin's size"
COLUMNS = (
    "level_N",
    "method",
    "points_of_curve",
    "points_solved",
    "unknowns_min",
    "unknowns_max",
    "cpu_ms_a_point",
    "evaluations",
    "newton",
    "krylov",
    "difference_from_condensed",
    "difference_from_receptance",
    "condensed_over_this",
    "rubin_over_this",
    "failure",
)
TITLES = (
    "level, N",
    "method",
    "unknowns",
    "points solved",
    "CPU ms a point",
    "evaluations",
    "Newton",
    "GMRES",
    "from the condensed full set",
    "from `receptance`",
    "condensed / this",
    "plain Rubin / this",
)


@dataclass(frozen=True)
class Effort:
    """Cost of a point."""

    cpu: float  # s
    evaluations: int  # of the contact law over pairs
    newton: int
    krylov: int
    unknowns: int


@dataclass
class Row:
    """Results and costs of one method at some points of one level."""

    level: float
    method: str
    index: list[int] = field(default_factory=list)  # of its points among all points of the level
    omega: list[float] = field(default_factory=list)  # rad/s
    response: list[np.ndarray] = field(default_factory=list)  # (n_outputs, N_H) m
    cpu: list[float] = field(default_factory=list)  # s
    evaluations: list[int] = field(default_factory=list)  # of the contact law over pairs
    newton: list[int] = field(default_factory=list)
    krylov: list[int] = field(default_factory=list)
    unknowns: list[int] = field(default_factory=list)
    failure: str | None = None

    def add(self, index: int, omega: float, response: np.ndarray, effort: Effort) -> None:
        """Add a point."""
        for name, value in {"index": index, "omega": omega, "response": response, **vars(effort)}.items():
            getattr(self, name).append(value)

    def mean(self, name: str) -> float:
        return float(np.mean(getattr(self, name)))


def difference(row: Row, other: Row) -> float:
    """Return the largest difference of the response at common points, relative to the peak of ``other``; nan without one."""
    theirs = {i: k for k, i in enumerate(other.index)}
    common = [(k, theirs[i]) for k, i in enumerate(row.index) if i in theirs and row.omega[k] == other.omega[theirs[i]]]
    if not common:
        return float("nan")
    peak = np.max([np.abs(response).max(axis=1) for response in other.response], axis=0)
    return max(float(np.max(np.abs(row.response[k] - other.response[j]) / peak[:, None])) for k, j in common)


class Comparison:
    """The rows of all levels and methods, and the records of the table."""

    def __init__(self, rows: list[Row]):
        self.rows = {(row.level, row.method): row for row in rows}
        self.levels = sorted({row.level for row in rows})
        self.methods = list(dict.fromkeys(row.method for row in rows))
        self.n_points = {level: len(self.rows[level, REFERENCE].index) for level in self.levels}

    def records(self) -> Iterator[dict]:
        """Yield one record per level and method, and one per method over all levels."""
        for level in self.levels:
            for method in self.methods:
                yield self.record(method, [level], f"{level:g}")
        if len(self.levels) > 1:
            for method in self.methods:
                yield self.record(method, self.levels, "all")

    def record(self, method: str, levels: list[float], name: str) -> dict:
        """Return the numbers of a method over some levels; speed-ups are ratios of processor time."""
        rows = [self.rows[level, method] for level in levels]
        cpu, rubin = self.mean(method, levels, "cpu"), RUBIN if RUBIN in self.methods else RUBIN_BOUND
        means = {quantity: self.mean(method, levels, quantity) for quantity in ("evaluations", "newton", "krylov")}
        differences = {
            baseline: max(difference(row, self.rows[row.level, baseline]) for row in rows) for baseline in (CONDENSED, REFERENCE)
        }
        return dict(
            zip(
                COLUMNS,
                (
                    name,
                    method,
                    sum(self.n_points[level] for level in levels),
                    sum(len(row.index) for row in rows),
                    min(min(row.unknowns) for row in rows),
                    max(max(row.unknowns) for row in rows),
                    1e3 * cpu,
                    *means.values(),
                    *(float("nan") if baseline == method else value for baseline, value in differences.items()),
                    self.mean(CONDENSED, levels, "cpu") / cpu,
                    self.mean(rubin, levels, "cpu") / cpu,
                    "; ".join(row.failure for row in rows if row.failure),
                ),
            )
        )

    def mean(self, method: str, levels: list[float], quantity: str) -> float:
        """Return a mean per point, each level weighted with the number of points of its curve."""
        weights = [self.n_points[level] for level in levels]
        return float(np.average([self.rows[level, method].mean(quantity) for level in levels], weights=weights))

    # -- files --------------------------------------------------------------------------------------------------------

    def write(self, head: list[str], folder: Path, page: Path) -> list[str]:
        """Write the numbers into a folder, tables and plot into a page; return the table of all methods and levels."""
        folder.mkdir(parents=True, exist_ok=True)
        records = list(self.records())
        methods = table(TITLES, map(cells, records), words=2)
        put(page, {"summary": summary(records), "machine": [f"- {line}" for line in head], "methods": methods})
        with open(folder / "bench_methods.csv", "w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(records)
        self.draw(page.parent / "img" / "bench_methods.png")
        return methods

    def draw(self, path: Path) -> None:
        """Draw time per point by level and method, and the differences along the strongest level."""
        figure, (bars, curve) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
        width, at = 0.8 / len(self.methods), np.arange(len(self.levels))
        for k, method in enumerate(self.methods):
            heights = [1e3 * self.rows[level, method].mean("cpu") for level in self.levels]
            bars.bar(at + (k - 0.5 * (len(self.methods) - 1)) * width, heights, width, label=method, color=f"C{k}")
        bars.set(yscale="log", ylabel="processor time a point, ms", xlabel="level, N")
        bars.set_xticks(at, [f"{level:g}" for level in self.levels])
        bars.set_ylim(top=30 * bars.get_ylim()[1])
        bars.legend(fontsize=7, ncols=2, loc="upper left")
        reference = self.rows[self.levels[-1], REFERENCE]
        peak = max(np.abs(response).max() for response in reference.response)
        for k, method in enumerate(self.methods):
            row = self.rows[self.levels[-1], method]
            if method not in (ARC, REFERENCE, RUBIN_BOUND):
                error = [np.abs(own - reference.response[i]).max() / peak for i, own in zip(row.index, row.response)]
                style = ".-" if len(error) > 20 else "o"
                curve.plot(np.array(row.omega) / 2 / np.pi, np.maximum(error, FLOOR), style, label=method, color=f"C{k}", ms=4)
        curve.set(yscale="log", xlabel="frequency, Hz", ylabel="difference from receptance / peak", ylim=(FLOOR / 3.0, 1.0))
        curve.set_title(f"{self.levels[-1]:g} N; {FLOOR:g} or less at the foot", fontsize=9, loc="left")
        curve.legend(fontsize=7, ncols=2, loc="upper left")
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150)
        plt.close(figure)


def summary(records: list[dict]) -> list[str]:
    """Return the cost and the difference of each method over all levels."""
    rows = []
    for record in {record["method"]: record for record in records}.values():
        costs = [number(record[key]) for key in ("cpu_ms_a_point", "condensed_over_this", "rubin_over_this")]
        difference = record["difference_from_receptance"]
        rows.append([record["method"], *costs, "–" if difference != difference else f"{difference:.1e}"])
    titles = ("method, all levels", "CPU ms a point", "condensed / this", "plain Rubin / this", "difference from `receptance`")
    return table(titles, rows)


def cells(record: dict) -> list[str]:
    """Return the cells of a record in the table."""
    low, high = record["unknowns_min"], record["unknowns_max"]
    solved, of_curve = record["points_solved"], record["points_of_curve"]
    differences = (record["difference_from_condensed"], record["difference_from_receptance"])
    return [
        record["level_N"],
        record["method"] + (" (failed)" if record["failure"] else ""),
        f"{low:,}" + (f" to {high:,}" if high > low else ""),
        f"{solved}" + (f" of {of_curve}" if solved < of_curve else ""),
        *(number(record[key]) for key in ("cpu_ms_a_point", "evaluations", "newton", "krylov")),
        *("–" if value != value else f"{value:.1e}" for value in differences),
        *(number(record[key]) for key in ("condensed_over_this", "rubin_over_this")),
    ]


def number(value: float) -> str:
    """Return a number with three significant digits, or rounded to an integer from 100; a dash for nan."""
    if value != value:
        return "–"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
