"""The figures of the case study, numbered as in the paper."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "meshes"))  # the skin of a mesh, as its generator draws it

import matplotlib
import numpy as np
from blocks import Body, skin
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator
from paper_runs import ARC, EPSILON, EQUAL, Level, Run, Study, errors, peak_error

from microslip.fourier.coefficients import amplitude
from microslip.points.branch import Branch
from microslip.reduction.expand import node_fields
from microslip.results.curve_plots import draw_response, draw_rom_size, draw_states
from microslip.results.joint_plots import draw_energy_map, draw_slip_map
from microslip.results.record import COMPLETE, LinearCurve, ResultFile, joint_of, level_result
from microslip.results.style import FAINT, INK, LINEAR, RC, WIDTH, Page, level_colours, panels, with_prefix

BY_SLIP = "adaptive, \u0394p \u2260 0"
_RAISED = "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"
FLOOR = 1e-11  # of a difference on a logarithmic axis
LATE, CHECKED, RUBIN = "#d55e00", "#0072b2", "#009e73"
_SAME_SIZE = 5e-3  # relative difference of the mean size of two models that are drawn as one curve
_SHAPES = 3  # modes drawn
_DEFORMED = 0.10  # largest motion of a drawn mode over the size of the structure
_VIEW = (22.0, -52.0)  # elevation and azimuth from which it is seen [degrees]


def draw_all(study: Study, folder: Path) -> dict[str, str]:
    """Draw all figures into ``folder``; return their files' names: by the paper's figure where it has one."""
    folder.mkdir(parents=True, exist_ok=True)
    own: dict[str, Callable[[Study], Page | None]] = {
        "4": modes,
        "adaptive": adaptive,
        "11": tolerance_response,
        "12": retained,
        "13": losses,
        "15": tolerance_size,
        "tolerance": tolerance_summary,
        "tolerance_error": tolerance_error,
        "step": steps,
    }
    shared = {
        "6": (draw_response, "reference"),
        "7": (draw_states, "reference"),
        "8": (draw_slip_map, "reference"),
        "9": (draw_rom_size, "adaptive"),
        "14": (draw_energy_map, "reference"),
    }
    files: dict[str, Page] = {}
    with matplotlib.rc_context(RC):
        for name, (draw, of) in shared.items():
            pages = list(draw(as_results(study, of)).values())
            if pages:
                files[name] = pages[0]
        for name, draw_own in own.items():
            own_page = draw_own(study)
            if own_page is not None:
                files[name] = own_page
        return {name: _save(page, folder, name) for name, page in sorted(files.items(), key=lambda item: _order(item[0]))}


def _order(name: str) -> int:
    return int(name) if name.isdigit() else 99


def _save(page: Page, folder: Path, name: str) -> str:
    """Write a page and return the file's name."""
    file = f"paper_fig{int(name):02d}.png" if name.isdigit() else f"paper_{name}.png"
    page.save(str(folder / file))
    return file


def as_results(study: Study, which: str) -> ResultFile:
    """Return the runs of one kind, "reference" or "adaptive", as a result file."""
    prepared, model = study.prepared, study.model
    scene, structure, curve = prepared.scene, prepared.structure, prepared.curve
    sizes = len(scene.outputs), model.n_pairs, model.N_H
    runs: list[Run] = [getattr(level, which) for level in study.levels]
    return ResultFile(
        path="",
        title=scene.title,
        name=scene.name,
        method=runs[0].row.method,
        scene_text="",
        options=(),
        versions={},
        outputs=tuple(output.name for output in scene.outputs),
        mode_frequency=model.omega_n / (2.0 * np.pi),
        joint=joint_of(structure.pairs, None if structure.mesh is None else structure.mesh.numbers),
        linear=LinearCurve(curve.omega / (2.0 * np.pi), curve.response),
        levels=tuple(level_result(Branch(run.level, run.points), sizes, COMPLETE) for run in runs),
    )


# -- figure 4: the modes of the stuck structure -------------------------------------------------------------------------


