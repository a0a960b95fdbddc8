"""Pictures on the joint: states and friction losses of the pairs at the peak of each level, on the surfaces laid flat."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.patches import Patch as Swatch

from ..contact.law import STICK
from ..contact.laws import friction_limit
from ..fourier.coefficients import amplitude
from .layout import PowersOfTen
from .measures import counts
from .record import LevelResult, ResultFile
from .sensitivities import relative_at_peak
from .style import FAINT, INK, MOST_PANELS, STATE_COLOURS, STATE_NAMES, WIDTH, Page, Pages, level_name, plain, some, with_prefix
from .unroll import Patch, patches

_MM = 1e3
_MOST_PATCHES = 12
_MOST_HEIGHT = 8.6  # in, of all blocks
_LOWEST, _DEEPEST = 0.34, 2.6  # in, height of a surface: a thin strip is stretched, a small one not blown up
_NO_LOSS = "#ececec"
_LOSS_DECADES = 1e-4


def draw_slip_map(results: ResultFile) -> Pages:
    """Draw stick, slip and separation on the contact surfaces at the peak of each level.  Local."""
    handles = [_swatch(colour, name) for colour, name in zip(STATE_COLOURS, STATE_NAMES)]
    colours = np.array([matplotlib.colors.to_rgba(c) for c in STATE_COLOURS])
    n_at_rest = int(np.count_nonzero(results.joint.open_at_rest))

    def states(level: LevelResult) -> str:
        _, n_slip, n_open = counts(level.state[level.top])
        moving = [f"{n} {name}" for n, name in ((n_slip, "slip"), (n_open, "open")) if n]
        return (", ".join(moving) or "all stick") + (f" ({n_at_rest} at rest)" if n_at_rest else "")

    blocks = [(_at_peak(level, states(level)), colours[level.state[level.top]]) for level in some(results.solved, MOST_PANELS)]
    what = "states of the contact pairs at the peak of each level" + _of_levels(results)
    return draw_on_joint(results, "slip_map.png", what, blocks, handles)


def draw_energy_map(results: ResultFile) -> Pages:
    """Draw the friction loss per area and cycle at the peak of each level, in one colour scale.  Local."""
    area = results.joint.area
    per_area = results.joint.has_areas and bool(np.isfinite(results.joint.position).all())
    share, unit = (area, "J/m\u00b2") if per_area else (np.ones_like(area), "J")
    # a pair that sticks loses nothing; its recorded value is rounding
    at_peaks = [
        np.where(level.state[level.top] == STICK, 0.0, np.maximum(level.energy[level.top], 0.0)) / share
        for level in results.solved
    ]
    losses = np.concatenate([np.zeros(0), *at_peaks])
    losses = losses[losses > 0.0]
    palette = matplotlib.colormaps["inferno_r"]
    most = losses.max(initial=1e-300)
    scale = LogNorm(min(max(losses.min(initial=most), _LOSS_DECADES * most), 0.1 * most), most, clip=True)

    def colours(loss: np.ndarray) -> np.ndarray:
        rgba = np.tile(matplotlib.colors.to_rgba(_NO_LOSS), (len(loss), 1))
        if (loss > 0.0).any():
            rgba[loss > 0.0] = palette(0.04 + 0.92 * scale(loss[loss > 0.0]))
        return rgba

    def total(level: LevelResult) -> str:
        loss = level.energy[level.top][level.state[level.top] != STICK].sum()
        factor, prefix = with_prefix(loss, "J")
        return f"{factor * loss:.3g} {prefix}" if loss > 0.0 else "no loss"

    shown = some(list(zip(results.solved, at_peaks)), MOST_PANELS)
    blocks = [(_at_peak(level, total(level)), colours(loss)) for level, loss in shown]
    what = "friction loss per cycle" + (" and area" if per_area else " of each pair") + " at the peak of each level"
    what += ("" if len(losses) else ": none") + _of_levels(results)
    shades = matplotlib.colors.ListedColormap(palette(np.linspace(0.04, 0.96, 256)))
    bar = (shades, scale, f"friction loss per cycle [{unit}]") if len(losses) else None
    return draw_on_joint(results, "energy_map.png", what, blocks, [_swatch(_NO_LOSS, "no loss")], bar)


def draw_sensitivity_map(results: ResultFile) -> Pages:
    """Draw where friction matters: the change of the first output's peak with the friction of each pair.  Local."""
    levels = [level for level in some(results.solved, MOST_PANELS) if level.d_by_pairs is not None]
    area = results.joint.area
    per_area = results.joint.has_areas and bool(np.isfinite(results.joint.position).all())
    at_peaks = [
        (frequency, of_pairs["mu"]) for frequency, of_pairs, _ in (relative_at_peak(results.joint, level) for level in levels)
    ]
    most = max((np.abs(change / area if per_area else change).max(initial=0.0) for _, change in at_peaks), default=0.0)
    if most == 0.0:
        return {}
    palette, scale = matplotlib.colormaps["RdBu_r"], matplotlib.colors.Normalize(-most, most)
    blocks = [
        (
            _at(level, frequency, f"{change.sum():+.3g} % with 1 % of friction"),
            palette(scale(change / area if per_area else change)),
        )
        for level, (frequency, change) in zip(levels, at_peaks)
    ]
    what = "where friction matters: change of the amplitude with the friction of each pair at the peak of each level"
    unit = "per area [1/m\u00b2]" if per_area else "[-]"
    label = f"relative change of the amplitude over that of friction {unit}"
    return draw_on_joint(results, "sensitivity_map.png", what + _of_levels(results), blocks, [], (palette, scale, label))


