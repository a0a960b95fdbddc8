"""Peaks over numbers of the scene: amplitude, amplitude per unit of the level, frequency and damping ratio."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..contact.law import OPEN, STICK
from .layout import log_scale
from .record import PeaksOver, ResultFile
from .style import FAINT, INK, LINEAR, SERIES_COLOURS, WIDTH, Page, Pages, plain, with_prefix

_WIDE = 10.0  # ratio of the numbers, or of the amplitudes, beyond which their axis is logarithmic
OF_LINEAR = ("tangential_stiffness", "normal_stiffness")  # numbers of a joint that change the linear response
_MARKS = (("a pair slips or is open", "o"), ("half of the pairs do", "s"), ("all pairs do", "D"), ("a pair is open", "^"))


def draw_peaks_over(results: ResultFile) -> Pages:
    """Draw the peaks over each number, a page for each number and output.  Local."""
    curves = [curve for curve in results.over if len(curve.value) > 1]
    groups = [list(group) for _, group in groupby(curves, key=lambda curve: (curve.key, curve.linear.output))]
    names = [f"peaks_over{i}.png" if len(groups) > 1 else "peaks_over.png" for i in range(1, len(groups) + 1)]
    return {name: _page(results, group) for name, group in zip(names, groups)}


def _page(results: ResultFile, curves: Sequence[PeaksOver]) -> Page:
    first, k = curves[0], curves[0].linear.output
    name = plain(results.outputs[k], 40)
    label = f"level [{first.unit}]" if first.key == "level" else f"{plain(first.key, 50)} [{first.unit.replace('1', '-')}]"
    of_level = "" if first.key == "level" else f" at {first.points.level:g} {results.level_unit}"
    marked = [mark for mark in _MARKS if any(_begins(curve)[mark[0]] is not None for curve in curves)]
    handles = (
        [Line2D([], [], color=SERIES_COLOURS[i % 6], label=f"peak {i + 1}") for i in range(len(curves))]
        if len(curves) > 1
        else []
    )
    handles += [
        Line2D([], [], ls="", marker=m, ms=4.5, mfc="white", mec=INK, label=f"first point where {text}") for text, m in marked
    ]
    handles += [Line2D([], [], **LINEAR, label="all pairs stick")] if has_linear(curves[0].key) else []
    heading = f"peak of {name} over {'the level' if first.key == 'level' else plain(first.key, 50)}{of_level}"
    if any(curve.error is not None for curve in curves):
        handles.append(Patch(facecolor=FAINT, alpha=0.35, lw=0.0, label="error bar"))
    page = Page(results, f"{heading}; damping ratio of one mode with this amplitude per unit of the level", WIDTH, 4.4, handles)
    axes = page.grid(2, 2).subplots(sharex=True)
    unit = results.unit_of(k)
    factor, prefixed = with_prefix(np.concatenate([curve.amplitude for curve in curves]), unit)
    per_factor, per_prefixed = with_prefix(np.concatenate([curve.per_level for curve in curves]), unit)
    panels = (
        (axes[0, 0], f"amplitude [{prefixed}]", lambda curve: factor * curve.amplitude),
        (axes[0, 1], f"amplitude per level [{per_prefixed}/{results.level_unit}]", lambda curve: per_factor * curve.per_level),
        (axes[1, 0], "frequency [Hz]", lambda curve: curve.frequency),
        (axes[1, 1], "damping ratio [%]", lambda curve: 100.0 * curve.damping),
    )
    for ax, text, values in panels:
        for i, curve in enumerate(curves):
            ax.plot(curve.value, values(curve), color=SERIES_COLOURS[i % 6] if len(curves) > 1 else INK, zorder=3)
            for mark, begin in _begins(curve).items():
                if begin is not None:
                    ax.plot(
                        curve.value[begin],
                        values(curve)[begin],
                        ls="",
                        marker=dict(_MARKS)[mark],
                        ms=4.5,
                        mfc="white",
                        mec=INK,
                        zorder=4,
                    )
        ax.set_ylabel(text)
    for curve in curves if has_linear(curves[0].key) else ():
        _draw_linear(axes, curve, factor, per_factor)
    wide = [max(abs(curve.value)) > _WIDE * min(abs(curve.value)) for curve in curves]
    sizes = np.concatenate([curve.amplitude for curve in curves])
    if all(wide):
        log_scale(axes[0, 0], "x", *(["y"] if sizes.max() > _WIDE * sizes.min() else []))
    for ax in axes[1]:
        ax.set_xlabel(label)
    axes[1, 1].set_ylim(0.0, None)
    _draw_bars(axes[0, 0], curves, factor)
    return page


def has_linear(key: str) -> bool:
    """Return whether the linear response is the same over a number, as it is not over damping and contact stiffness.  Local."""
    return key.rsplit(".", 1)[-1] not in OF_LINEAR and not key.startswith("damping")


def _draw_linear(axes, curve: PeaksOver, factor: float, per_factor: float) -> None:
    """Draw the peak of the linear response into all panels, that of the amplitude over the range of the curve."""
    linear, levels = curve.linear, np.full_like(curve.value, curve.points.level) if curve.points.level else curve.value
    line = factor * abs(linear.amplitude) * levels
    values = (
        (axes[0, 0], np.where(line <= 1.1 * factor * curve.amplitude.max(), line, np.nan)),
        (axes[0, 1], np.full_like(levels, per_factor * abs(linear.amplitude))),
        (axes[1, 0], np.full_like(levels, linear.omega / (2.0 * np.pi))),
        (axes[1, 1], np.full_like(levels, 100.0 * linear.damping)),
    )
    for ax, stuck in values:
        ax.plot(curve.value, stuck, **LINEAR, zorder=1)


def _draw_bars(ax, curves: Sequence[PeaksOver], factor: float) -> None:
    """Draw the error bars of the amplitudes as a band."""
    for curve in curves:
        if curve.error is not None:
            low, high = (factor * (curve.amplitude + side * curve.error) for side in (-1.0, 1.0))
            ax.fill_between(curve.value, low, high, color=FAINT, alpha=0.35, lw=0.0, zorder=2)


def _begins(curve: PeaksOver) -> dict[str, int | None]:
    """Return, by the names of the marks, the first point with that number of slipping or open pairs; None without one."""
    moving, is_open = (curve.points.state != STICK).sum(axis=1), (curve.points.state == OPEN).any(axis=1)
    n_pairs = curve.points.state.shape[1]
    reached = (moving > 0, 2 * moving >= n_pairs, moving >= n_pairs, is_open)
    return {name: int(np.argmax(hits)) if hits.any() and not hits[0] else None for (name, _), hits in zip(_MARKS, reached)}
