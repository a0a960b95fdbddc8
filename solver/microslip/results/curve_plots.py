"""Pictures along the curves: response, states of the pairs, unknowns, energy."""

from __future__ import annotations

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator

from ..fourier.coefficients import amplitude
from ..messages.words import counted
from ..points.branch import CLOSES_TO
from ..points.error_parts import PARTS, total
from .audit import balance
from .layout import log_scale
from .measures import counts, peak, segments
from .peak_plots import label_peaks, mark_peaks, peak_sizes
from .record import STOPPED, LevelResult, ResultFile
from .stability_plots import DASHES, mark_bifurcations, runs, stability_handles
from .style import (
    FAINT,
    INK,
    LINEAR,
    MOST_NAMED,
    MOST_PANELS,
    STATE_COLOURS,
    STATE_NAMES,
    STATE_STYLES,
    WIDTH,
    Page,
    Pages,
    level_colours,
    level_name,
    outputs_by_page,
    panels,
    plain,
    some,
    with_prefix,
)

_WIDE = 200.0  # ratio of largest to smallest amplitude of a curve beyond which the axis is logarithmic
_RATIO = 30.0  # ratio of the peaks of two levels beyond which it is
_BAND = 0.3  # opacity of an error band
_LONGEST_BAR = 1.5  # of the largest amplitude: a linear axis shows error bars up to there
_PART_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8c8c8c", "#56b4e9")
_LEAST_ERROR = 1e-12  # of the peak: less is rounding, and not drawn
_ERROR_DECADES = 1e-5  # of the largest bar: less is not drawn
_SEEN = 3.0  # times the lower end of the axis that a part must reach
_DECADES = 1e-7  # a logarithmic axis shows no less than this of the largest


def draw_response(results: ResultFile) -> Pages:
    """Draw amplitude, and amplitude per newton with the linear curve, of every output.  Local."""
    drawn = _with_colours(results)
    pages: Pages = {}
    solved = any(level.peaks for level in results.levels)
    for number, outputs in outputs_by_page(results):
        n_rows = len(outputs)
        handles = _level_handles(drawn, results.linear is not None, peaks=True)
        handles += stability_handles(results)
        if any(level.error is not None for level in results.levels):
            handles.append(Patch(facecolor=FAINT, alpha=_BAND, lw=0.0, label="error bar"))
        unit_of_load = "newton of load" if results.level_unit == "N" else "unit of the level"
        heading = f"response, harmonic 1: amplitude, and amplitude per {unit_of_load}"
        heading += "; at peaks the damping ratio \u03b6" if solved else ""
        page = Page(results, heading, WIDTH, 0.35 + 2.35 * n_rows, handles)
        axes = page.grid(n_rows, 2).subplots(sharex=True, squeeze=False)
        units = [
            _response_row(results, drawn, k, row, name if len(results.outputs) > 1 else "")
            for (k, name), row in zip(outputs, axes)
        ]
        for ax in axes[-1]:
            ax.set_xlabel("frequency [Hz]")
        _limit(axes.ravel(), results)
        if solved:
            page.figure.get_layout_engine().execute(page.figure)  # labels need the size of the axes
        for (k, _), row, (factor, unit) in zip(outputs, axes, units):
            label_peaks(row[0], results.levels, k, factor, unit)
        pages[f"response{number}.png"] = page
    return pages


def _response_row(results: ResultFile, drawn, k: int, row, name: str) -> tuple[float, str]:
    """Draw output k into two axes, the second per unit of the level; return factor and unit of the first."""
    curves, output_unit = [amplitude(level.response[:, k]) for level, _ in drawn], results.unit_of(k)
    per_level = [1.0 / abs(level.level) if level.level else np.nan for level, _ in drawn]
    for ax, unit, shares in (
        (row[0], output_unit, np.ones(len(drawn))),
        (row[1], output_unit + results.shown.per_level, per_level),
    ):
        values = [share * a for share, a in zip(shares, curves)]
        linear = [amplitude(results.linear.response[:, k])] if results.linear and ax is row[1] else []
        factor, unit_name = with_prefix(_joined([*values, *linear]), unit)
        for a in linear:
            ax.plot(results.linear.frequency, factor * a, zorder=1.5, **LINEAR)  # type: ignore[union-attr]
        ends = [0.0]
        for a, share, (level, colour) in zip(values, shares, drawn):
            ends.append(_band(ax, level, k, factor * a, factor * share, colour))
            _curve(ax, level, factor * a, colour, shows_stability=True)
            mark_bifurcations(ax, level, k, factor * share, colour)
            mark_peaks(ax, level, k, factor * share, colour)
        ax.set_ylabel(f"{plain(name, 24) + ', ' if name else ''}amplitude [{unit_name}]")
        seen = [np.append(a, share * peak_sizes(level, k)) for a, share, (level, _) in zip(values, shares, drawn)]
        _choose_scale(ax, [factor * a for a in (*seen, *linear)], max(ends), compare=ax is row[0])
    return with_prefix(_joined(curves), output_unit)


