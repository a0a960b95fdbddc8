"""Stability in pictures: unstable parts of curves, bifurcations, and multipliers in the complex plane."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.lines import Line2D

from ..points.bifurcation import KINDS
from ..points.quantities import hertz
from .record import LevelResult, ResultFile
from .style import FAINT, INK, MOST_PANELS, WIDTH, Page, Pages, level_colours, level_name, panels, some

DASHES = (0.0, (3.0, 1.5))  # of unstable parts
FARTHEST = 2.0  # from 0, at which larger multipliers are drawn
_MARKS = dict(zip(KINDS, "Ds^v"))


def runs(stable: np.ndarray | None, segment: slice) -> Iterator[tuple[slice, bool]]:
    """Yield the stable and unstable parts of a segment, each with whether it is stable.  Local.

    ``stable`` (n,) of all points of the curve; between a stable and an unstable point the curve counts as unstable.  None: the
    whole segment is one stable part.
    """
    n = segment.stop - segment.start
    stable = np.ones(n, dtype=bool) if stable is None else stable[segment].astype(bool)
    between = stable[:-1] & stable[1:] if n > 1 else stable
    starts = [0, *(np.flatnonzero(np.diff(between)) + 1).tolist(), len(between)]
    for a, b in zip(starts, starts[1:]):
        yield slice(segment.start + a, segment.start + min(b + 1, n)), bool(between[a])


def mark_bifurcations(ax, level: LevelResult, output: int, factor: float, colour) -> None:
    """Mark the bifurcations of a level in the curve of an output, amplitudes times ``factor``."""
    for bifurcation in level.bifurcations or ():
        size = factor * float(bifurcation.amplitude[output])
        ax.plot(hertz(bifurcation.omega), size, _MARKS[bifurcation.kind], ms=3.5, mfc=colour, mec=INK, mew=0.6, zorder=4.5)


def stability_handles(results: ResultFile) -> list[Line2D]:
    """Return the legend entries on the stability of curves, for the kinds that occur."""
    levels, handles = results.solved, []
    if any(level.stable is not None and not level.stable.all() for level in levels):
        handles.append(Line2D([], [], color=INK, lw=1.2, ls=DASHES, label="unstable"))
    for kind in KINDS:
        if any(bifurcation.kind == kind for level in levels for bifurcation in level.bifurcations or ()):
            handles.append(Line2D([], [], color="none", marker=_MARKS[kind], ms=3.5, mfc=FAINT, mec=INK, mew=0.6, label=kind))
    return handles


def draw_multipliers(results: ResultFile) -> Pages:
    """Draw the largest multipliers of the points of each level in the complex plane, where they were computed.  Local."""
    colours = dict(zip([level.level for level in results.levels], level_colours(len(results.levels))))
    levels = some([level for level in results.solved if level.multipliers is not None], MOST_PANELS)
    if not levels:
        return {}
    handles = [
        Line2D([], [], color="none", marker="o", ms=3.0, mfc=FAINT, mec="none", label="of a stable point"),
        Line2D([], [], color="none", marker="o", ms=4.0, mfc="none", mec=INK, label="of an unstable point"),
    ]
    largest = max(np.hypot(*np.moveaxis(level.multipliers, -1, 0)).max(initial=0.0) for level in levels)
    if largest > FARTHEST:
        label = f"of size above {FARTHEST:g}, up to {largest:.3g}"
        handles.append(Line2D([], [], color="none", marker="D", ms=4.0, mfc="none", mec=INK, label=label))
    n_rows, n_columns = panels(len(levels))
    page = Page(results, "largest Floquet multipliers, and the unit circle", WIDTH, 0.3 + 2.6 * n_rows, handles)
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    for level, cell in zip(levels, page.grid(n_rows, n_columns)):
        ax = page.figure.add_subplot(cell)
        ax.plot(np.cos(angle), np.sin(angle), color=FAINT, lw=0.8, zorder=1.0)
        stable, (real, imaginary) = level.stable.astype(bool), np.moveaxis(level.multipliers, -1, 0)
        ax.plot(real[stable], imaginary[stable], "o", ms=2.0, mfc=colours[level.level], mec="none", zorder=2.0)
        size = np.hypot(real, imaginary)
        shrink, is_beyond = FARTHEST / np.maximum(size, FARTHEST), size > FARTHEST
        for mark, some_of in (("o", ~stable[:, None] & ~is_beyond), ("D", is_beyond)):
            ax.plot(
                (shrink * real)[some_of],
                (shrink * imaginary)[some_of],
                mark,
                ms=3.5,
                mfc="none",
                mec=colours[level.level],
                zorder=3.0,
            )
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_title(level_name(level, short=True), loc="left")
        ax.set(xlabel="real part [-]", ylabel="imaginary part [-]")
    return {"multipliers.png": page}
