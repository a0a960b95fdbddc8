"""Pictures of solved peaks: marked in the curves, and drawn over the level."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox

from ..fourier.coefficients import amplitude
from ..points.peak import Peak
from ..points.quantities import hertz
from .layout import log_scale
from .measures import peak as highest
from .record import LevelResult, ResultFile
from .style import INK, SERIES_COLOURS, WIDTH, Page, Pages, outputs_by_page, plain, with_prefix

_SAME = np.log(1.25)  # of the frequencies of one resonance at two levels that follow each other
_WIDE = 30.0  # ratio of the levels beyond which their axis is logarithmic
_MARK = 2.0  # pixels, half the size of the part of a mark that no label covers
Resonance = list[tuple[LevelResult, Peak]]  # a peak and its level, by rising level


def resonances(levels: Sequence[LevelResult], output: int) -> list[Resonance]:
    """Return the peaks of an output, each followed from level to level by its frequency.  Local."""
    from scipy.optimize import linear_sum_assignment  # slow import, seldom needed

    lines: list[Resonance] = []
    for level in sorted((level for level in levels if level.peaks and level.level), key=lambda level: abs(level.level)):
        peaks = [peak for peak in level.peaks or () if peak.output == output]
        ends = np.log([line[-1][1].omega for line in lines])
        distance = np.abs(np.log([[peak.omega] for peak in peaks]).reshape(-1, 1) - ends)
        follows = {i: j for i, j in zip(*linear_sum_assignment(distance)) if distance[i, j] < _SAME}
        for i, peak in enumerate(peaks):
            if i in follows:
                lines[follows[i]].append((level, peak))
            else:
                lines.append([(level, peak)])
    return lines


def peak_sizes(level: LevelResult, output: int) -> np.ndarray:
    """Return the amplitudes of the peaks of an output at a level, (n,) in its unit.  Local."""
    return np.array([abs(peak.amplitude) for peak in level.peaks or () if peak.output == output])


def draw_peaks(results: ResultFile) -> Pages:
    """Draw amplitude, frequency and damping ratio of the peaks over the level, where there are peaks at several.  Local."""
    levels = [level for level in results.levels if level.peaks]
    if len({level.level for level in levels}) < 2:
        return {}
    pages: Pages = {}
    for number, outputs in outputs_by_page(results):
        handles = [Line2D([], [], color=INK, lw=0.9, marker="o", ms=4.0, mfc="white", label="a resonance, level by level")]
        heading = "peaks of harmonic 1 over the level: amplitude, frequency, damping ratio of one mode of the half-power width"
        page = Page(results, heading, WIDTH, 0.35 + 2.0 * len(outputs), handles)
        axes = page.grid(len(outputs), 3).subplots(sharex=True, squeeze=False)
        for (k, name), row in zip(outputs, axes):
            _draw_row(row, resonances(levels, k), results.unit_of(k), f"{plain(name, 24)}, " if len(results.outputs) > 1 else "")
        for ax in axes[-1]:
            ax.set_xlabel(f"level [{results.level_unit}]")
        pages[f"peaks{number}.png"] = page
    return pages


def _draw_row(row, lines: list[Resonance], unit: str, name: str) -> None:
    """Draw the resonances of an output into three axes."""
    factor, unit = with_prefix([0.0, *(abs(peak.amplitude) for line in lines for _, peak in line)], unit)
    sizes = [abs(level.level) for line in lines for level, _ in line]
    for i, line in enumerate(lines):
        style = {"color": SERIES_COLOURS[i % len(SERIES_COLOURS)], "lw": 0.9, "marker": "o", "ms": 3.5, "mfc": "white"}
        at = [abs(level.level) for level, _ in line]
        row[0].plot(at, [factor * abs(peak.amplitude) for _, peak in line], **style)
        row[1].errorbar(at, [hertz(peak.omega) for _, peak in line], [hertz(peak.within) / 2.0 for _, peak in line], **style)
        row[2].plot(at, [100.0 * peak.damping for _, peak in line], **style)
    for ax, label in zip(row, (f"{name}amplitude [{unit}]", "frequency [Hz]", "damping ratio [%]")):
        ax.set_ylabel(label)
    if sizes and max(sizes) > _WIDE * min(sizes):
        log_scale(row[0], "x", "y")
    else:
        row[0].set(xlim=(0.0, None), ylim=(0.0, None))
    row[2].set_ylim(0.0, 1.05 * row[2].get_ylim()[1])  # the margin of the data alone would cut the highest mark


def mark_peaks(ax, level: LevelResult, output: int, factor: float, colour) -> None:
    """Mark the peaks of an output in the curve of a level, amplitudes times ``factor``: computed peaks, or the largest point."""
    places = [(hertz(peak.omega), abs(peak.amplitude)) for peak in level.peaks or () if peak.output == output]
    top = highest(level.response, output)
    if level.peaks is None and top is not None:
        places = [(float(level.frequency[top]), float(amplitude(level.response[top, output])))]
    for frequency, size in places:
        ax.plot(frequency, factor * size, "o", ms=4.0, mfc="white", mec=colour, mew=1.1, zorder=4)


def label_peaks(ax, levels: Sequence[LevelResult], output: int, factor: float, unit: str) -> None:
    """Write frequency, amplitude and damping ratio next to the peaks of an output, the largest first, if there is room.

    A label covers neither another one nor a mark.  The size of the axes and their limits must be final.
    """
    bifurcations = [each for level in levels for each in level.bifurcations or ()]
    turns = [(hertz(each.omega), factor * each.amplitude[output]) for each in bifurcations]
    peaks = [peak for level in levels for peak in level.peaks or () if peak.output == output]
    peaks.sort(key=lambda peak: -abs(peak.amplitude))
    places = np.array([(hertz(peak.omega), factor * abs(peak.amplitude)) for peak in peaks]).reshape(-1, 2)
    marks = ax.transData.transform([*places, *turns]) if len(peaks) else ()
    occupied = [Bbox.from_bounds(x - _MARK, y - _MARK, 2.0 * _MARK, 2.0 * _MARK) for x, y in marks]
    for peak, at in zip(peaks, places):
        damping = "" if np.isnan(peak.damping) else f", \u03b6 {100.0 * peak.damping:.3g} %"
        text = f"{at[0]:.6g} Hz, {at[1]:.4g} {unit}{damping}"
        ground = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.6}
        style = {"fontsize": 5.5, "color": INK, "zorder": 3.5, "va": "center", "bbox": ground}
        for side, offset in (("left", 5), ("right", -5)):
            label = ax.annotate(text, at, xytext=(offset, 0), textcoords="offset points", ha=side, **style)
            box = label.get_window_extent()
            if ax.bbox.containsx(box.x0) and ax.bbox.containsx(box.x1) and not box.count_overlaps(occupied):
                occupied.append(box)
                break
            label.remove()