def draw_rest(results: ResultFile) -> Pages:
    """Draw pressure and share of the friction limit at rest, where statics computed them.  Local."""
    joint = results.joint
    if not (joint.open_at_rest.any() or joint.T0.any()):
        return {}
    without = np.isnan(joint.N0)  # pairs of a law without normal force
    N = np.where(without, 0.0, np.maximum(joint.N0, 0.0))
    pressure = N / joint.area / 1e6
    columns = {"mu": joint.mu, "N0": joint.N0, **joint.law_columns}
    limit = np.nan_to_num(friction_limit(np.array(joint.law_names)[joint.laws], columns, N))
    friction = np.divide(np.hypot(*joint.T0.T), limit, out=np.zeros_like(N), where=limit > 0.0)
    palette = matplotlib.colormaps["viridis_r"]
    most = max(pressure.max(initial=0.0), 1e-300)
    known = f"pressure up to {most:.4g} MPa, {(N > 0.0).sum()} of {np.count_nonzero(~without)} pairs closed"
    heads = (
        (pressure / most, N > 0.0, "pressure: not defined by this law" if without.all() else known),
        (friction, (N > 0.0) | without, f"friction over its limit: up to {friction.max(initial=0.0):.3g}"),
    )
    grey = matplotlib.colors.to_rgba(_NO_LOSS)
    blocks = [(head, np.where(has[:, None], palette(np.clip(share, 0.0, 1.0)), grey)) for share, has, head in heads]
    over = "" if without.all() else f"pressure over {most:.4g} MPa, "
    bar = (palette, matplotlib.colors.Normalize(0.0, 1.0), f"{over}friction over its limit")
    handles = [_swatch(_NO_LOSS, "open, or no pressure known" if without.any() else "open")]
    return draw_on_joint(results, "rest.png", "state of rest: contact pressure and friction", blocks, handles, bar)


def _swatch(colour: str, label: str) -> Swatch:
    return Swatch(facecolor=colour, edgecolor=FAINT, lw=0.4, label=label)


def _at_peak(level: LevelResult, text: str) -> str:
    """Return the heading of a level's block at its highest point."""
    return _at(level, level.frequency[level.top], text)


def _at(level: LevelResult, frequency: float, text: str) -> str:
    """Return the heading of a level's block."""
    return f"{level_name(level, short=True)}, {frequency:.5g} Hz: {text}"


def _of_levels(results: ResultFile) -> str:
    """Return the part of the heading on levels: whose peak it is, and how many are not shown."""
    n = len(some(results.solved, MOST_PANELS))
    remarks = f"; peak of {plain(results.outputs[0], 30)}" if len(results.outputs) > 1 else ""
    return remarks + (f"; {n} of {len(results.levels)} levels" if n < len(results.levels) else "")


