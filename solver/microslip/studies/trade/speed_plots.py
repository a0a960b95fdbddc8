"""The picture of a trade: error against time, and error bars against errors.  Rank 0 only."""

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ...results.layout import log_scale
from ...results.style import FAINT, INK, WIDTH, Page, Titled
from .study import ACCURACY, BASE, COMBINED, Study

# colour and marker of each kind of run; the markers distinguish them without colour
STYLES = {
    "harmonics": ("#0072b2", "o"),
    "samples": ("#d55e00", "s"),
    "modes": ("#009e73", "^"),
    "tolerance": ("#cc79a7", "D"),
    "eps": ("#e69f00", "v"),
    "method": ("#56b4e9", "P"),
    COMBINED: (FAINT, "x"),
    ACCURACY: (INK, "*"),
    BASE: (INK, "o"),
}
NAMES = {"eps": "eps of adaptive-energy", "tolerance": "solver tolerance", ACCURACY: "accuracy = ..."}
SIZES = {ACCURACY: 9.0, COMBINED: 4.0, BASE: 7.0}
JOINED = ("harmonics", "samples", "modes", "tolerance", "eps")
LEAST = 1e-12  # least error on a logarithmic axis
TENFOLD = "#eeeeee"


def draw_trade(study: Study, scene: Titled, path: str) -> None:
    """Draw the runs of a study."""
    kinds = [kind for kind in STYLES if any(run.parameter == kind for run in study.complete)]
    handles = [
        Line2D(
            [],
            [],
            color=STYLES[kind][0],
            marker=STYLES[kind][1],
            ms=4,
            lw=0.6 if kind in JOINED else 0.0,
            label=NAMES.get(kind, kind),
        )
        for kind in kinds
    ]
    handles += [
        Line2D([], [], color=INK, lw=1.6, drawstyle="steps-post", label="Pareto front"),
        Patch(color="#d9d9d9", label="below what the reference is known to"),
    ]
    levels = ", ".join(f"{level:g} N" for level in study.reference.curves)
    heading = f"speed against accuracy at {levels}: largest error of the first output's harmonic 1 over its peak"
    page = Page(scene, heading, WIDTH, 3.8, handles)
    left, right = page.grid(1, 2, width_ratios=(1.5, 1.0)).subplots()
    _draw_errors(left, study)
    _draw_bars(right, study)
    page.save(path)


def _draw_errors(axes, study: Study) -> None:
    """Draw error over response time, one line per setting, the Pareto front as a step line."""
    floor = max(study.reference.floor, LEAST)
    shown = {id(run): (run.cost, max(study.score(run).error, LEAST)) for run in study.complete}
    errors = [error for _, error in shown.values()] or [1.0]
    low = min(0.3 * floor, 0.5 * min(errors)) if floor > 1e-9 else 0.3 * min(errors)
    axes.axhspan(low, floor, color="#d9d9d9", lw=0, zorder=0)
    front = [shown[id(run)] for run in study.front()]
    log_scale(axes, "x", "y")
    axes.set(xlabel=f"processor time of the response, {_points(study)} points [s]", ylabel="largest error / peak [-]")
    if front:
        x, y = np.array(front).T
        last = max(seconds for seconds, _ in shown.values())
        axes.plot([*x, max(1.3 * last, x[-1])], [*y, y[-1]], drawstyle="steps-post", color=INK, lw=1.6, zorder=2)
    for kind, (colour, marker) in STYLES.items():
        runs = study.sweep(kind) if kind in JOINED else [run for run in study.complete if run.parameter == kind]
        if not runs or not any(run.parameter == kind for run in runs):
            continue
        x, y = np.array([shown[id(run)] for run in runs]).T
        axes.plot(
            x,
            y,
            color=colour,
            marker=marker,
            ms=SIZES.get(kind, 3.5),
            lw=0.6 if kind in JOINED else 0.0,
            mfc="none" if kind == BASE else None,
            zorder=4 if kind == ACCURACY else 3,
        )
    axes.set_ylim(low, 4.0 * max(errors))
    axes.margins(x=0.1)
    _name(axes, study, shown)
    axes.xaxis.set_major_locator(LogLocator(10.0, (1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_title("error against time")


def _name(axes, study: Study, shown: dict) -> None:
    """Label runs of `accuracy` and of harmonics, if there is space."""
    taken: list[np.ndarray] = []
    (left, right), (low, high) = np.log10(axes.get_xlim()), np.log10(axes.get_ylim())
    for kind, offset, space in ((ACCURACY, (4, -9), (0.08, 0.04)), ("harmonics", (4, 4), (0.12, 0.08))):
        for run in study.complete:
            if run.parameter != kind:
                continue
            position = (np.log10(shown[id(run)]) - (left, low)) / (right - left, high - low)
            if all(np.any(np.abs(position - other) > space) for other in taken):
                text = run.value if kind == ACCURACY else f"H={run.value}"
                place, side = ((-4, -9), "right") if run.setting.is_corrected else (offset, "left")  # corrected: left
                style = {"textcoords": "offset points", "fontsize": 6, "color": STYLES[kind][0], "zorder": 5}
                axes.annotate(text, shown[id(run)], xytext=place, horizontalalignment=side, **style)
                taken.append(position)


def _draw_bars(axes, study: Study) -> None:
    """Draw the bar of every point against its error."""
    score = study.validation()
    pairs = []
    for run in study.runs:
        for curve in run.curves:
            exact = study.reference.curves[curve.level]
            n = min(len(curve.omega), len(exact.omega))
            error, bar = np.abs(curve.u[:n] - exact.u[:n]) / (exact.peak or 1.0), curve.bar[:n] / (exact.peak or 1.0)
            shown = np.isfinite(bar) & (bar > 0.0) & (error > exact.bar[:n] / (exact.peak or 1.0))
            pairs.append((run.parameter, np.maximum(error[shown], LEAST), np.maximum(bar[shown], LEAST)))
    everything = np.concatenate([np.concatenate(pair[1:]) for pair in pairs]) if pairs else np.empty(0)
    if len(everything) == 0:
        axes.set_axis_off()
        axes.set_title("no error above that of the reference")
        return
    ends = np.array([0.5 * everything.min(), 2.0 * everything.max()])
    axes.fill_between(ends, ends, 10.0 * ends, color=TENFOLD, lw=0, zorder=0)
    axes.plot(ends, ends, color=INK, lw=0.8, zorder=2)
    for parameter, error, bar in pairs:
        axes.plot(error, bar, ".", ms=1.8, mew=0, color=STYLES.get(parameter, (FAINT, ""))[0], zorder=3, rasterized=True)
    log_scale(axes, "x", "y")
    axes.set(xlim=ends, ylim=ends, xlabel="error of a point / peak [-]", ylabel="its bar / peak [-]")
    axes.set_title(
        f"{100 * score.coverage:.1f} % of {score.n_above} points under their bar,\nbar / error {score.ratio:.2g} in the median"
    )
    axes.text(0.03, 0.97, "shaded: bar up to 10 times the error", transform=axes.transAxes, va="top", fontsize=6, color=INK)


def _points(study: Study) -> int:
    return sum(len(curve.omega) for curve in study.reference.curves.values())
