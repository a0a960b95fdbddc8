"""Axes drawn with one tick that moves from place to place: matplotlib makes an object of five artists for each."""

from __future__ import annotations

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis, Tick
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter
from matplotlib.transforms import Bbox

_ROUNDING = 1e-10  # of the length of an axis
_POINT = 1.0 / 72.0  # in


def draw_with_one_tick(figure: Figure) -> None:
    """Let the lower and the left axes of a figure be drawn so, in the place of matplotlib's drawing.  Local."""
    for ax in figure.axes:
        for axis, side in ((ax.xaxis, "bottom"), (ax.yaxis, "left")):
            if axis.get_visible() and axis.get_label_position() == side:
                axis.set_visible(False)
                ax.add_artist(OneTick(ax, axis, side))


class OneTick(Artist):
    """Draws grid lines, ticks, numbers and label of an axis, at the bottom or the left of its axes."""

    def __init__(self, ax: Axes, axis: Axis, side: str):
        super().__init__()
        self._axis, self._side = axis, side
        self.set_zorder(axis.get_zorder())
        self._spine = ax.spines[side]

    def draw(self, renderer) -> None:
        """Draw the axis, as matplotlib does where its numbers have a common factor, which stands at its end."""
        axis = self._axis
        formatter, locations, minor_locations = axis.get_major_formatter(), axis.get_majorticklocs(), axis.get_minorticklocs()
        formatter.set_locs(locations)
        if formatter.get_offset():
            axis.set_visible(True)
            axis.draw(renderer)
            axis.set_visible(False)
            return
        boxes = self._drawn(renderer, axis.get_major_ticks(1)[0], formatter, locations)
        if len(minor_locations):
            boxes += self._drawn(renderer, axis.get_minor_ticks(1)[0], axis.get_minor_formatter(), minor_locations)
        if axis.label.get_text():
            outer = Bbox.union([self._spine.get_window_extent(renderer), *boxes])
            x, y = axis.label.get_position()
            pad = axis.labelpad * _POINT * renderer.dpi
            axis.label.set_position((x, outer.y0 - pad) if self._side == "bottom" else (outer.x0 - pad, y))
            axis.label.draw(renderer)

    def _drawn(self, renderer, tick: Tick, formatter: Formatter, locations) -> list[Bbox]:
        """Draw the ticks at these places and return the boxes of their numbers; of one number below the axes."""
        to_length, boxes = self._axis.get_transform(), list[Bbox]()  # of a logarithmic axis, too
        low, high = sorted(to_length.transform(self._axis.get_view_interval()))
        margin = _ROUNDING * (high - low)
        for x, at, number in zip(locations, to_length.transform(locations), formatter.format_ticks(locations)):
            if not low - margin <= at <= high + margin:
                continue
            tick.update_position(x)
            tick.label1.set_text(number)
            tick.draw(renderer)
            if number and tick.label1.get_visible() and not (boxes and self._side == "bottom"):
                boxes.append(tick.label1.get_window_extent(renderer))
        return boxes