@dataclass(frozen=True)
class Layout:
    """A block for each level, with the patches row by row, all to one scale; inches."""

    level_columns: int
    patch_columns: int
    label: float  # height of the line above each patch
    scale: float  # in per m
    stretch: float  # of y against x
    widths: np.ndarray  # (patch_columns,) of the columns of patches
    heights: np.ndarray  # of the rows of patches

    LEFT, BELOW, TITLE, GAP, LABEL = 0.48, 0.38, 0.20, 0.20, 0.15

    @property
    def block(self) -> tuple[float, float]:
        """Width and height of a block."""
        return (
            float(self.widths.sum()) + len(self.widths) * self.GAP,
            self.TITLE + float(self.heights.sum()) + len(self.heights) * (self.GAP + self.label),
        )

    def height(self, n_levels: int) -> float:
        """Return the height of the page in inches."""
        return math.ceil(n_levels / self.level_columns) * self.block[1] + self.BELOW

    def upper_left(self, i: int, top: float) -> tuple[float, float]:
        """Return the upper left corner of block i on a page whose blocks begin at ``top``."""
        row, column = divmod(i, self.level_columns)
        return self.LEFT + column * self.block[0], top + row * self.block[1]

    def corner(self, k: int) -> tuple[float, float]:
        """Return the upper left corner of patch k in its block."""
        row, column = divmod(k, self.patch_columns)
        return (
            float(self.widths[:column].sum()) + column * self.GAP,
            self.TITLE + float(self.heights[:row].sum()) + row * (self.GAP + self.label) + self.label,
        )


def choose_layout(sizes: np.ndarray, n_levels: int, labelled: bool) -> Layout:
    """Return the layout with the largest pictures that fits a page; ``sizes`` (n_patches, 2) [m].  Local."""
    layouts = [
        _layout(sizes, level_columns, patch_columns, labelled)
        for level_columns in range(1, n_levels + 1)
        for patch_columns in range(1, len(sizes) + 1)
    ]
    fitting = [layout for layout in layouts if layout is not None]

    def rank(layout: Layout) -> tuple[float, float, float]:
        height = layout.height(n_levels)
        return round(max(0.0, height - _MOST_HEIGHT), 1), -round(layout.scale, 6), height

    return min(fitting, key=rank)


def _layout(sizes: np.ndarray, level_columns: int, patch_columns: int, labelled: bool) -> Layout | None:
    """Return the layout with these columns that fills the width, None where the gaps alone are wider."""
    n_rows = math.ceil(len(sizes) / patch_columns)
    grid = np.zeros((n_rows * patch_columns, 2))
    grid[: len(sizes)] = sizes
    grid = grid.reshape(n_rows, patch_columns, 2)
    widths, heights = grid[:, :, 0].max(axis=0), grid[:, :, 1].max(axis=1)
    free = WIDTH - Layout.LEFT - 0.1 - level_columns * patch_columns * Layout.GAP
    largest = max(sizes.max(), 1e-9)
    scale = min(free / (level_columns * max(widths.sum(), 0.02 * largest)), _DEEPEST / max(heights.max(), 0.02 * largest))
    if scale <= 0.0:
        return None
    stretch = max(1.0, _LOWEST / (scale * max(heights.min(), 0.02 * largest)))
    return Layout(
        level_columns,
        patch_columns,
        Layout.LABEL if labelled else 0.0,
        scale,
        stretch,
        scale * widths,
        np.maximum(scale * stretch * heights, 0.05),
    )


def _loss_at_peak(level: LevelResult) -> np.ndarray:
    """Return the friction loss of each pair at the largest amplitude of any output, (n_pairs,) J."""
    return level.energy[int(np.argmax(amplitude(level.response).max(axis=1)))]


def draw_on_joint(
    results: ResultFile, name: str, heading: str, blocks: Sequence[tuple[str, np.ndarray]], handles, bar=None
) -> Pages:
    """Draw the surfaces once for each block, a heading and the colours (n_pairs, 4) of the pairs.

    ``bar`` is palette, scale and text of a colour bar.
    """
    surfaces = patches(results.joint, results.n_sectors)
    if not blocks or not surfaces:
        return {}
    weight = np.ones(results.joint.n_pairs) if results.n_sectors == 1 else _loss_at_peak(results.solved[-1])
    largest = sorted(range(len(surfaces)), key=lambda i: -weight[surfaces[i].pairs].sum())[:_MOST_PATCHES]
    shown = [surfaces[i] for i in sorted(largest)]
    layout = choose_layout(np.array([patch.size for patch in shown]), len(blocks), len(surfaces) > 1)
    heading += results.of_sector
    if len(shown) < len(surfaces):
        heading += f"; {len(shown)} of {len(surfaces)} surfaces"
        heading += ", with the largest friction loss" if results.n_sectors > 1 else ""
    if not all(patch.to_scale for patch in shown):
        heading += "; pairs in the order of their numbers"
    elif layout.stretch > 1.01:
        heading += f"; across stretched {layout.stretch:.2g} times"
    page = Page(results, heading, WIDTH, layout.height(len(blocks)) + (0.56 if bar else 0.0), handles)
    for i, (head, rgba) in enumerate(blocks):
        x, y = layout.upper_left(i, page.top)
        page.text(x, y + 0.04, head)
        _block(page, layout, shown, rgba, i, len(blocks))
    if bar:
        _colour_bar(page, *bar)
    return {name: page}


