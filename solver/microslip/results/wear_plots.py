"""Pictures of wear: amplitude, frequency, damping and forces over the cycles, and depth and pressure on the joint."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.lines import Line2D

from ..fourier.coefficients import amplitude
from .joint_plots import draw_on_joint
from .record import LevelResult, ResultFile
from .style import INK, SERIES_COLOURS, WIDTH, Page, Pages, plain, some, with_prefix
from .wear import WearHistory

_MAPS = 3  # numbers of cycles of which a map is drawn
_WORN = "#d55e00"
_NEAR = 0.2  # of the peak: of the curves so much is shown


def draw_wear(results: ResultFile, history: WearHistory, curves: Sequence[LevelResult] = ()) -> Page:
    """Draw amplitude, frequency, damping, depth and normal force over the cycles, and the curves before and after.  Local."""
    names = [plain(name, 24) for name in history.joint.names]
    handles = [Line2D([], [], color=INK, label="new")] + [Line2D([], [], color=_WORN, label="worn")] if len(curves) == 2 else []
    if len(names) > 1:
        handles += [Line2D([], [], color=SERIES_COLOURS[k % 6], marker="o", ms=2.5, label=name) for k, name in enumerate(names)]
    of_peak = f"at {history.frequency[0]:.6g} Hz" if history.frequency_stays else f"at the peak of {plain(history.output, 30)}"
    heading = f"wear {of_peak} at {history.level:g} {history.level_unit}, by {history.law}: response and joint over the cycles"
    page = Page(results, heading, WIDTH, 4.4, handles)
    axes = page.grid(2, 3).subplots()
    factor, unit = with_prefix(history.amplitude, history.output_unit)
    depth_factor, depth_unit = with_prefix(history.depth, "m")
    of_joints = [history.joint.joint == k for k in range(len(names))]
    deepest = [depth_factor * history.depth[:, of_joint].max(axis=1, initial=0.0) for of_joint in of_joints]
    forces = [history.normal_force[:, of_joint] for of_joint in of_joints]
    least = [_share_of_first(N) for N in forces]
    panels = [
        (axes[0, 1], f"amplitude [{unit}]", [factor * history.amplitude]),
        (axes[0, 2], "frequency [Hz]", [history.frequency]),
        (axes[1, 0], "damping ratio [%]", [100.0 * history.damping]),
        (axes[1, 1], f"largest depth [{depth_unit}]", deepest),
        (axes[1, 2], "least normal force of a pair [%]", least),
    ]
    for ax, label, series in panels:
        for k, values in enumerate(series):
            ax.plot(history.cycles, values, color=SERIES_COLOURS[k % 6] if len(series) > 1 else INK, marker="o", ms=2.5)
        ax.set_ylabel(label)
        ax.set_xlabel("cycles")
    for ax in (axes[1, 1], axes[1, 2]):
        ax.set_ylim(0.0, None)
    _draw_curves(axes[0, 0], results, history, curves, factor, unit)
    return page


def _share_of_first(N: np.ndarray) -> np.ndarray:
    """Return the least normal force over that of the same pair before the first cycle, (n,) [%]."""
    is_loaded = N[0] > 0.0
    return 100.0 * (N[:, is_loaded] / N[0, is_loaded]).min(axis=1, initial=1.0)


def _draw_curves(ax, results: ResultFile, history: WearHistory, curves: Sequence[LevelResult], factor: float, unit: str) -> None:
    """Draw the curves of the output, new and worn, with the points of the cycles."""
    k = results.outputs.index(history.output)
    for level, colour in zip(curves, (INK, _WORN)):
        ax.plot(level.frequency, factor * amplitude(level.response[:, k]), color=colour)
    ax.plot(history.frequency, factor * history.amplitude, ls="", marker="o", ms=2.5, color="#8a8a8a")
    ax.set(xlabel="frequency [Hz]", ylabel=f"amplitude [{unit}]")
    high = [level.frequency[size >= _NEAR * size.max()] for level in curves if len(size := amplitude(level.response[:, k])) > 0]
    if high:
        ax.set_xlim(min(map(np.min, high)), max(map(np.max, high)))


def draw_wear_map(results: ResultFile, history: WearHistory) -> Pages:
    """Draw depth, and normal force at rest over its largest before the first cycle, on the surfaces laid flat.  Local."""
    n, palette = len(history.cycles), matplotlib.colormaps["viridis_r"]
    has_area = bool(np.isfinite(history.area).all())
    most, force = history.depth[-1].max(initial=0.0), history.normal_force / (history.area if has_area else 1.0)
    if n < 2 or most <= 0.0:
        return {}
    factor, unit = with_prefix([most], "m")
    shown = force[[0, n - 1]]
    largest, of = max(float(shown.max(initial=0.0)), 1e-300), "pressure [MPa]" if has_area else "normal force [N]"
    per = 1e-6 if has_area else 1.0
    blocks = []
    for i in some(list(range(n)), _MAPS)[1:]:
        deepest = factor * history.depth[i].max()
        head = f"depth after {history.cycles[i]:.4g} cycles: up to {deepest:.3g} {unit}"
        blocks.append((head, palette(history.depth[i] / most)))
    for i in (0, n - 1):
        low, high = per * force[i].min(), per * force[i].max()
        head = f"{of} at rest after {history.cycles[i]:.4g} cycles: {low:.3g} to {high:.3g}"
        blocks.append((head, palette(force[i] / largest)))
    bar = (palette, matplotlib.colors.Normalize(0.0, 1.0), "over the largest shown, of depth and of pressure")
    return draw_on_joint(results, "wear_map.png", "worn depth and pressure at rest of the contact pairs", blocks, [], bar)
