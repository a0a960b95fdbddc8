"""The curves of a report as figures of plotly: plain dictionaries for JSON."""

from collections.abc import Callable
from typing import Any

import matplotlib.colors
import numpy as np

from ...fourier.coefficients import amplitude, phase
from ...messages.words import counted
from ...points.error_parts import PARTS, total
from ...points.peak import Peak
from ...points.quantities import hertz
from ..audit import balance
from ..measures import counts, segments
from ..peak_plots import resonances
from ..record import LevelResult, PeaksOver, ResultFile
from ..style import FAINT, INK, STATE_COLOURS, STATE_NAMES, level_colours, level_name, with_prefix

MOST_OUTPUTS = 12
_WIDE = 200.0  # ratio of largest to smallest amplitude of a curve beyond which the axis is logarithmic
_WIDE_NUMBER = 10.0  # the same of a number over which peaks are followed
_RATIO = 30.0  # ratio of the peaks of two levels beyond which it is
Figure = dict[str, Any]


def figures_of(results: ResultFile) -> dict[str, Figure]:
    """Return the figures by the name of their place on the page.  Local.

    Of output K response_K, per_level_K, peaks_K, peak_frequency_K and peak_damping_K; states, energy, error, closure, unknowns;
    of curve I of peaks over a number over_I, over_frequency_I and over_damping_I.
    What is not there is left out.
    """
    if results.shown.is_static:
        return _static_figures(results)
    colours = map(matplotlib.colors.to_hex, level_colours(len(results.levels)))
    levels = [(level, colour) for level, colour in zip(results.levels, colours) if len(level.frequency)]
    figures: dict[str, Figure] = {}
    for k in range(min(len(results.outputs), MOST_OUTPUTS)):
        figures[f"response_{k}"] = _response(results, levels, k, False)
        figures[f"per_level_{k}"] = _response(results, levels, k, True)
        figures |= _peaks(results, k)
    if results.joint.n_pairs and levels:
        figures["states"] = _states(results, levels)
    if levels:
        figures["energy"], figures["closure"] = _energy(levels), _closure(results, levels)
        figures["unknowns"] = _figure(
            [_line(level, level.unknowns, colour, "%{y} unknowns") for level, colour in levels], "frequency [Hz]", "unknowns"
        )
    if any(level.error is not None and level.error.any() for level, _ in levels):
        figures["error"] = _error(levels)
    for i, curve in enumerate(results.over):
        figures |= _over(results, i, curve)
    return figures


def _response(results: ResultFile, levels, k: int, per_level: bool) -> Figure:
    """Return the amplitude of output k, or that per unit of the level, with error bands and the linear curve."""
    share = [1.0 / abs(level.level) if per_level and level.level else 1.0 for level, _ in levels]
    curves = [amplitude(level.response[:, k]) * s for (level, _), s in zip(levels, share)]
    linear = amplitude(results.linear.response[:, k]) if results.linear is not None and per_level else np.zeros(0)
    factor, name = with_prefix(
        np.concatenate([np.zeros(0), *curves, linear]), results.unit_of(k) + (results.shown.per_level if per_level else "")
    )
    traces = []
    if len(linear):
        hover = f"%{{y:.5g}} {name} at %{{x:.7g}} Hz<extra>all stuck, linear</extra>"
        line = {"color": "#b9b9b9", "width": 5}
        traces.append(_trace(results.linear.frequency, factor * linear, "all stuck, linear", line, hovertemplate=hover))  # type: ignore[union-attr]
    for (level, colour), values, s in zip(levels, curves, share):
        bar = None if level.error is None else s * total(level.error[:, k])
        if bar is not None and bar.any():
            traces.append(_band(level, factor * values, factor * bar, colour))
        traces.append(
            _curve(
                level,
                colour,
                factor * values,
                name,
                np.degrees(phase(level.response[:, k])),
                None if bar is None else factor * bar,
            )
        )
        traces += _marks(level, k, factor * s, name, colour)
    figure = _figure(traces, "frequency [Hz]", f"amplitude [{name}]")
    tops = [values.max() for values in curves if values.any()]
    is_wide = any(values.max() > _WIDE * values[values > 0.0].min() for values in curves if values.any())
    return _log(figure) if is_wide or (not per_level and tops and max(tops) > _RATIO * min(tops)) else figure


def _marks(level: LevelResult, k: int, factor: float, unit: str, colour: str) -> list[Figure]:
    """Return the peaks of output k that were solved for, marked in the curve of a level."""
    peaks = [peak for peak in level.peaks or () if peak.output == k]
    text = f"peak: %{{y:.6g}} {unit} at %{{x:.9g}} Hz<br>damping ratio %{{customdata:.3g}} %<extra>{_name(level)}</extra>"
    x, y = [hertz(peak.omega) for peak in peaks], [factor * abs(peak.amplitude) for peak in peaks]
    marker = {"symbol": "circle-open", "size": 9, "color": colour}
    style = {"mode": "markers", "marker": marker, "showlegend": False, "legendgroup": _name(level), "hovertemplate": text}
    return [_trace(x, y, "peak", {}, **style, customdata=_plain([100.0 * peak.damping for peak in peaks]))] if peaks else []