def _block(page: Page, layout: Layout, shown: list[Patch], rgba: np.ndarray, i: int, n_blocks: int) -> None:
    """Draw the surfaces in block i, in colours (n_pairs, 4); ticks at the left and beneath the last of each column."""
    along = {patch.x_label for patch in shown}
    is_first, is_last = i % layout.level_columns == 0, i + layout.level_columns >= n_blocks
    upper_left = layout.upper_left(i, page.top)
    for k, patch in enumerate(shown):
        x, y = np.add(upper_left, layout.corner(k))
        size = layout.scale * patch.size * [1.0, layout.stretch]
        ax = page.axes(x, y, *np.maximum(size, 0.05))
        if layout.label:
            room = int(3 + 15 * layout.widths[k % layout.patch_columns])
            page.text(x, y - 0.02, plain(patch.label, room), va="bottom", fontsize=7, color="#555555")
        _surface(ax, patch, rgba, layout.scale)
        _ticks(ax, patch, is_first and k % layout.patch_columns == 0, is_last and k + layout.patch_columns >= len(shown), along)


def _surface(ax, patch: Patch, rgba: np.ndarray, scale: float) -> None:
    """Draw one patch: a coloured cell for each pair and face, the faces' edges; dots where there are no faces."""
    unit = _MM if patch.to_scale else 1.0
    low, high = patch.corners.min(axis=0), patch.corners.max(axis=0)
    if patch.cells:
        shades = rgba[patch.cell_pair]
        ax.add_collection(
            PolyCollection(
                [unit * (cell - low) for cell in patch.cells], facecolors=shades, edgecolors=shades, linewidths=0.2, clip_on=False
            )
        )
        ax.add_collection(
            PolyCollection(
                [unit * (ring - low) for ring in patch.outlines],
                facecolors="none",
                edgecolors="#5f5f5f",
                linewidths=0.3,
                alpha=0.7,
                clip_on=False,
            )
        )
    else:
        diameter = min(max(0.8 * 72.0 * scale * patch.spacing, 1.5), 12.0)  # points
        ax.scatter(
            *(unit * (patch.points - low)).T,
            c=rgba[patch.pairs],
            s=diameter**2,
            edgecolors="#5f5f5f",
            linewidths=0.3,
            clip_on=False,
        )
    extent = np.maximum(unit * (high - low), 1e-12)
    ax.set_xlim(0.0, extent[0])
    ax.set_ylim(0.0, extent[1])


def _ticks(ax, patch: Patch, has_y: bool, has_x: bool, along: set[str]) -> None:
    """Label the outer axes in millimetres; ``along`` are the directions of all patches above each other."""
    ax.grid(False)
    for spine in ax.spines.values():
        spine.set_visible(False)
    if not patch.to_scale:
        ax.set_xticks([])
        ax.set_yticks([])
        return
    ax.tick_params(length=2.0, pad=1.5, color=INK, labelbottom=has_x, labelleft=has_y)
    ax.locator_params(axis="x", nbins=6)
    ax.locator_params(axis="y", nbins=3)
    if has_x:
        ax.set_xlabel(f"mm along {patch.x_label}" if patch.x_label and len(along) == 1 else "mm", labelpad=1.0)
    if has_y:
        ax.set_ylabel("mm", labelpad=2.0)


def _colour_bar(page: Page, palette, scale, label: str) -> None:
    """Draw the colour scale at the foot of the page."""
    width = min(4.0, page.width - 1.0)
    ax = page.axes((page.width - width) / 2.0, page.height - 0.54, width, 0.1)
    bar = page.figure.colorbar(
        ScalarMappable(scale, palette),
        cax=ax,
        orientation="horizontal",
        extend="min" if isinstance(scale, LogNorm) else "neither",
    )
    if isinstance(scale, LogNorm):
        bar.ax.xaxis.set_major_formatter(PowersOfTen())
        bar.ax.xaxis.set_minor_formatter(PowersOfTen())
    bar.set_label(label, labelpad=1.0)
    bar.outline.set_linewidth(0.4)
