"""The picture diff.png: both curves of each level, and their difference."""

import matplotlib
import numpy as np
from matplotlib.lines import Line2D

from ...results.layout import log_scale
from ...results.measures import segments
from ...results.style import INK, LINEAR, RC, WIDTH, Page, level_name, plain, some, with_prefix
from .command import Difference
from .compared_levels import LevelDifference, difference_of

_MOST_LEVELS, _MOST_OUTPUTS = 4, 3
_B = {"color": "#d55e00", "lw": 1.1}
_FLOOR = 1e-13  # least difference on a logarithmic axis


def draw(comparison: Difference, path: str) -> str | None:
    """Draw diff.png and return its path; None if no level has points in both results.  Local.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    levels = some([level for level in comparison.levels if level.outputs], _MOST_LEVELS)
    if not levels:
        return None
    with matplotlib.rc_context(RC):
        return _page(comparison, levels).save(path)


def _page(comparison: Difference, levels: list[LevelDifference]) -> Page:
    """Return a page with one column per level, and per output one row of both curves and one of their difference."""
    outputs = levels[0].outputs[:_MOST_OUTPUTS]
    names = [plain(results.path, 50) for results in (comparison.a, comparison.b)]
    handles = [Line2D([], [], label=f"{side}: {name}", **style) for side, name, style in zip("AB", names, (LINEAR, _B))]
    handles.append(Line2D([], [], color=INK, lw=0.8, marker=".", ms=2.0, label="difference"))
    heading = f"two results: {comparison.shown}; and the difference of mean and all harmonics, over the peak of A"
    page = Page(comparison.a, heading, WIDTH, 0.4 + 3.6 * len(outputs), handles)
    axes = page.grid(2 * len(outputs), len(levels)).subplots(sharex="col", sharey="row", squeeze=False)
    for k, results in enumerate(outputs):
        factor, unit = with_prefix([size for level in levels for size in level.outputs[k].peak], results.unit)
        for level, curve, error in zip(levels, axes[2 * k], axes[2 * k + 1]):
            _draw_output(comparison, level, k, factor, curve, error)
        axes[2 * k, 0].set_ylabel(f"{plain(results.name, 20)} [{unit}]")
        axes[2 * k + 1, 0].set_ylabel("difference / peak")
    for level, top, bottom in zip(levels, axes[0], axes[-1]):
        top.set_title(level_name(comparison.of_level(level)[0], short=True))
        bottom.set_xlabel("frequency [Hz]")
    return page


def _draw_output(comparison: Difference, level: LevelDifference, k: int, factor: float, curve, error) -> None:
    """Draw an output of a level into two axes."""
    a, b = comparison.of_level(level)
    i, j = (results.outputs.index(level.outputs[k].name) for results in (comparison.a, comparison.b))
    for of_side, number, style in ((a, i, LINEAR), (b, j, _B)):
        values = factor * comparison.shown.size(of_side.response[:, number])
        for part in segments(of_side.segment):
            curve.plot(of_side.frequency[part], values[part], **style)
    for side in difference_of(a, b, i, j, comparison.shown):
        for part in segments(side.segment):
            error.plot(side.frequency[part], np.maximum(side.difference[part], _FLOOR), color=INK, lw=0.8, marker=".", ms=2.0)
    log_scale(error, "y")
