"""The common style of all pictures: fonts, colours, units, headings, grids of panels.  No pyplot, no global state."""

from __future__ import annotations

import io
import math
import textwrap
import warnings
from collections.abc import Sequence
from typing import Protocol

import matplotlib
import numpy as np
import PIL.Image
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..system.files import atomic_write
from .layout import PageLayout
from .record import STOPPED, LevelResult, ResultFile

WIDTH = 7.1  # in: the two columns of a page
DPI = 200
MOST_PANELS = 12  # small multiples in one picture
MOST_NAMED = 12  # levels named in a legend
ROWS = 5  # outputs in one picture

# no key comes from a matplotlibrc, which may be in the folder of a scene and name a program to run
RC = {key: value for key, value in matplotlib.rcParamsDefault.items() if key != "backend"} | {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.titley": 1.0,  # else every title is measured against the ticks
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.color": "#dddddd",
    "axes.axisbelow": True,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-3, 5),
    "figure.dpi": DPI,
    "text.hinting": "none",  # no benefit at this resolution
    "text.usetex": False,
    "axes.unicode_minus": True,
}

# Okabe and Ito: distinguished by all kinds of colour vision, and in grey by their lightness
STATE_COLOURS = ("#56b4e9", "#d55e00", "#1a1a1a")
STATE_NAMES = ("stick", "slip", "open")
STATE_STYLES = ("-", "-", "--")
INK, FAINT = "#1a1a1a", "#8a8a8a"
BOXED = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none"}  # of text over lines
LINEAR = {"color": "#b9b9b9", "lw": 3.2, "solid_capstyle": "butt"}  # a broad line that shows under the others
SERIES_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")  # of curves that are not levels
_LEVELS = "viridis"


def level_colours(n: int) -> np.ndarray:
    """Return a colour for each of n levels, dark to light."""
    return matplotlib.colormaps[_LEVELS](np.linspace(0.0, 0.8, n) if n > 1 else [0.25])


_HIGHEST = {"J": 3, "N": 3, "Pa": 9}  # powers of ten of the largest prefix; none for other units


def with_prefix(values, unit: str) -> tuple[float, str]:
    """Return a factor and the unit with the prefix that suits the largest of ``values``."""
    sizes = np.abs(values)
    largest = float(sizes[np.isfinite(sizes)].max(initial=0.0))
    if largest == 0.0:
        return 1.0, unit
    exponent = min(max(3 * math.floor(math.log10(largest) / 3.0 + 1e-9), -15), _HIGHEST.get(unit.split("/")[0], 0))
    if unit == "1" or unit.startswith("1/"):
        return 10.0**-exponent, f"10$^{{{exponent}}}${unit[1:]}" if exponent else unit
    prefix = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "\u00b5", -9: "n", -12: "p", -15: "f"}[exponent]
    return 10.0**-exponent, prefix + unit


def plain(text: str, most: int = 60) -> str:
    """Return a user's text on one line of at most ``most`` characters, in which matplotlib finds no formula."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    line = line if len(line) <= most else line[: most - 1].rstrip() + "\u2026"
    return line.replace("$", r"\$")


def level_name(level: LevelResult, short: bool = False) -> str:
    """Return the name of a level for a legend; whether it stopped early, and at which frequency unless ``short``."""
    if len(level.frequency) == 0:
        return level.text + ", no point"
    if level.status != STOPPED:
        return level.text
    return level.text + (" (stopped)" if short else f", stopped at {level.frequency[-1]:.5g} Hz")


def outputs_by_page(results: ResultFile) -> list[tuple[str, list[tuple[int, str]]]]:
    """Return number and name of the outputs of each picture, and the suffix of its file name: "", or _01, _02, ...."""
    outputs = list(enumerate(results.outputs))
    pages = [outputs[first : first + ROWS] for first in range(0, len(outputs), ROWS)]
    return [(f"_{i:02d}" if len(pages) > 1 else "", page) for i, page in enumerate(pages, 1)]


def some(items: Sequence, most: int) -> list:
    """Return at most ``most`` items, evenly spread, including the first and the last."""
    if len(items) <= most:
        return list(items)
    return [items[i] for i in np.unique(np.linspace(0, len(items) - 1, most).round().astype(int))]


class Titled(Protocol):
    """An object with a scene's title: a scene, its results."""

    @property
    def title(self) -> str:
        """The title of the scene; may be empty."""

    @property
    def name(self) -> str:
        """The name of the scene's file, without ending."""


