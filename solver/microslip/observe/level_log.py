"""Levels and points in the log: a line per point, a summary per level, and on a terminal a bar per active level."""

from collections.abc import Sequence

import numpy as np

from ..contact.law import OPEN, SLIP
from ..messages.words import counted
from ..points.branch import SEGMENTS, Branch, Point
from ..points.multipliers import is_stable
from ..points.sweep import Sweep
from ..results.measures import AMPLITUDE, Shown, counts
from ..results.record import PeaksOver
from .log import RunLog

EXACT = 1e-10  # of a frequency: the width of a peak's interval below which it is not stated


class LevelLog:
    """An :class:`~microslip.observe.observer.Observer` that writes to the log of a run.

    Parameters
    ----------
    sweep : the range [rad/s]; in statics one point represents it
    shown : the quantity shown of the first output at a point
    outputs : names of the outputs, for their peaks
    """

    def __init__(self, log: RunLog, sweep: Sweep, n_levels: int, shown: Shown = AMPLITUDE, outputs: Sequence[str] = ()):
        self.log, self.n_levels, self.shown, self.outputs = log, n_levels, shown, outputs
        self.start, self.stop = sweep.start / 2.0 / np.pi, sweep.stop / 2.0 / np.pi
        self._levels: dict[int, float] = {}  # levels begun, by number
        self._mixed = False  # whether the line of a point names its level

    def level_started(self, number: int, level: float, where: str) -> None:
        """Announce a level and its range."""
        self._levels[number], self._mixed = level, bool(where)
        size = f"{self.shown.name}_{self.shown.unit}"
        columns = (
            f"{'point':>7} {'frequency_Hz':>12} {size:>12} {'slip':>5} {'open':>5} {'unknowns':>8} "
            f"{'newton':>6} {'gmres':>5} {'seconds':>8}"
        )
        head = f"{self._name(number)}, {self.start:.6g} to {self.stop:.6g} Hz" + (f", on {where}" if where else "")
        self._line(f"{head}\n{self._level_column('level_N')}{columns}")
        self.log.screen.bar(self._name(number), self.start, self.stop)

    def point(self, number: int, i: int, point: Point) -> None:
        """Write a line, or move the bar."""
        frequency, size = point.omega / 2.0 / np.pi, float(self.shown.of(point.response[0]))
        _, n_slip, n_open = counts(point.state)
        self._line(
            f"{self._level_column(f'{self._levels[number]:.6g}')}{i:>7} {frequency:>12.8g} {size:>12.5e} {n_slip:>5} {n_open:>5} "
            f"{point.unknowns:>8} {point.newton:>6} {point.krylov:>5} {point.seconds:>8.4f}"
        )
        self.log.screen.advance(self._name(number), frequency, size, n_slip + n_open, i + 1, self.shown.unit)

    def level_finished(self, number: int, branch: Branch) -> None:
        """Write the summary of a level: its peak, or the reason of its early end."""
        self.log.screen.end_bar(self._name(number))
        more = *peak_lines(branch, self.outputs), *stability_lines(branch), *remarks(branch)
        for line in (f"{self._name(number)}: {summary(branch, self.shown)}", *more):
            self.log.note(line)

    def _line(self, text: str) -> None:
        self.log.note(text, on_screen=not self.log.screen.interactive, in_results=False)

    def _name(self, number: int) -> str:
        return f"level {number + 1} of {self.n_levels}: {self._levels[number]:g} {self.shown.level_unit}".removesuffix(" 1")

    def _level_column(self, level: str) -> str:
        """Return the column with the level of a point, which lines have only if points of several levels alternate."""
        return f"{level:>10} " if self._mixed else ""


def summary(branch: Branch, shown: Shown) -> str:
    """Return the essential numbers of a level's points."""
    points, level = branch.points, branch.level
    if not points:
        return "no point converged"
    top = max(points, key=lambda point: shown.size(point.response[0]))
    largest = shown.of(top.response[0])
    _, n_slip, n_open = counts(top.state)
    per_newton = f" ({largest / level:.4e} {shown.unit}{shown.per_level})" if level else ""
    number = counted(len(points), "point")
    where = f"at {shown.where(top.omega / 2.0 / np.pi) or 'every frequency'}"
    return (
        f"{number} in {sum(point.seconds for point in points):.3g} s; {shown.largest} {largest:.4e} {shown.unit}{per_newton} "
        f"{where}, {n_slip} of {counted(len(top.state), 'pair')} slip, {n_open} open"
    )