def modes(study: Study) -> Page | None:
    """Return the first modes of the stuck structure on its mesh, and the linear response; None without a mesh."""
    structure = study.prepared.structure
    if structure.mesh is None:
        return None
    shapes = node_fields(structure.linearised.system, structure.modes.phi_owned[:, :_SHAPES])
    assert shapes is not None, "this is rank 0"
    n = shapes.shape[2]
    heading = "modes with every pair stuck, colour: size of the motion; and the linear response"
    page = Page(study.prepared.scene, heading, WIDTH, 3.3)
    cells = page.grid(1, n + 1, width_ratios=[1.0] * n + [1.5])
    limits, views = [], []
    for k in range(n):
        ax = page.figure.add_subplot(cells[0, k])
        limits.append(_shape(ax, structure.mesh, shapes[:, :, k]))
        ax.set_title(f"mode {k + 1}, {study.model.omega_n[k] / (2.0 * np.pi):.4g} Hz", loc="center")
        views.append(ax)
    low, high = np.min([a for a, _ in limits], axis=0), np.max([b for _, b in limits], axis=0)
    for ax in views:
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        ax.set_axis_off()
    ax, curve = page.figure.add_subplot(cells[0, n]), study.prepared.curve
    values = amplitude(curve.response[:, 0])
    factor, unit = with_prefix(values, "m/N")
    ax.plot(curve.omega / (2.0 * np.pi), factor * values, color=INK)
    ax.set(xlabel="frequency [Hz]", ylabel=f"{study.prepared.scene.outputs[0].name}, amplitude [{unit}]", yscale="log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter("")
    ax.set_title("linear response", loc="left")
    ax.locator_params(axis="x", nbins=5)
    return page


def _shape(ax, mesh, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Draw a mode (n_nodes, 3) on the skin of the mesh; return the corners of what is drawn."""
    size = np.linalg.norm(shape, axis=1)
    moved = 1e3 * (mesh.points + _DEFORMED * mesh.diagonal / size.max() * shape)
    towards, flat = _view(*_VIEW)
    polygons, colours, depth = [], [], []
    for block in mesh.elements:
        for faces in skin(Body(block.kind, mesh.points, block.nodes, {})):
            corners = faces[:, : {3: 3, 6: 3, 4: 4, 8: 4}[faces.shape[1]]]
            points = moved[corners]
            normal = np.cross(points[:, 1] - points[:, 0], points[:, -1] - points[:, 0])
            seen = normal @ towards > 0.0
            polygons += list(points[seen] @ flat.T)
            colours.append(size[corners[seen]].mean(axis=1) / size.max())
            depth.append(points[seen].mean(axis=1) @ towards)
    order = np.argsort(np.concatenate(depth))
    shades = matplotlib.colormaps["viridis"](0.1 + 0.85 * np.concatenate(colours)[order])
    ax.add_collection(PolyCollection([polygons[i] for i in order], facecolors=shades, edgecolors="#33404d", linewidths=0.08))
    corners = np.concatenate(polygons)
    return corners.min(axis=0), corners.max(axis=0)


def _view(elevation: float, azimuth: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the direction to the viewer, and the directions right and up, (2, 3)."""
    e, a = np.radians([elevation, azimuth])
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return towards, np.array([right, np.cross(towards, right)])


# -- in addition to figure 6: adaptive and the reference ------------------------------------------------------------------------


def adaptive(study: Study) -> Page | None:
    """Response by `adaptive` on the reference, and the difference along the curve, a column per level."""
    levels = study.slipping
    if not levels:
        return None
    handles = [
        Line2D([], [], label="full set of pairs (receptance)", **LINEAR),
        Line2D([], [], color=LATE, label="adaptive"),
        Line2D([], [], color=CHECKED, ls="--", label="adaptive, checked in the point"),
    ]
    handles.append(Line2D([], [], color=FAINT, ls=":", lw=1.0, label="peak of the response"))
    if any(level.rubin for level in levels):
        handles.append(Line2D([], [], color=RUBIN, ls="", marker="D", ms=5, mfc="none", mew=1.3, label="plain Rubin at the peak"))
    heading = (
        f"adaptive ROM against the full set at the same points, where pairs slip: response, and difference over its peak "
        f"({FLOOR:g} or less at the foot)"
    )
    page = Page(study.prepared.scene, heading, WIDTH, 4.2, handles)
    axes = page.grid(2, len(levels)).subplots(squeeze=False, sharey="row", sharex="col")
    factor, unit = with_prefix(np.concatenate([level.reference.amplitude for level in levels]), "m")
    for level, (curve, error) in zip(levels, axes.T):
        exact = level.reference
        curve.plot(exact.frequency, factor * exact.amplitude, **LINEAR)
        for run, colour, style in ((level.adaptive, LATE, "-"), (level.checked, CHECKED, "--")):
            curve.plot(run.frequency, factor * run.amplitude, style, color=colour, lw=0.9)
            _differences(error, run, exact, color=colour, ls=style, lw=0.9)
        if level.rubin:
            at, height = exact.peak, amplitude(level.rubin.response[0][0])
            curve.plot(exact.frequency[at], factor * height, "D", color=RUBIN, ms=5, mfc="none", mew=1.3)
            off = np.abs(level.rubin.response[0] - exact.points[at].response).max() / np.abs(exact.points[at].response).max()
            error.plot(exact.frequency[at], off, "D", color=RUBIN, ms=5, mfc="none", mew=1.3)
        _marks(curve, error, level)
    axes[0, 0].set_ylabel(f"amplitude [{unit}]")
    axes[1, 0].set_ylabel("difference / peak")
    return page


def _differences(ax, run: Run, exact: Run, **looks) -> None:
    error = np.maximum(errors(run, exact), FLOOR)
    ax.plot(exact.frequency[: len(error)], error, **looks)


def _slip_range(level: Level) -> tuple[float, float]:
    """Return the frequencies between which pairs slip or open, and a margin [Hz]."""
    frequency, slips = level.reference.frequency, level.reference.retained > 0
    low, high = frequency[slips].min(), frequency[slips].max()
    margin = 0.12 * (high - low) or 1e-3 * high
    return max(low - margin, frequency.min()), min(high + margin, frequency.max())


def _marks(curve, error, level: Level) -> None:
    """Title, labels, range and the peak of a column."""
    curve.set_title(f"{level.level:g} N", loc="left")
    error.set_xlim(*_slip_range(level))
    error.set(yscale="log", xlabel="frequency [Hz]", ylim=(FLOOR / 2.0, 1.0))
    for ax in (curve, error):
        ax.axvline(level.reference.frequency[level.reference.peak], color=FAINT, ls=":", lw=1.0, zorder=0.5)
        ax.locator_params(axis="x", nbins=5)


# -- figures 12 and 13: original and improved method -------------------------------------------------------------------


def retained(study: Study) -> Page | None:
    """Pairs with p != 0 that each method retains along the curve of the highest level, and their losses."""
    if not study.slipping:
        return None
    level = study.slipping[-1]
    runs = {"original": level.adaptive, "improved": level.improved}
    order = np.argsort(-level.reference.points[level.reference.peak].energy, kind="stable")
    most = level.reference.points[level.reference.peak].energy.max()
    scale = LogNorm(max(EPSILON, 1e-7 * most), most, clip=True)
    idlers = f"in grey those that lose no more than {_joules(EPSILON)}"
    heading = f"pairs retained with \u0394p \u2260 0 along the curve, {level.level:g} N; {idlers}"
    page = Page(study.prepared.scene, heading, WIDTH, 3.0)
    cells = page.grid(1, 3, width_ratios=[1.0, 1.0, 0.03])
    axes = [page.figure.add_subplot(cells[0, 0])]
    axes.append(page.figure.add_subplot(cells[0, 1], sharex=axes[0], sharey=axes[0]))
    axes[1].tick_params(labelleft=False)
    for ax, (name, run) in zip(axes, runs.items()):
        energy, carries = np.array([point.energy for point in run.points])[:, order], run.carries[:, order]
        at, pair = np.nonzero(carries)
        lost, frequency = energy[at, pair], level.reference.frequency[at]
        idle = lost <= EPSILON
        ax.plot(frequency[idle], pair[idle], "s", color=FAINT, ms=1.3, mew=0.0)
        dots = ax.scatter(frequency[~idle], pair[~idle], c=lost[~idle], norm=scale, cmap="viridis", s=1.8, marker="s", lw=0.0)
        ax.set_title(f"{name}: {carries.sum(axis=1).max()} pairs at most", loc="left")
        ax.set(xlabel="frequency [Hz]", xlim=_slip_range(level))
        ax.locator_params(axis="x", nbins=5)
    axes[0].set_ylabel("pair, in the order of its loss at the peak")
    scale_at = page.figure.add_subplot(cells[0, 2])  # the layout has room for labels on the left of axes
    page.figure.colorbar(dots, cax=scale_at, ticklocation="left", label="friction loss [J a cycle]")
    return page


def losses(study: Study) -> Page | None:
    """Friction loss of all pairs along the curve by both methods and the reference, a panel per level."""
    levels = study.slipping
    if not levels:
        return None
    handles = [
        Line2D([], [], label="full set of pairs (receptance)", **LINEAR),
        Line2D([], [], color=LATE, label="original"),
        Line2D([], [], color=CHECKED, ls="--", label="improved"),
    ]
    page = Page(study.prepared.scene, "friction loss per cycle, where pairs slip", WIDTH, 2.3, handles)
    axes = page.grid(1, len(levels)).subplots(squeeze=False)[0]
    for ax, level in zip(axes, levels):
        looks = (LINEAR, {"color": LATE, "lw": 1.0}, {"color": CHECKED, "lw": 1.0, "ls": "--"})
        factor, unit = with_prefix(np.array([point.friction for point in level.reference.points]), "J")
        for run, look in zip((level.reference, level.adaptive, level.improved), looks):
            ax.plot(run.frequency, factor * np.array([point.friction for point in run.points]), **look)
        ax.set(xlabel="frequency [Hz]", ylabel=f"friction loss [{unit} a cycle]", xlim=_slip_range(level))
        ax.set_title(f"{level.level:g} N", loc="left")
        ax.locator_params(axis="x", nbins=4)
    return page


# -- figures 11 and 15: the energy tolerance ----------------------------------------------------------------------------


def tolerance_response(study: Study) -> Page | None:
    """Response by `adaptive-energy` for each tolerance, around the peak of each level."""

    def draw(ax, run: Run | None, level: Level, factor: float, **looks) -> None:
        run = run or level.reference
        ax.plot(run.frequency, factor * run.amplitude, **looks)

    heading = "response by adaptive-energy around the peak, by energy tolerance \u03b5"
    page, axes = _by_tolerance(study, heading, draw, (lambda run: run.amplitude, "m"))
    if page is None:
        return None
    for ax, level in zip(axes, study.slipping):
        exact = level.reference
        near = exact.frequency[exact.amplitude > 0.55 * exact.amplitude.max()]
        ax.set_xlim(near.min(), near.max())
        factor, unit = with_prefix(exact.amplitude, "m")
        most = max(run.amplitude.max() for run in (exact, *level.energy.values()))
        ax.set_ylim(0.5 * factor * exact.amplitude.max(), 1.05 * factor * most)
        ax.set_ylabel(f"amplitude [{unit}]")
    return page


def tolerance_size(study: Study) -> Page | None:
    """Unknowns of `adaptive-energy` along the curve for each tolerance; those of `adaptive` beneath."""

    def draw(ax, run: Run | None, level: Level, factor: float, **looks) -> None:
        run = run or level.adaptive
        ax.plot(run.frequency[1:], run.unknowns[1:], **looks)

    heading = (
        "unknowns of the adaptive ROM along the curve, by energy tolerance \u03b5; without the first point, at which B is full"
    )
    page, axes = _by_tolerance(study, heading, draw, base=BY_SLIP)
    for ax, level in zip(axes, study.slipping):
        ax.set(ylabel="unknowns", xlim=_slip_range(level))
        ax.set_ylim(bottom=0.0)
    return page


def tolerance_error(study: Study) -> Page | None:
    """Difference from the reference along the curve for each tolerance; that of `adaptive` beneath."""

    def draw(ax, run: Run | None, level: Level, factor: float, **looks) -> None:
        _differences(ax, run or level.adaptive, level.reference, **looks)

    heading = "difference from the full set over its peak, by energy tolerance \u03b5"
    page, axes = _by_tolerance(study, heading, draw, base=BY_SLIP, looks={"color": FAINT, "lw": 1.0, "ls": "--"})
    for ax, level in zip(axes, study.slipping):
        ax.set(yscale="log", ylim=(1e-6, 1.0), ylabel="difference / peak", xlim=_slip_range(level))
    return page


def _distinct(levels: list[Level]) -> list[float]:
    """Return the tolerances, without those whose model has the same size as the previous one at every level."""
    shown: list[float] = []
    for eps in levels[0].energy:
        sizes = np.array([[level.energy[e].unknowns.mean() for level in levels] for e in [*shown[-1:], eps]])
        if not shown or (np.abs(sizes[1] / sizes[0] - 1.0) > _SAME_SIZE).any():
            shown.append(eps)
    return shown


def _by_tolerance(study: Study, heading: str, draw, drawn=None, base: str = "full set of pairs (receptance)", looks=LINEAR):
    """Return a page with a panel per level and a curve per tolerance, and its axes.

    ``draw`` takes a run (None for the ``base``) and the factor of ``drawn``, values of a run and their unit.
    """
    levels = study.slipping
    if not levels:
        return None, []
    tolerances = _distinct(levels)
    if len(tolerances) < len(levels[0].energy):
        heading += "; without tolerances that change nothing"
    colours = matplotlib.colormaps["plasma"](np.linspace(0.0, 0.85, len(tolerances)))
    handles = [Line2D([], [], label=base, **looks)]
    handles += [Line2D([], [], color=colour, label=f"\u03b5 = {_joules(eps)}") for eps, colour in zip(tolerances, colours)]
    n_rows, n_columns = panels(len(levels))
    page = Page(study.prepared.scene, heading, WIDTH, 0.3 + 2.4 * n_rows, handles)
    cells = page.grid(n_rows, n_columns)
    axes = [page.figure.add_subplot(cells[divmod(i, n_columns)]) for i in range(len(levels))]
    for ax, level in zip(axes, levels):
        factor = with_prefix(drawn[0](level.reference), drawn[1])[0] if drawn else 1.0
        draw(ax, None, level, factor, **looks)
        for eps, colour, width in zip(tolerances, colours, np.linspace(1.6, 0.8, len(tolerances))):
            draw(ax, level.energy[eps], level, factor, color=colour, lw=width)
        ax.set_title(f"{level.level:g} N", loc="left")
        ax.set_xlabel("frequency [Hz]")
        ax.locator_params(axis="x", nbins=5)
    return page, axes


def _joules(eps: float) -> str:
    """Return a tolerance for a legend: 3 \u00b7 10\u207b\u2075 J."""
    if eps == 0.0:
        return "0"
    mantissa, exponent = f"{eps:.0e}".split("e")
    raised = str(int(exponent)).translate(str.maketrans("-0123456789", _RAISED))
    return ("" if mantissa == "1" else f"{mantissa}\u00b7") + f"10{raised} J"


def tolerance_summary(study: Study) -> Page | None:
    """Largest error, error of the peak, size and dropped pairs against the tolerance."""
    levels = study.slipping
    if not levels:
        return None
    tolerances = list(levels[0].energy)
    places, names = np.arange(len(tolerances)), [_joules(eps).removesuffix(" J") for eps in tolerances]
    colours = level_colours(len(levels))
    handles = [
        Line2D([], [], color=colour, marker="o", ms=3.5, label=f"{level.level:g} N") for level, colour in zip(levels, colours)
    ]
    handles.append(Line2D([], [], color=INK, ls="--", lw=0.9, label=BY_SLIP))
    heading = "adaptive-energy against its tolerance \u03b5: error (1e-8 or less at the foot) and size"
    page = Page(study.prepared.scene, heading, WIDTH, 4.4, handles)
    axes = page.grid(2, 2).subplots(sharex=True)
    quantities = [
        ("largest difference on the curve / peak", lambda run, exact: errors(run, exact).max()),
        ("|error of the peak|", lambda run, exact: abs(peak_error(run, exact))),
        ("unknowns, mean of the curve", lambda run, exact: run.unknowns.mean()),
        (
            "pairs with \u0394p \u2260 0 assumed stuck at the peak",
            lambda run, exact: run.dropped[min(exact.peak, len(run.dropped) - 1)],
        ),
    ]
    for k, (ax, (name, of)) in enumerate(zip(axes.ravel(), quantities)):
        for level, colour in zip(levels, colours):
            values = np.array([of(run, level.reference) for run in level.energy.values()], dtype=float)
            base = float(of(level.adaptive, level.reference))
            if k < 2:
                values, base = np.maximum(values, 1e-8), max(base, 1e-8)
            ax.plot(places, values, "o-", color=colour, ms=3.5)
            ax.axhline(base, color=colour, ls="--", lw=0.9)
        ax.set(title=name, **({"yscale": "log"} if k < 2 else {}))
        ax.set_xticks(places, names)
        if k >= 2:
            ax.set_ylim(bottom=0.0)
            ax.set_xlabel("\u03b5 [J a cycle and pair]")
    return page


# -- the step -----------------------------------------------------------------------------------------------------------


def steps(study: Study) -> Page | None:
    """Error of `adaptive` against the number of points, for both rules of stepping."""
    if not study.steps:
        return None
    levels = sorted({step.level for step in study.steps})
    colours = dict(zip(levels, level_colours(len(levels))))
    handles = [Line2D([], [], color=colours[level], lw=1.5, label=f"{level:g} N") for level in levels]
    handles += [
        Line2D([], [], color=INK, marker="o", ms=3.5, label="largest difference on the curve / peak"),
        Line2D([], [], color=INK, ls=":", marker="s", ms=3.5, mfc="white", label="|error of the peak|"),
    ]
    heading = f"adaptive without check: the error of updating from the previous point ({FLOOR:g} or less at the foot)"
    page = Page(study.prepared.scene, heading, WIDTH, 2.6, handles)
    axes = page.grid(1, 2).subplots(sharey=True)
    for ax, rule in zip(axes, (ARC, EQUAL)):
        for level in levels:
            chosen = [step for step in study.steps if (step.level, step.rule) == (level, rule) and not step.failure]
            chosen.sort(key=lambda step: step.solved)
            n = [step.solved for step in chosen]
            ax.plot(n, np.maximum([step.largest for step in chosen], FLOOR), "o-", color=colours[level], ms=3.5)
            ax.plot(n, np.maximum([abs(step.at_peak) for step in chosen], FLOOR), "s:", color=colours[level], ms=3.5, mfc="white")
        ticks = sorted({step.requested for step in study.steps})
        ax.set(xscale="log", yscale="log", xlabel="points", ylim=(FLOOR / 3.0, 1.0))
        ax.set_xticks(ticks, [str(n) for n in ticks])
        ax.minorticks_off()
        ax.set_title(rule, loc="left")
    axes[0].set_ylabel("error of adaptive")
    return page


def remove_old(folder: Path) -> None:
    """Remove the figures of an earlier run."""
    for file in {*folder.glob("paper_*.png")} - {folder / "paper_claims.png"}:  # of another command
        os.remove(file)
