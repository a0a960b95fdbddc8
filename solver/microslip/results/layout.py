"""Positions of the axes of a page: margins from the lengths of their labels, faster than matplotlib's layout engines."""

from __future__ import annotations

import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.layout_engine import LayoutEngine
from matplotlib.ticker import LogFormatterSciNotation

POINT = 1.0 / 72.0  # in
PAD = 0.05  # in, about each of the axes
_TICK = 7.0 * POINT  # a tick and the distance to its number
_LINE = 1.2  # times the size of the letters
_WIDE, _NARROW = 0.64, 0.42  # times the size of the letters: a digit, and a point or an exponent
_LABEL_GAP, _TITLE_GAP = 4.0 * POINT, 6.0 * POINT
_SHORT_AXIS = 100.0  # ratio of the ends of an axis of few powers of ten
_PLAIN = 0.01, 1e4  # numbers that are short without a power of ten
_FORMULA = re.compile(r"\$\\mathdefault\{(?:(.+)\\times)?10\^\{(.+)\}\}\$")
_SUPERSCRIPTS = str.maketrans("0123456789-\u2212", "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207b\u207b")
_SLIM = {*".,\u00b7", *map(chr, _SUPERSCRIPTS.values())}


class PowersOfTen(LogFormatterSciNotation):
    """Powers of ten in letters of the font: to set the first formula takes a tenth of a second.

    An axis of at most two decades has few of them: multiples are labelled, too, and as plain numbers where these are short.
    """

    _is_short = False

    def set_locs(self, locs=None) -> None:
        """Choose the multiples of a power of ten that are labelled."""
        super().set_locs(locs)
        low, high = sorted(self.axis.get_view_interval())
        self._is_short = bool(0.0 < high <= _SHORT_AXIS * low)
        if self._is_short and high > 10.0 * low:
            self._sublabels = {1.0, 3.0}

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return the number at a tick."""
        text = super().__call__(x, pos)
        formula = _FORMULA.fullmatch(text)
        if formula is None:
            return text
        if self._is_short and _PLAIN[0] <= x < _PLAIN[1]:
            return f"{x:g}"
        factor, exponent = formula.groups()
        return (f"{factor}\u00b7" if factor else "") + "10" + exponent.translate(_SUPERSCRIPTS)


def log_scale(ax: Axes, *names: str) -> None:
    """Make axes of these names, "x" or "y", logarithmic.  Local."""
    for name in names:
        ax.set(**{f"{name}scale": "log"})
        axis = ax.xaxis if name == "x" else ax.yaxis
        axis.set_major_formatter(PowersOfTen())
        axis.set_minor_formatter(PowersOfTen())
        axis.set_tick_params(which="minor", pad=5.0)  # points: their numbers are in the line of those of the longer ticks


class PageLayout(LayoutEngine):
    """Arranges the cells of a grid in a figure so that nothing is cut off, with ``top`` inches of free height above them.

    All cells of a row or a column have the margins of its largest labels; the remaining space is divided by the grid's ratios.
    """

    _adjust_compatible, _colorbar_gridspec = False, False

    def __init__(self, top: float):
        super().__init__()
        self._top = top

    def execute(self, fig: Figure) -> None:
        """Place the axes of the grids of a figure: twice, since axes of another size may have longer numbers at their ticks."""
        self._place(fig)
        self._place(fig)

    def _place(self, fig: Figure) -> None:
        cells = ((ax, getattr(ax, "get_subplotspec", lambda: None)()) for ax in fig.axes)  # axes at a place have none
        with_cells = [(ax, cell) for ax, cell in cells if cell is not None]
        if not with_cells:
            return
        columns, rows = with_cells[0][1].get_gridspec().ncols, with_cells[0][1].get_gridspec().nrows
        left, right, above, below = (np.full(n, PAD) for n in (columns, columns, rows, rows))
        for ax, cell in with_cells:
            x_low, x_high, y_top, y_end = cell.colspan.start, cell.colspan.stop - 1, cell.rowspan.start, cell.rowspan.stop - 1
            left[x_low] = max(left[x_low], _width_left(ax))
            right[x_high] = max(right[x_high], PAD + 0.5 * max(map(_length, _numbers(ax.xaxis)), default=0.0))
            above[y_top] = max(above[y_top], _height_above(ax))
            below[y_end] = max(below[y_end], _height_below(ax))
        width, height = fig.get_size_inches()
        grid = with_cells[0][1].get_gridspec()
        x = _edges(width, left, right, grid.get_width_ratios() or np.ones(columns))
        y = _edges(height - self._top, above, below, grid.get_height_ratios() or np.ones(rows))
        for ax, cell in with_cells:
            x0, x1 = x[cell.colspan.start][0], x[cell.colspan.stop - 1][1]
            y0, y1 = y[cell.rowspan.start][0], y[cell.rowspan.stop - 1][1]
            ax.set_position([x0 / width, 1.0 - (self._top + y1) / height, (x1 - x0) / width, (y1 - y0) / height])


def _edges(size: float, before: np.ndarray, behind: np.ndarray, ratios) -> list[tuple[float, float]]:
    """Return where the cells of a row or a column begin and end, in inches."""
    share = np.asarray(ratios, dtype=float) / np.sum(ratios)
    lengths = share * max(size - before.sum() - behind.sum(), 0.2 * size)
    begins = np.cumsum(before) + np.concatenate([[0.0], np.cumsum(lengths + behind)[:-1]])
    return list(zip(begins, begins + lengths))


def _width_left(ax: Axes) -> float:
    """Return the width of the labels left of axes [inches]."""
    return PAD + _label(ax.yaxis) + (_TICK + max(map(_length, _numbers(ax.yaxis)), default=0.0))


def _height_below(ax: Axes) -> float:
    """Return the inches that the labels below axes take."""
    numbers = _numbers(ax.xaxis)
    return PAD + _label(ax.xaxis) + (_TICK + _LINE * _size(ax.xaxis) if numbers else 0.0)


def _height_above(ax: Axes) -> float:
    """Return the inches that a title or a legend above axes takes."""
    titles = [size for where in ("left", "center", "right") if (size := _title(ax, where))]
    legend = _LINE * 9.0 * POINT + _TITLE_GAP if ax.get_legend() is not None else 0.0
    return PAD + max([*titles, legend, 0.5 * _size(ax.yaxis)])


def _title(ax: Axes, where: str) -> float:
    return _TITLE_GAP + _LINE * ax.title.get_fontsize() * POINT if ax.get_title(where) else 0.0


def _label(axis: Axis) -> float:
    text = axis.label.get_text()
    return _LABEL_GAP + _LINE * (1 + text.count("\n")) * axis.label.get_fontsize() * POINT if text else 0.0


def _size(axis: Axis) -> float:
    """Return the size of the numbers at ticks, in inches."""
    return axis.get_major_ticks(1)[0].label1.get_fontsize() * POINT


def _numbers(axis: Axis) -> list[str]:
    """Return the numbers at the ticks of an axis, none where they are not shown."""
    if not axis.get_major_ticks(1)[0].label1.get_visible():
        return []
    low, high = sorted(axis.get_view_interval())
    sets = [(axis.get_major_formatter(), axis.get_majorticklocs())]
    if axis.get_scale() == "log":
        sets.append((axis.get_minor_formatter(), axis.get_minorticklocs()))
    return [
        number
        for formatter, at in sets
        for number, x in zip(formatter.format_ticks(at), at, strict=True)
        if number and low <= x <= high
    ]


def _length(number: str) -> float:
    """Return the length of a number in inches, a formula's without its commands."""
    letters = re.sub(r"\\\w+|[${}^]", "", number)
    return 7.0 * POINT * sum(_NARROW if letter in _SLIM else _WIDE for letter in letters)
