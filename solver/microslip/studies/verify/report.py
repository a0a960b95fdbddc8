"""Comparison of harmonic balance and time integration: table, verify.csv and verify.png.  Rank 0 only."""

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.lines import Line2D

from ...fourier.coefficients import amplitude
from ...messages.words import counted
from ...observe.screen_table import screen_table
from ...points.branch import Branch
from ...points.multipliers import BEYOND
from ...results.measures import segments
from ...results.style import FAINT, INK, RC, WIDTH, Page, Titled, level_colours, panels, some, with_prefix
from ...system.files import make_folder
from ..records import cell, write_csv

COLUMNS = {  # columns of verify.csv: heading on the screen, and attribute of a check
    "level_N": ("level N", "level"),
    "frequency_Hz": ("frequency Hz", "frequency"),
    "peak": ("", "mark"),
    "harmonic_balance_m": ("harmonic balance m", "balanced"),
    "time_integration_m": ("time integration m", "marched"),
    "difference": ("difference", "difference"),
    "difference_with_phase": ("with phase", "with_phase"),
    "own_error": ("own error", "integration_error"),
    "higher_harmonics": ("higher harmonics", "higher"),
    "energy_closure": ("energy closure", "closure"),
    "periods": ("periods", "periods"),
    "change": ("change a period", "change"),
    "distance": ("distance", "distance"),
    "seconds": ("s", "seconds"),
    "largest_multiplier": ("largest multiplier", "multiplier"),
    "growth": ("growth a period", "growth"),
    "failure": ("failure", "failure"),
}
EXPECTED = 1e-3  # difference over the peak above which harmonics, samples or steps are insufficient
MARCHED = {"color": "#d55e00", "ls": "--", "lw": 1.0}
_MOST_LOOPS = 6


@dataclass(frozen=True, eq=False)
class Loop:
    """The hysteresis loop of one pair by both methods, along its direction of larger loss."""

    pair: int  # counted from 0
    direction: str  # x or y
    balanced: np.ndarray  # (2, n) du [m] and T [N]
    marched: np.ndarray  # (2, n)


@dataclass(frozen=True, eq=False)
class Check:
    """One point of a curve by both methods; amplitudes of harmonic 1 of the first output."""

    level: float  # N
    frequency: float  # Hz
    is_peak: bool
    balanced: float  # m
    marched: float  # m
    difference: float  # difference of the amplitudes over the peak of the curve
    with_phase: float  # difference of the complex amplitudes over the peak
    integration_error: float  # the same between half and all of the steps
    higher: float  # root of the sum of squares of harmonics 2 and up of the marched output over harmonic 1
    closure: float  # (input - damping - friction) / input of the last period
    periods: int
    change: float  # change of motion or contact forces in the last period, relative to the largest
    distance: float  # distance from the steady state, relative to the motion
    seconds: float
    multiplier: float = np.nan  # largest modulus of the Floquet multipliers by harmonic balance
    growth: float = np.nan  # factor a period of a small disturbance, by time integration
    failure: str = ""
    loop: Loop | None = None

    @property
    def mark(self) -> str:
        """A word if the point is a peak, else an empty text."""
        return "peak" if self.is_peak else ""

    @property
    def where(self) -> str:
        """Level and frequency of the point, for messages."""
        return f"{self.level:g} N, {self.frequency:.6g} Hz"