class PageFigure(Figure):
    """A figure with the same style everywhere, which a notebook shows, without pyplot."""

    def draw(self, renderer) -> None:
        """Draw with the settings of the program."""
        with matplotlib.rc_context(RC):
            super().draw(renderer)

    def _repr_png_(self) -> bytes:
        with io.BytesIO() as file:
            FigureCanvasAgg(self).print_png(file)
            return file.getvalue()


class Page:
    """A figure with a heading and a legend above a field for axes; sizes in inches, ``height`` of the field.

    The heading is the scene's title, or its name, and, in a second line, the subject of the picture.
    """

    LINE, ENTRY, MARGIN = 0.145, 0.155, 0.08

    def __init__(self, results: Titled, heading: str, width: float, height: float, handles: Sequence = ()):
        title = textwrap.wrap(plain(results.title or results.name, 300), int(14 * width), max_lines=2, placeholder=" \u2026")
        lines = textwrap.wrap(heading, int(16 * width))
        columns = legend_columns([handle.get_label() for handle in handles], width)
        text_height = self.LINE * (len(title) + len(lines))
        self.top = self.MARGIN + text_height + (0.1 + self.ENTRY * math.ceil(len(handles) / columns) if handles else 0.06)
        self.width, self.height = width, height + self.top
        self.figure = PageFigure(figsize=(self.width, self.height), dpi=DPI)
        self.text(self.MARGIN, self.MARGIN, "\n".join(title), weight="bold")
        self.text(self.MARGIN, self.MARGIN + self.LINE * len(title), "\n".join(lines))
        if handles:
            at = (self.MARGIN / width, 1.0 - (self.MARGIN + text_height + 0.03) / self.height)
            self.figure.legend(
                handles=list(handles),
                loc="upper left",
                bbox_to_anchor=at,
                ncol=columns,
                borderaxespad=0.0,
                borderpad=0.0,
                columnspacing=1.4,
                handletextpad=0.6,
            )

    def text(self, x: float, y: float, text: str, **options) -> None:
        """Write below and right of a point, in inches from the upper left corner."""
        style = {"va": "top", "color": INK, "linespacing": 1.25, **options}
        self.figure.text(x / self.width, 1.0 - y / self.height, text, **style)

    def axes(self, x: float, y: float, width: float, height: float):
        """Return axes whose upper left corner is at a point, in inches from the upper left corner."""
        return self.figure.add_axes((x / self.width, 1.0 - (y + height) / self.height, width / self.width, height / self.height))

    def grid(self, n_rows: int, n_columns: int, **options):
        """Return the cells of a grid in the field, laid out so that nothing is cut off."""
        self.figure.set_layout_engine(PageLayout(self.top))
        return self.figure.add_gridspec(n_rows, n_columns, **options)

    def save(self, path: str) -> str:
        """Write the page as PNG, whole or not at all, and return its path."""
        with warnings.catch_warnings(), atomic_write(path) as unfinished:
            warnings.filterwarnings("ignore", "Glyph .* missing")  # a title in letters that the font lacks: boxes
            canvas = FigureCanvasAgg(self.figure)
            canvas.draw()  # savefig would draw twice to lay out
            picture = PIL.Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # nothing is transparent
            # a third of zlib's work makes files a tenth larger
            picture.save(unfinished, "PNG", compress_level=3, dpi=(DPI, DPI))
        return path


Pages = dict[str, Page]  # by the names of their files


def legend_columns(labels: Sequence[str], width: float) -> int:
    """Return in how many columns a legend fits, with as few rows as possible; matplotlib fills the first columns most."""
    for rows in range(1, len(labels) + 1):
        columns = math.ceil(len(labels) / rows)
        short, n_long = divmod(len(labels), columns)
        ends = np.cumsum([0] + [short + (k < n_long) for k in range(columns)])
        longest = [max(map(len, labels[i:j])) for i, j in zip(ends, ends[1:])]
        if sum(0.40 + 0.058 * n for n in longest) < width - 0.1:
            return columns
    return 1


def panels(n: int) -> tuple[int, int]:
    """Return rows and columns of a grid for n small pictures."""
    columns = {1: 1, 2: 2, 3: 3, 4: 2, 5: 3, 6: 3, 9: 3}.get(n, 4)
    return max(1, math.ceil(n / columns)), columns


def view_from(elevation: float, azimuth: float) -> np.ndarray:
    """Return three rows, the directions towards the viewer, to the right and up, from angles in degrees."""
    e, a = np.radians([elevation, azimuth])
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.array([towards, right, np.cross(towards, right)])