def peak_lines(branch: Branch, outputs: Sequence[str]) -> list[str]:
    """Return a line for each solved peak: output, frequency, amplitude, width and damping."""
    lines = []
    for peak in branch.peaks or []:
        width = f", half-power width {peak.width / 2.0 / np.pi:.4g} Hz, damping {peak.damping:.4g}"
        width = "" if np.isnan(peak.width) else width
        frequency, within = peak.omega / 2.0 / np.pi, peak.within / 2.0 / np.pi
        where = f" (within {within:.1e} Hz)" if within > EXACT * frequency else ""
        lines.append(f"  peak of {outputs[peak.output]}: {frequency:.9g} Hz{where}, {abs(peak.amplitude):.8e}{width}")
    return lines


def stability_lines(branch: Branch) -> list[str]:
    """Return a line on the stability of the points, if computed, and one for each bifurcation."""
    if branch.bifurcations is None or not branch.points:
        return []
    judged = [is_stable(point.multipliers) for point in branch.points if point.multipliers is not None]
    unstable = judged.count(False)
    number = f"{unstable} of {counted(len(judged), 'point')}"
    lines = [f"  stability: {number} are unstable" if unstable else "  stability: every point is stable"]
    for bifurcation in branch.bifurcations:
        frequency, within = bifurcation.omega / 2.0 / np.pi, bifurcation.within / 2.0 / np.pi
        where = f" (within {within:.1e} Hz)" if within > EXACT * frequency else ""
        amplitude, after = bifurcation.amplitude[0], bifurcation.after
        lines.append(f"  {bifurcation.kind}: {frequency:.9g} Hz{where}, amplitude {amplitude:.6e}, after point {after}")
    return lines


def over_lines(curve: PeaksOver, output: str) -> list[str]:
    """Return lines on a peak of an output over a parameter: ends, slip, opening, notes, and the reason of an early end."""
    value, points, head = curve.value, curve.points, f"peak of {output} over {curve.key}"
    if len(value) == 0:
        return [f"{head}: no point: {points.failure}"]
    ends = (f"{curve.frequency[i]:.7g} Hz, {curve.amplitude[i]:.4e}, damping {curve.damping[i]:.3g}" for i in (0, -1))
    seconds, unit = f"{points.seconds.sum():.3g} s", "" if curve.unit == "1" else f" {curve.unit}"
    lines = [f"{head}, {value[0]:.4g} to {value[-1]:.4g}{unit}: {counted(len(value), 'point')} in {seconds}; {' -> '.join(ends)}"]
    for name, moves in (("slips", points.state == SLIP), ("is open", points.state == OPEN)):
        moving = value[moves.any(axis=1)]
        lines += [f"  points at which a pair {name}: {moving.min():.4g} to {moving.max():.4g}{unit}"] if len(moving) else []
    lines += [f"  {note}: {value[i]:.6g}{unit}" for i, note in enumerate(points.notes) if note]
    return [*lines, f"  ended early: {points.failure}"] if points.failure else lines


def remarks(branch: Branch) -> list[str]:
    """Return a line for each note of the points of a branch, and for each exceptional property of the branch."""
    lines = []
    for note, points in _noted(branch.points).items():
        low, high = (f(point.omega for point in points) / 2.0 / np.pi for f in (min, max))
        lines.append(f"  {note}: {len(points)} of {counted(len(branch.points), 'point')}, {low:.6g} to {high:.6g} Hz")
    if branch.is_linear:
        lines.append("  no pair leaves sticking anywhere on its linear curve: scaled, not solved")
    if branch.broken:
        numbers = sorted({point.segment for point in branch.points})
        followed = f"followed {' and '.join(SEGMENTS[number] for number in numbers if number)}"
        if 0 in numbers:
            followed = f"in {'two' if len(numbers) == 2 else 'three'} segments: {followed} as well"
        lines.append(f"  {followed}, since {branch.broken}")
    if branch.failure:
        lines.append(f"  stopped early: {branch.failure}")
    return lines


def _noted(points: list[Point]) -> dict[str, list[Point]]:
    """Return the points with a note, by note."""
    by_note: dict[str, list[Point]] = {}
    for point in points:
        for note in point.notes:
            by_note.setdefault(note, []).append(point)
    return by_note