def _peaks(results: ResultFile, k: int) -> dict[str, Figure]:
    """Return amplitude, frequency and damping of the peaks of output k over the level, where several levels have some."""
    lines = resonances(results.levels, k)
    if len({level.level for line in lines for level, _ in line}) < 2:
        return {}
    factor, unit = with_prefix([abs(peak.amplitude) for line in lines for _, peak in line], results.unit_of(k))
    shown: dict[str, tuple[str, Callable[[Peak], float]]] = {
        f"peaks_{k}": (f"peak amplitude [{unit}]", lambda peak: factor * abs(peak.amplitude)),
        f"peak_frequency_{k}": ("peak frequency [Hz]", lambda peak: hertz(peak.omega)),
        f"peak_damping_{k}": ("damping ratio [%]", lambda peak: 100.0 * peak.damping),
    }
    figures = {}
    for key, (label, of) in shown.items():
        traces = [
            _trace([level.level for level, _ in line], [of(peak) for _, peak in line], "resonance", {}, mode="lines+markers")
            for line in lines
        ]
        figures[key] = _figure(traces, f"level [{results.level_unit}]", label)
    del figures[f"peak_frequency_{k}"]["layout"]["yaxis"]["rangemode"]  # a shift of a per cent is to be seen
    return figures


def _curve(level: LevelResult, colour: str, values, unit: str, angle, bar) -> Figure:
    """Return the curve of a level; its points show amplitude, phase, bar and states."""
    lines = [f"{unit} at %{{x:.7g}} Hz", "phase %{customdata[0]:.1f}°"]
    columns = [angle]
    if bar is not None:
        lines.append(f"± %{{customdata[{len(columns)}]:.2g}} {unit}")
        columns.append(bar)
    _, slip, is_open = counts(level.state).T
    lines.append(f"%{{customdata[{len(columns)}]}} slip, %{{customdata[{len(columns) + 1}]}} open")
    columns += [slip, is_open]
    trace = _line(level, values, colour, "%{y:.5g} " + "<br>".join(lines))
    trace["customdata"] = _cut(level, np.column_stack(columns))
    return trace


def _band(level: LevelResult, values, bar, colour: str) -> Figure:
    """Return a filled band about a curve, segment by segment."""
    x, y = [], []
    for part in segments(level.segment):
        x += [*level.frequency[part], *level.frequency[part][::-1], None]
        y += [*(values + bar)[part], *np.maximum(values - bar, 0.0)[part][::-1], None]
    red, green, blue = (int(255 * c) for c in matplotlib.colors.to_rgb(colour))
    fill = {"fill": "toself", "fillcolor": f"rgba({red},{green},{blue},0.22)", "hoverinfo": "skip", "showlegend": False}
    return {**_trace(x, y, "error bar", {"width": 0}, **fill), "legendgroup": _name(level)}


def _states(results: ResultFile, levels) -> Figure:
    traces = []
    for level, colour in levels:
        for k, dash in ((1, "solid"), (2, "dot")):
            number = counts(level.state)[:, k]
            if k == 1 or number.any():
                text = f"%{{y}} of {counted(results.joint.n_pairs, 'pair')} {STATE_NAMES[k]} at %{{x:.7g}} Hz"
                trace = _line(level, number, colour, text)
                trace["line"]["dash"], trace["showlegend"] = dash, k == 1
                traces.append(trace)
    return _figure(traces, "frequency [Hz]", "pairs slipping, dotted: open")


def _energy(levels) -> Figure:
    factor, unit = with_prefix(np.concatenate([np.abs(level.input) for level, _ in levels]), "J")
    traces = []
    for level, colour in levels:
        for name, dash in (("friction", "solid"), ("damping", "dash")):
            trace = _line(level, factor * getattr(level, name), colour, f"{name} %{{y:.4g}} {unit} a cycle at %{{x:.7g}} Hz")
            trace["line"]["dash"], trace["showlegend"] = dash, name == "friction"
            traces.append(trace)
    return _figure(traces, "frequency [Hz]", f"friction, dashed: damping [{unit}]")


def _closure(results: ResultFile, levels) -> Figure:
    """Return how well the energy balance closes, with the bound that it is judged by."""
    traces = []
    for level, colour in levels:
        gap = np.maximum(balance(results, level), 1e-17)
        traces.append(_line(level, gap, colour, "%{y:.1e} of the input at %{x:.7g} Hz"))
    bound = max(level.closes_to for level, _ in levels)
    ends = [float(f(level.frequency[i] for level, _ in levels for i in (0, -1))) for f in (min, max)]
    line = {"color": FAINT, "dash": "dash", "width": 1}
    traces.append(_trace(ends, [bound, bound], "bound", line, hoverinfo="skip"))
    return _log(_figure(traces, "frequency [Hz]", "imbalance of energy / input"))