def draw_states(results: ResultFile) -> Pages:
    """Draw how many pairs stick, slip and are open along the curve of each level.  Local."""
    levels = some(results.solved, MOST_PANELS)
    if not levels or results.joint.n_pairs == 0:
        return {}
    handles = [Line2D([], [], color=c, ls=s, lw=1.5, label=n) for c, s, n in zip(STATE_COLOURS, STATE_STYLES, STATE_NAMES)]
    handles.append(Line2D([], [], color=FAINT, ls=":", lw=1.0, label="peak of the response"))
    heading = f"states of the {counted(results.joint.n_pairs, 'contact pair')} along the curve{results.of_sector}"
    page, axes = _panels(results, heading, levels, handles)
    for ax, level in zip(axes, levels):
        for number, colour, style in zip(counts(level.state).T, STATE_COLOURS, STATE_STYLES):
            _curve(ax, level, number, colour, style)
        ax.axvline(level.frequency[peak(level.response)], color=FAINT, ls=":", lw=1.0, zorder=0.5)
        ax.set_ylim(-0.03 * results.joint.n_pairs, 1.05 * results.joint.n_pairs)
        ax.locator_params(axis="y", integer=True)
        ax.set_ylabel("pairs")
    return {"states.png": page}


def draw_rom_size(results: ResultFile) -> Pages:
    """Draw the unknowns of the reduced model along the curve of every level.  Local."""
    drawn = _with_colours(results)
    heading = f"unknowns of the model along the curve, method {plain(results.method)}"
    page = Page(results, heading, 4.6, 2.6, _level_handles(drawn, False))
    ax = page.figure.add_subplot(page.grid(1, 1)[0, 0])
    for (level, colour), width in zip(drawn, np.linspace(3.0, 1.2, len(drawn))):  # equal curves show under each other
        _curve(ax, level, level.unknowns, colour, lw=width if len(drawn) > 1 else 1.2)
    largest = max((level.unknowns.max(initial=1) for level, _ in drawn), default=1)
    ax.set_ylim(0.0, 1.08 * max(largest, 1))
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("unknowns")
    _limit([ax], results)
    return {"rom_size.png": page}


def draw_energy(results: ResultFile) -> Pages:
    """Draw input, damping and friction per cycle for each level, and how well they balance.  Local."""
    levels = some(results.solved, MOST_PANELS)
    if not levels:
        return {}
    parts = (
        ("input", "input", INK, "-"),
        ("damping", "viscous damping", "#0072b2", "--"),
        ("friction", "friction", "#d55e00", "-."),
    )
    handles = [Line2D([], [], color=c, ls=s, lw=1.2, label=label) for _, label, c, s in parts]
    heading = "energy per cycle along the curve, and the closure |input \u2212 damping \u2212 friction| / input"
    heading += results.of_sector
    page, axes = _panels(results, heading, levels, handles, foot=1.5)
    for ax, level in zip(axes, levels):
        factor, unit = with_prefix(np.concatenate([getattr(level, name) for name, *_ in parts]), "J")
        for name, _, colour, style in parts:
            _curve(ax, level, factor * getattr(level, name), colour, style)
        ax.set_ylabel(f"energy [{unit}]")
        largest = factor * max(getattr(level, name).max() for name, *_ in parts)
        ax.set_ylim(-0.03 * (largest or 1.0), 1.06 * (largest or 1.0))
    _draw_closure(axes[-1], results)
    return {"energy.png": page}