def write_verification(
    checks: Sequence[Check], branches: Sequence[Branch], scene: Titled, folder: str, settings: str, unit: str = "m"
) -> str:
    """Write verify.csv and verify.png; return the table and the verdict; ``unit``: unit of the first output.  Local.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(folder)
    records = [{name: getattr(check, field) for name, (_, field) in COLUMNS.items()} for check in checks]
    write_csv(f"{folder}/verify.csv", COLUMNS, records)
    with matplotlib.rc_context(RC):
        draw_verification(checks, branches, scene, f"{folder}/verify.png", settings, unit)
    return table(records) + "\n" + verdict(checks)


def table(records: Sequence[dict]) -> str:
    """Return the records as a table for the screen."""
    disturbed = any(not np.isnan(entry["growth"]) for entry in records)
    shown = {"failure": any(entry["failure"] for entry in records), "largest_multiplier": disturbed, "growth": disturbed}
    names = [name for name in COLUMNS if shown.get(name, True)]
    rows = [(entry["level_N"], [_cell(name, entry[name]) for name in names]) for entry in records]
    head = [COLUMNS[name][0] for name in names]
    title = "harmonic 1 of the first output; differences over the peak of the curve"
    return screen_table(title, head, rows, left=("", "failure"), wraps=head)


def verdict(checks: Sequence[Check]) -> str:
    """Return a line on the difference of the two methods, and on the less accurate one.  Local."""
    good = [check for check in checks if not check.failure]
    if not good:
        return "no point could be compared"
    worst = max(good, key=lambda check: check.with_phase)
    integration_error = max(check.integration_error for check in good)
    text = (
        f"largest difference {worst.with_phase:.1e} of the peak ({worst.where}; amplitude and phase); "
        f"time integration's own error is about {integration_error:.1e}"
    )
    if worst.with_phase <= EXPECTED:
        return text + of_disturbances(good)
    if worst.integration_error > 0.5 * worst.with_phase:
        return text + ": too few steps per period for a comparison; raise --steps" + of_disturbances(good)
    return text + ": harmonics or samples of harmonic balance are too few; try --harmonics and --samples" + of_disturbances(good)


def of_disturbances(checks: Sequence[Check]) -> str:
    """Return a line on the points whose disturbance agrees with the multipliers; an empty text if none was disturbed.  Local."""
    watched = [check for check in checks if not np.isnan(check.growth)]
    if not watched:
        return ""
    others = [check for check in watched if (check.growth > 1.0 + BEYOND) != (check.multiplier > 1.0 + BEYOND)]
    n_alike = len(watched) - len(others)
    text = f"\nsmall disturbances agree with the Floquet multipliers at {n_alike} of {counted(len(watched), 'point')}"
    return text + "".join(f"\n  not at {check.where}: {check.multiplier:.5f}, and {check.growth:.5f} in time" for check in others)


def _cell(name: str, value) -> str:
    digits = {
        "frequency_Hz": 7,
        "harmonic_balance_m": 5,
        "time_integration_m": 5,
        "level_N": 6,
        "seconds": 3,
        "largest_multiplier": 5,
        "growth": 5,
    }.get(name, 2)
    return cell(value, digits)


def draw_verification(
    checks: Sequence[Check], branches: Sequence[Branch], scene: Titled, path: str, settings: str, of_output: str = "m"
) -> None:
    """Draw the curves with the points of time integration, and below the loop of the most dissipative pair next to each peak."""
    loops = some([check for check in checks if check.loop is not None], _MOST_LOOPS)
    branches = [branch for branch in branches if branch.points]
    colours = dict(zip([branch.level for branch in branches], level_colours(len(branches))))
    handles = [Line2D([], [], color=colour, label=f"{level:g} N") for level, colour in colours.items()]
    handles += [
        Line2D([], [], color=INK, label="harmonic balance"),
        Line2D([], [], color=INK, ls="", marker="o", ms=4.5, mfc="none", label="time integration, harmonic 1"),
        Line2D([], [], label="time integration, loop", **MARCHED),
    ]
    heading = f"harmonic balance ({settings}) and time integration of the same model: first output; friction loops at the peaks"
    rows, columns = panels(len(loops)) if loops else (0, 1)
    page = Page(scene, heading, WIDTH, 2.9 + 2.1 * rows, handles)
    grid = page.grid(1 + rows, columns, height_ratios=[2.7] + [2.0] * rows)
    curve = page.figure.add_subplot(grid[0, :])
    factor, unit = with_prefix([amplitude(point.response[0]) for branch in branches for point in branch.points], of_output)
    for branch in branches:
        for segment in segments(np.array([point.segment for point in branch.points])):
            points = branch.points[segment]
            curve.plot(
                [point.omega / (2.0 * np.pi) for point in points],
                [factor * amplitude(point.response[0]) for point in points],
                color=colours[branch.level],
            )
    for check in checks:
        if not check.failure:
            curve.plot(check.frequency, factor * check.marched, "o", ms=4.5, mfc="none", mec=colours[check.level], mew=1.1)
    curve.set(xlabel="frequency [Hz]", ylabel=f"amplitude [{unit}]", ylim=(0.0, None))
    for number, check in enumerate(loops):
        _draw_loop(page.figure.add_subplot(grid[1 + number // columns, number % columns]), check, colours[check.level])
    page.save(path)


def _draw_loop(ax, check: Check, colour) -> None:
    """Draw one loop by both methods."""
    loop = check.loop
    sizes = np.concatenate([loop.balanced, loop.marched], axis=1)
    (across, unit), (up, force) = with_prefix(sizes[0], "m"), with_prefix(sizes[1], "N")
    for (du, T), style in ((loop.balanced, {"color": colour, "lw": 1.6}), (loop.marched, MARCHED)):
        ax.plot(across * np.append(du, du[0]), up * np.append(T, T[0]), **style)
    ax.axhline(0.0, color=FAINT, lw=0.5, zorder=0.5)
    ax.set_title(f"{check.level:g} N, {check.frequency:.5g} Hz, pair {loop.pair + 1}")
    ax.set(xlabel=f"$\\Delta u_{loop.direction}$ [{unit}]", ylabel=f"$T_{loop.direction}$ [{force}]")
