"""Pictures of a sweep: numbers over one key, maps of two, scatter, tornado, Sobol indices, percentile bands.  Rank 0 only."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ...library.peak_curves import FACTOR
from ...library.sample_peaks import NAN
from ...library.sweep import SMOOTH, SweepTable
from ...results.layout import log_scale
from ...results.style import FAINT, INK, WIDTH, Page, Titled, panels, plain, with_prefix
from .statistics import Effect, percentiles

_ACCENT, _SECOND = "#0072b2", "#d55e00"
PREFIXED = ("Pa", "m", "N")  # units of numbers that pictures give a prefix
_WIDE = 8.0  # ratio of the ends of an axis from which it is logarithmic
_LEAST_WIDE, _EVEN = 3.0, 1e-6  # the same of values spaced evenly over their logarithm, and the rounding of their steps
_LETTERS, _LETTERS_OF_HALF = 26, 44  # of a label under a third or a quarter, and under half of a page
_FOR_CONTOURS = 4  # samples along each key, from which lines of equal value show more than the cells
_LABELS = {
    "amplitude": "peak of {output}",
    "frequency": "frequency of the peak",
    "width": "half-power width",
    "damping": "damping ratio",
    "friction_J": "friction loss a cycle",
}
_BANDS = ((5, 95, 0.25), (25, 75, 0.45))  # percentiles and how dark the band between them is


def _scaled(table: SweepTable, name: str) -> tuple[float, str]:
    """Return the factor of a number in pictures and its label with the unit."""
    label = _LABELS[name].format(output=plain(table.output, 20))
    if name == "damping":
        return 100.0, f"{label} [%]"
    if name in ("frequency", "width"):
        return 1.0, f"{label} [Hz]"
    factor, unit = with_prefix(table[name], table.unit_of(name))
    return factor, f"{label} [{unit}]"


def _of_key(table: SweepTable, key: str) -> tuple[float, str]:
    """Return the factor of a number that varies in pictures and its label with the unit."""
    name, unit, values = plain(key, 42), table.unit_of(key), table[key]
    if unit == FACTOR:
        return 1.0, f"{name} [× that of the scene]"
    unit, largest = unit.replace("m3", "m³"), np.abs(values[np.isfinite(values)]).max(initial=0.0)
    exponent = 3 * math.floor(math.log10(largest) / 3.0) if largest > 0.0 and not _is_log(values) else 0
    if unit in PREFIXED and exponent:
        factor, unit = with_prefix(values, unit)
        return factor, f"{name} [{unit}]"
    if not -3 <= exponent <= 3:
        return 10.0**-exponent, f"{name} [10$^{{{exponent}}}$ {unit.removeprefix('1')}]".replace(" ]", "]")
    return 1.0, f"{name} [{unit}]" if unit not in ("", "1") else name


def _in_lines(label: str, most: int) -> str:
    """Return the label of a key in lines of at most ``most`` letters where it has places to break: the last dot, the unit."""
    key, bracket, unit = label.partition(" [")
    first, dot, last = key.rpartition(".")
    lines = [""]
    for part in (first + dot, last, bracket + unit):
        if lines[-1] and len(lines[-1] + part) > most:
            lines.append(part.strip())
        else:
            lines[-1] += part
    return "\n".join(lines)


def _is_log(values: np.ndarray) -> bool:
    """Return whether the axis of values is logarithmic: they span a wide range, or are spaced so."""
    low, high = values.min(), values.max()
    if not 0.0 < _LEAST_WIDE * low <= high:
        return False
    steps = np.diff(np.log(np.unique(values)))
    return bool(high > _WIDE * low or (len(steps) > 1 and np.ptp(steps) < _EVEN * steps.max()))


def draw_grid(table: SweepTable, scene: Titled, path: str) -> None:
    """Draw the numbers of the peak over the one key that varies.  Local."""
    (j,) = (i for i, n in enumerate(table.design.shape) if n > 1)
    key, of_key = table.design.keys[j], _of_key(table, table.design.keys[j])
    x, at = of_key[0] * table.design.values[:, j], of_key[0] * table.nominal.values[j]
    order = np.argsort(x)
    handles = [Line2D([], [], color=_ACCENT, marker="o", ms=3.0, label="samples")]
    inside = bool(x.min() <= at <= x.max())
    handles += [Line2D([], [], color=_SECOND, marker="D", ms=4.5, lw=0, mfc="none", label="the scene itself")] * inside
    has_bars = np.isfinite(table["error"]).any()
    handles += [Patch(color=_ACCENT, alpha=0.2, lw=0, label="error bar of the amplitude")] * bool(has_bars)
    page = Page(scene, f"peak of {plain(table.output, 24)} over {plain(key)}", WIDTH, 4.4, handles)
    for axes, name in zip(page.grid(2, 2).subplots().flat, ("amplitude", "frequency", "damping", "width")):
        factor, label = _scaled(table, name)
        y = factor * table[name][order]
        if name == "amplitude" and has_bars:
            bar = factor * table["error"][order]
            axes.fill_between(x[order], y - bar, y + bar, color=_ACCENT, alpha=0.2, lw=0)
        axes.plot(x[order], y, color=_ACCENT, marker="o", ms=3.0)
        if inside:
            axes.plot(at, factor * getattr(table.nominal, name), "D", color=_SECOND, ms=4.5, mfc="none")
        if _is_log(x):
            log_scale(axes, "x")
        axes.set(xlabel=_in_lines(of_key[1], _LETTERS_OF_HALF), ylabel=label)
    page.save(path)


def draw_map(table: SweepTable, scene: Titled, path: str) -> None:
    """Draw amplitude, frequency and damping of the peak over a grid of two keys.  Local."""
    heading = f"peaks of {plain(table.output, 24)} over two numbers; each cell is a sample"
    page, of_keys = Page(scene, heading, WIDTH, 3.2), [_of_key(table, key) for key in table.design.keys]
    x, y = (factor * values for (factor, _), values in zip(of_keys, table.design.coordinates))
    bars, cells = page.grid(2, 3, height_ratios=(1, 16)).subplots()
    for bar, axes, name in zip(bars, cells, ("amplitude", "frequency", "damping")):
        factor, label = _scaled(table, name)
        values = factor * table.on_axes(name).T
        mesh = axes.pcolormesh(_edges(x), _edges(y), np.ma.masked_invalid(values), cmap="viridis", rasterized=True)
        if min(values.shape) >= _FOR_CONTOURS and np.isfinite(values).all() and np.ptp(values) > 0.0:
            lines = axes.contour(x, y, values, 5, colors="white", linewidths=0.7)
            axes.clabel(lines, fontsize=6.0, fmt="%.4g")
        page.figure.colorbar(mesh, cax=bar, orientation="horizontal", ticks=MaxNLocator(3))
        bar.set_title(label)
        axes.grid(False)
        for values_of_axis, which in ((x, "x"), (y, "y")):
            if _is_log(values_of_axis):
                log_scale(axes, which)
    cells[1].set(xlabel=of_keys[0][1])  # once, for all three: it may be wider than a cell
    cells[0].set(ylabel=_in_lines(of_keys[1][1], _LETTERS))
    page.save(path)


def _edges(values: np.ndarray) -> np.ndarray:
    """Return the ends of the cells about values that rise or fall, (n + 1,)."""
    if len(values) == 1:
        return values[0] + np.array([-0.5, 0.5]) * (abs(values[0]) or 1.0)
    v = np.log(values) if _is_log(values) else values
    middle = 0.5 * (v[:-1] + v[1:])
    edges = np.concatenate([[2.0 * v[0] - middle[0]], middle, [2.0 * v[-1] - middle[-1]]])
    return np.exp(edges) if _is_log(values) else edges


def draw_scatter(table: SweepTable, scene: Titled, path: str) -> None:
    """Draw the peak over each number, over its frequency, and, of random samples, how it is distributed.  Local."""
    names = table.design.keys[:10]
    rows, columns = panels(len(names) + 1 + table.design.is_random)
    handles = [
        Line2D([], [], color=_ACCENT, marker=".", lw=0, label="samples"),
        Line2D([], [], color=_SECOND, marker="D", ms=4.5, lw=0, mfc="none", label="the scene itself"),
    ]
    handles += [Line2D([], [], color=INK, ls="--", lw=0.9, label="percentiles 5, 50, 95")] * table.design.is_random
    page = Page(scene, f"peaks of {plain(table.output, 24)} of {int(table.is_done.sum())} samples", WIDTH, 2.1 * rows, handles)
    cells = np.atleast_1d(page.grid(rows, columns).subplots()).ravel()
    factor, label = _scaled(table, "amplitude")
    y, nominal = factor * table["amplitude"], factor * table.nominal.amplitude
    for axes, key, at in zip(cells, names, table.nominal.values):
        of_key, key_label = _of_key(table, key)
        axes.plot(of_key * table[key], y, ".", color=_ACCENT, ms=3.0)
        axes.plot(of_key * at if np.isfinite(at) else NAN, nominal, "D", color=_SECOND, ms=4.5, mfc="none")
        axes.set(xlabel=_in_lines(key_label, _LETTERS), ylabel=label)
    axes, *others = cells[len(names) :]
    axes.plot(table["frequency"], y, ".", color=_ACCENT, ms=3.0)
    axes.plot(table.nominal.frequency, nominal, "D", color=_SECOND, ms=4.5, mfc="none")
    axes.set(xlabel=_scaled(table, "frequency")[1], ylabel=label)
    if table.design.is_random:
        last, *others = others
        known = np.sort(y[np.isfinite(y)])
        last.step(known, np.arange(1, len(known) + 1) / len(known), where="post", color=_ACCENT)
        for p, value, *_ in percentiles(known):
            last.plot([value, value], [0.0, p / 100.0], color=INK, ls="--", lw=0.9)
        last.set(xlabel=label, ylabel="share of the samples below", ylim=(0.0, 1.02))
    for axes in others:
        axes.set_axis_off()
    page.save(path)


def draw_effects(table: SweepTable, effects: Sequence[Effect], scene: Titled, path: str) -> None:
    """Draw the change of the peak by each number, the largest on top.  Local."""
    alone = table.design.kind == "one by one"
    how = "each number alone at its ends" if alone else (
        f"each number from its percentile 5 to 95, by a plane through the logarithm of the peaks, R² = {effects[0].explained:.3f}"
    )  # fmt: skip
    handles = [Patch(color=_ACCENT, label="lower end of the number"), Patch(color=_SECOND, label="upper end")]
    page = Page(scene, f"effect on the peak of {plain(table.output, 24)}: {how}", WIDTH, 0.5 + 0.34 * len(effects), handles)
    axes = page.grid(1, 1).subplots()
    factor, label = _scaled(table, "amplitude")
    middle = table.nominal.amplitude if alone else float(np.exp(np.nanmean(np.log(table["amplitude"]))))
    for place, effect in enumerate(effects):
        for value, colour in ((effect.low, _ACCENT), (effect.high, _SECOND)):
            axes.barh(-place, factor * (value - middle), left=factor * middle, height=0.6, color=colour)
    axes.axvline(factor * middle, color=INK, lw=0.8)
    names = [f"{plain(effect.key, 42)}\n{effect.ends[0]:.4g} … {effect.ends[1]:.4g}" for effect in effects]
    axes.set_yticks([-place for place in range(len(effects))], names)
    axes.set(xlabel=label)
    axes.grid(False, axis="y")
    page.save(path)


def draw_indices(indices: Sequence[dict], scene: Titled, path: str) -> None:
    """Draw main and total Sobol indices of each number.  Local."""
    handles = [Patch(color=_ACCENT, label="main"), Patch(color=_SECOND, label="total")]
    page = Page(
        scene,
        "Sobol indices: shares of the variance of the peaks, with the ranges of 95 % by resampling",
        WIDTH,
        2.0 + 0.16 * len(indices),
        handles,
    )
    shown = [name for name in SMOOTH if name != "friction_J"]
    cells = page.grid(1, len(shown)).subplots(sharey=True)
    place = -np.arange(len(indices), dtype=float)
    for axes, name in zip(cells, shown):
        ends = [0.0, 1.0]
        for kind, shift, colour in (("main", 0.2, _ACCENT), ("total", -0.2, _SECOND)):
            index, within = ([row[f"{name}_{kind}{end}"] for row in indices] for end in ("", "_within"))
            middle, half = np.nan_to_num(index), np.nan_to_num(within)
            ends += [*(middle - half), *(middle + half)]
            line = {"ecolor": INK, "elinewidth": 0.7}
            axes.barh(place + shift, middle, height=0.36, color=colour, xerr=half, error_kw=line)
        axes.set(xlabel=f"of the {name}", xlim=(min(ends) - 0.04 * np.ptp(ends), max(ends) + 0.04 * np.ptp(ends)))
        axes.grid(False, axis="y")
    cells[0].set_yticks(place, [plain(row["key"], 36) for row in indices])
    page.save(path)


def draw_bands(table: SweepTable, scene: Titled, path: str) -> None:
    """Draw percentiles of the curves.  Local."""
    assert table.curves is not None, "requested"
    with np.errstate(invalid="ignore"):
        has = np.isfinite(table.curves).any(axis=0)
    curves, frequency = table.curves[:, has], table.frequencies[has]
    factor, unit = with_prefix(curves, table.unit)
    handles = [Patch(color=_ACCENT, alpha=dark, lw=0, label=f"percentiles {low} to {high}") for low, high, dark in _BANDS]
    handles += [Line2D([], [], color=_ACCENT, label="median"), Line2D([], [], color=FAINT, lw=0, marker=".", label="peaks")]
    heading = f"curves of {plain(table.output, 24)} of {int(np.isfinite(curves).any(axis=1).sum())} samples"
    page = Page(scene, heading, WIDTH, 3.4, handles)
    axes = page.grid(1, 1).subplots()
    for low, high, dark in _BANDS:
        axes.fill_between(frequency, *(factor * np.nanpercentile(curves, [low, high], axis=0)), color=_ACCENT, alpha=dark, lw=0)
    axes.plot(frequency, factor * np.nanpercentile(curves, 50, axis=0), color=_ACCENT)
    axes.plot(table["frequency"], factor * table["amplitude"], ".", color=FAINT, ms=3.0)
    axes.set(xlabel="frequency [Hz]", ylabel=f"amplitude [{unit}]")
    page.save(path)