def _draw_closure(ax, results: ResultFile) -> None:
    """Draw the closure of all levels."""
    _decades(ax)
    drawn = [(level, colour) for level, colour in _with_colours(results) if len(level.frequency)]
    bound = max((level.closes_to for level, _ in drawn), default=CLOSES_TO)
    lowest = bound
    for level, colour in drawn:
        gap = np.maximum(balance(results, level), 1e-16)
        _curve(ax, level, gap, colour)
        lowest = min(lowest, gap.min(initial=lowest))
    ax.axhline(bound, color=FAINT, lw=0.8, ls="--")
    ax.set_ylim(0.3 * lowest, max(ax.get_ylim()[1], 10.0 * bound))
    ax.set_title("closure, all levels", loc="left")
    if len(drawn) > 1:
        named = [Line2D([], [], color=colour, lw=1.5, label=level.text) for level, colour in some(drawn, 7)]
        ax.legend(
            handles=named, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncol=len(named), borderaxespad=0.2, columnspacing=1.2
        )
    ax.set_ylabel("closure [-]")
    ax.set_xlabel("frequency [Hz]")
    _limit([ax], results)


def draw_error(results: ResultFile) -> Pages:
    """Draw the error bar of the first output along the curve of each level, and its parts.  Local.

    A panel shows five decades; the legend names the parts that are seen in one.
    """
    levels = some([level for level in results.levels if level.error is not None and len(level.frequency)], MOST_PANELS)
    if not levels:
        return {}
    shares = [error_shares(level) for level in levels]
    lowest = [max(_ERROR_DECADES * bars.max(), _LEAST_ERROR) for bars, _ in shares]
    is_visible = [any(parts[:, i].max() > _SEEN * low for (_, parts), low in zip(shares, lowest)) for i in range(len(PARTS))]
    styles = list(zip(PARTS, _PART_COLOURS))
    any_bar = any(bars.max() > _LEAST_ERROR for bars, _ in shares)
    handles = [Line2D([], [], color=INK, lw=1.6, label="error bar")] if any_bar else []
    if any_bar and any(level.error_corrected is not None for level in levels):
        handles.append(Line2D([], [], color=INK, lw=1.1, ls=":", label="of the corrected amplitude"))
    handles += [
        Line2D([], [], color=colour, lw=1.1, label=part) for (part, colour), is_seen in zip(styles, is_visible) if is_seen
    ]
    heading = f"error bar of {plain(results.outputs[0], 24)}, and what it comes from, over the peak of the level"
    page, axes = _panels(results, heading, levels, handles)
    for ax, level, (bars, parts), low in zip(axes, levels, shares, lowest):
        ax.set_ylabel("error / peak [-]")
        if bars.max() <= _LEAST_ERROR:
            ax.text(0.5, 0.5, f"below {_LEAST_ERROR:.0e} everywhere", transform=ax.transAxes, ha="center", color=FAINT)
            ax.set_yticks([])
            continue
        _decades(ax)  # zeros lie below the axis
        _curve(ax, level, bars, INK, lw=1.6)
        for values, (_, colour) in zip(parts.T, styles):  # on top, so that a part of a single point shows in its spike
            if values.max() > _SEEN * low:
                _curve(ax, level, values, colour, lw=1.1)
        if level.error_corrected is not None:
            _curve(ax, level, level.error_corrected[:, 0] / (amplitude(level.response[:, 0]).max() or 1.0), INK, ":", lw=1.1)
        ax.set_ylim(low, 3.0 * bars.max())
    return {"error.png": page}


def error_shares(level: LevelResult) -> tuple[np.ndarray, np.ndarray]:
    """Return the bars (n,) of the first output and their parts (n, parts), over the peak of the level.  Local."""
    largest = amplitude(level.response[:, 0]).max() or 1.0
    return total(level.error[:, 0]) / largest, level.error[:, 0] / largest


# -- shared ----------------------------------------------------------------------------------------------------


def _decades(ax) -> None:
    """Make the ordinate logarithmic, with ticks at decades alone: those between take half of the time of a panel."""
    log_scale(ax, "y")
    ax.yaxis.set_minor_locator(NullLocator())


def _with_colours(results: ResultFile) -> list[tuple[LevelResult, np.ndarray]]:
    return list(zip(results.levels, level_colours(len(results.levels))))


def _level_handles(drawn, linear: bool, peaks: bool = False) -> list[Line2D]:
    handles = [Line2D([], [], color=colour, lw=1.5, label=level_name(level)) for level, colour in some(drawn, MOST_NAMED)]
    if linear:
        handles.append(Line2D([], [], label="all stuck, linear", **LINEAR))
    if peaks:
        handles.append(Line2D([], [], color="none", marker="o", ms=4.0, mfc="white", mec=INK, label="peak"))
    return handles