def _error(levels) -> Figure:
    traces = []
    for level, colour in levels:
        if level.error is None or not len(level.frequency):
            continue
        top = amplitude(level.response[:, 0]).max() or 1.0
        parts = 100.0 * level.error[:, 0] / top
        text = "".join(f"<br>{name} %{{customdata[{k}]:.2g}} %" for k, name in enumerate(PARTS))
        trace = _line(level, np.maximum(total(parts), 1e-12), colour, "± %{y:.3g} % of the peak at %{x:.7g} Hz" + text)
        trace["customdata"] = _cut(level, parts)
        traces.append(trace)
    return _log(_figure(traces, "frequency [Hz]", "error bar [% of the peak]"))


def _over(results: ResultFile, i: int, curve: PeaksOver) -> dict[str, Figure]:
    """Return amplitude per unit of the level, frequency and damping of a peak over a number."""
    if not len(curve.value):
        return {}
    axis = f"{'level' if curve.key == 'level' else curve.key} [{curve.unit.replace('1', '-')}]"
    factor, unit = with_prefix(curve.per_level, results.unit_of(curve.linear.output))
    quantities = {
        f"over_{i}": (factor * curve.per_level, f"peak per level [{unit}/{results.level_unit}]", "%{y:.5g}"),
        f"over_frequency_{i}": (curve.frequency, "frequency of the peak [Hz]", "%{y:.8g} Hz"),
        f"over_damping_{i}": (100.0 * curve.damping, "damping ratio [%]", "%{y:.4g} %"),
    }
    is_wide = curve.value.min() > 0.0 and curve.value.max() > _WIDE_NUMBER * curve.value.min()
    figures = {}
    for name, (values, title, text) in quantities.items():
        hover = f"{text} at %{{x:.6g}} {curve.unit.replace('1', '')}<extra></extra>"
        trace = _trace(curve.value, values, "peak", {"color": INK}, hovertemplate=hover) | {"mode": "lines+markers"}
        figures[name] = _figure([trace], axis, title)
        if is_wide:
            figures[name]["layout"]["xaxis"] |= {"type": "log"}
        if name.startswith("over_frequency"):
            figures[name]["layout"]["yaxis"]["rangemode"] = "normal"
    return figures


def _static_figures(results: ResultFile) -> dict[str, Figure]:
    """Return the figures of statics over the load."""
    levels = sorted(results.solved, key=lambda level: level.level)
    loads = np.array([level.level for level in levels])
    axis, figures = f"load level [{results.level_unit}]", {}
    marked = {"mode": "lines+markers"}
    for k in range(min(len(results.outputs), MOST_OUTPUTS)):
        values = np.array([level.response[0, k, 0] for level in levels])
        factor, unit = with_prefix(values, results.unit_of(k))
        hover = f"%{{y:.5g}} {unit} at %{{x:.6g}} {results.level_unit}<extra></extra>"
        trace = _trace(loads, factor * values, "displacement", {"color": INK}, hovertemplate=hover, **marked)
        figures[f"response_{k}"] = _figure([trace], axis, f"displacement [{unit}]")
    if results.joint.n_pairs:
        number = counts(np.array([level.state[0] for level in levels]))
        traces = [
            _trace(loads, n, name, {"color": colour}, **marked) for n, name, colour in zip(number.T, STATE_NAMES, STATE_COLOURS)
        ]
        figures["states"] = _figure(traces, axis, "pairs")
    return figures


# -- pieces of plotly --------------------------------------------------------------------------------------------------


def _name(level: LevelResult) -> str:
    return level_name(level, short=True)


def _line(level: LevelResult, values, colour: str, text: str) -> Figure:
    """Return a curve over the frequency, cut between its segments; ``text`` is shown for the point under the pointer."""
    hover = f"{text}<extra>{_name(level)}</extra>"
    return {
        **_trace(
            _cut(level, level.frequency), _cut(level, values), _name(level), {"color": colour, "width": 2}, hovertemplate=hover
        ),
        "legendgroup": _name(level),
    }


def _cut(level: LevelResult, values) -> list:
    """Return the values of the points with a gap between segments."""
    pieces: list = []
    for part in segments(level.segment):
        pieces += [*(pieces and [None]), *_plain(values[part])]
    return pieces


def _trace(x, y, name: str, line: dict, **more) -> Figure:
    return {"type": "scatter", "mode": "lines", "x": _plain(x), "y": _plain(y), "name": name, "line": line, **more}


def _plain(values) -> list:
    """Return numbers for JSON, to nine digits; None where there is none."""
    if isinstance(values, list):
        return [None if value is None or not np.isfinite(value) else float(f"{value:.9g}") for value in values]
    values = np.asarray(values, dtype=float)
    rows = [[float(f"{value:.9g}") if np.isfinite(value) else None for value in row] for row in values.reshape(len(values), -1)]
    return rows if values.ndim > 1 else [row[0] for row in rows]


def _figure(traces: list[Figure], x: str, y: str) -> Figure:
    return {"data": traces, "layout": {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}, "rangemode": "tozero"}}}


def _log(figure: Figure) -> Figure:
    figure["layout"]["yaxis"] |= {"type": "log", "exponentformat": "e"}
    return figure