def _panels(results: ResultFile, heading: str, levels: list[LevelResult], handles, foot: float = 0.0):
    """Return a page and its axes, one a level; with ``foot`` [in] one more across the page below them."""
    n_rows, n_columns = panels(len(levels))
    if len(levels) < len(results.levels):
        heading += f"; {len(levels)} of {counted(len(results.levels), 'level')}"
    row = 1.75 if n_columns < 3 else 1.5
    heights = [row] * n_rows + ([foot] if foot else [])
    page = Page(results, heading, WIDTH if n_columns > 1 else 4.6, 0.3 + sum(heights), handles)
    cells = page.grid(len(heights), n_columns, height_ratios=heights)
    axes = [page.figure.add_subplot(cells[divmod(i, n_columns)]) for i in range(len(levels))]
    for i, (ax, level) in enumerate(zip(axes, levels)):
        ax.set_title(level_name(level, short=True), loc="left")
        if i + n_columns >= len(levels):
            ax.set_xlabel("frequency [Hz]")
    _limit(axes, results)
    return page, axes + ([page.figure.add_subplot(cells[n_rows, :])] if foot else [])


def _band(ax, level: LevelResult, k: int, values, factor: float, colour) -> float:
    """Draw the error bars of output k about its curve, where they were estimated; return their upper end."""
    if level.error is None or len(level.frequency) < 2:
        return 0.0
    bars = factor * total(level.error[:, k])
    for segment in segments(level.segment):
        low, high = np.maximum(values[segment] - bars[segment], 0.0), values[segment] + bars[segment]
        ax.fill_between(level.frequency[segment], low, high, color=colour, alpha=_BAND, lw=0.0)
    return float(np.nan_to_num(values + bars, posinf=0.0).max())


def _curve(ax, level: LevelResult, values, colour, style="-", lw=1.2, shows_stability=False) -> None:
    """Draw values in the order of the branch, segment by segment: folds show; a single point and early ends are marked.

    Unstable parts are dashed where that is to be shown.
    """
    for segment in segments(level.segment):
        n = segment.stop - segment.start
        for part, is_stable in runs(level.stable, segment) if shows_stability else ((segment, True),):
            dashes = style if is_stable else DASHES
            marker = "." if n < 3 else None
            ax.plot(level.frequency[part], values[part], ls=dashes, lw=lw, color=colour, marker=marker, ms=5.0)
        if level.status == STOPPED:
            ax.plot(level.frequency[segment][-1], values[segment][-1], "x", color=colour, ms=5.0, mew=1.2, zorder=5)


def _joined(values) -> np.ndarray:
    return np.concatenate([np.zeros(0), *values])


def _choose_scale(ax, curves, end_of_bars: float, *, compare: bool) -> None:
    """Choose a logarithmic axis where a curve spans decades, or (``compare``) the peaks of the curves do."""
    curves = [a[np.isfinite(a) & (a > 0.0)] for a in curves]
    curves = [a for a in curves if len(a)]
    if not curves:
        return
    peaks, largest = [a.max() for a in curves], max(a.max() for a in curves)
    real = [a[a > _DECADES * largest] for a in curves if a.max() > _DECADES * largest]
    span = max(a.max() / a.min() for a in real)
    real_peaks = [top for top in peaks if top > _DECADES * largest]
    if span > _WIDE or (compare and max(real_peaks) / min(real_peaks) > _RATIO):
        log_scale(ax, "y")
        ax.set_ylim(0.7 * min(a.min() for a in real), 1.5 * largest)
    else:
        ax.set_ylim(0.0, max(1.06 * largest, 1.02 * min(end_of_bars, _LONGEST_BAR * largest)))


def _limit(axes, results: ResultFile) -> None:
    """Give all axes the range of frequencies of all levels; a single frequency gets a margin."""
    frequency = _joined([level.frequency for level in results.levels])
    if len(frequency) == 0:
        return
    low, high = frequency.min(), frequency.max()
    margin = 0.01 * (high - low) if high > low else 0.01 * abs(high) or 1.0
    for ax in axes:
        ax.set_xlim(low - margin, high + margin)
        ax.locator_params(axis="x", nbins=4 if ax.get_subplotspec().get_position(ax.figure).width < 0.3 else 7)
