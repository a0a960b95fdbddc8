"""Solutions at a frequency as a table, search.csv, curves.csv and search.png.  Rank 0 only."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.lines import Line2D

from ...library.search import FollowedCurve, Search, SolutionAt
from ...messages.words import counted
from ...observe.screen_table import screen_table
from ...points.multipliers import is_stable
from ...results.layout import log_scale
from ...results.measures import segments
from ...results.stability_plots import DASHES, runs
from ...results.style import FAINT, INK, RC, WIDTH, Page, Titled, plain, with_prefix
from ...system.files import make_folder, remove_files
from ..records import cell, write_csv

FAINTEST = 1e-6  # least ratio of the smallest amplitude to the largest for a logarithmic axis
SAME = 1e-4  # largest relative difference of two responses of the same solution
_ACCENT, _SECOND = "#0072b2", "#d55e00"
_SOURCES = {"curve": "along the curve", "level": "over the level", "deflation": "by deflation"}
_STABLE = {True: "stable", False: "unstable", None: "\u2013"}


def write_search(result: Search, scene: Titled, folder: Path) -> str:
    """Write the files of a search; return the table for the screen.  Local.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    make_folder(str(folder))
    remove_files(folder, "curves.csv")
    rows = [record(result, solution) for solution in result.solutions]
    write_csv(str(folder / "search.csv"), rows[0], rows)
    followed = [
        row
        for i, solution in enumerate(result.solutions, 1)
        if solution.curve
        for row in curve_records(result, i, solution.curve)
    ]
    if followed:
        write_csv(str(folder / "curves.csv"), followed[0], followed)
    with matplotlib.rc_context(RC):
        draw(result, scene, str(folder / "search.png"))
    return "\n".join([on_screen(result), in_words(result), *noted(result), *returning(result), *ended(result)])


def record(result: Search, solution: SolutionAt) -> dict[str, Any]:
    """Return a solution by the names of the columns of search.csv."""
    columns: dict[str, Any] = {"frequency_Hz": result.frequency, "level": result.level}
    for name, unit, size, phase in zip(result.outputs, result.units, solution.amplitude, solution.phase):
        columns |= {f"{name}_{unit}": float(size), f"{name}_phase_rad": float(phase)}
    stable = float("nan") if solution.stable is None else int(solution.stable)
    return columns | {
        "slipping": solution.slipping,
        "open": solution.open,
        "residual": solution.residual,
        "stable": stable,
        "largest_multiplier": solution.largest_multiplier,
        "found": solution.source,
    }


def curve_records(result: Search, solution: int, curve: FollowedCurve) -> list[dict[str, Any]]:
    """Return the points of a curve by the names of the columns of curves.csv."""
    stable = (
        [float("nan")] * len(curve.frequency) if curve.multipliers is None else [int(is_stable(m)) for m in curve.multipliers]
    )
    return [
        {"solution": solution, "segment": int(segment), "frequency_Hz": float(frequency)}
        | {f"{name}_{unit}": float(size) for name, unit, size in zip(result.outputs, result.units, sizes)}
        | {"stable": is_stable_point}
        for segment, frequency, sizes, is_stable_point in zip(curve.segment, curve.frequency, curve.amplitude, stable)
    ]


def on_screen(result: Search) -> str:
    """Return the table for the screen."""
    head = [
        "solution",
        f"{result.outputs[0]} {result.units[0]}",
        "phase",
        "slip",
        "open",
        "residual",
        "stability",
        "multiplier",
        "found",
    ]
    rows = [
        [
            str(i),
            cell(float(solution.amplitude[0]), 5),
            cell(float(np.degrees(solution.phase[0])), 4),
            str(solution.slipping),
            str(solution.open),
            cell(solution.residual, 2),
            _STABLE[solution.stable],
            cell(solution.largest_multiplier, 4),
            _SOURCES[solution.source],
        ]
        for i, solution in enumerate(result.solutions, 1)
    ]
    title = f"Solutions at {result.frequency:g} Hz, {result.level:g} {result.level_unit}"
    return screen_table(title, head, [(0, row) for row in rows], left=("found",))


def in_words(result: Search) -> str:
    """Return the sentence below the table: there may be further solutions."""
    n, at = len(result.solutions), f"{result.frequency:g} Hz and {result.level:g} {result.level_unit}"
    which = "one solution" if n == 1 else f"{counted(n, 'solution')}"
    more = "with more --starts others may be found" if n > 1 else "no other from these starts; there may be others"
    return f"{which} found at {at}, with {result.starts} starts: {more}"


def noted(result: Search) -> list[str]:
    """Return the notes of the solutions, each with their numbers."""
    notes = dict.fromkeys(note for solution in result.solutions for note in solution.notes)
    of = {note: [str(i) for i, solution in enumerate(result.solutions, 1) if note in solution.notes] for note in notes}
    return [f"solution{'s' * (len(numbers) > 1)} {', '.join(numbers)}: {note}" for note, numbers in of.items()]


def returning(result: Search) -> list[str]:
    """Return, for each followed curve that returns to the frequency of the search, the solutions at which it does."""
    lines, at = [], f"{result.frequency:g} Hz"
    for i, solution in enumerate(result.solutions, 1):
        ends = returns(solution.curve, result.frequency) if solution.curve is not None else []
        places = sorted({place(result, end) for end in ends})
        if len(ends) == 2 and len(places) == 1:
            lines.append(f"solution {i}: the curve through it is closed and passes {at} at {places[0]}, too")
        elif ends:
            lines.append(f"solution {i}: the curve through it turns back to {at}, at {' and '.join(places)}")
    return lines


def place(result: Search, response: np.ndarray) -> str:
    """Return as text the number of the solution with this response, (n_outputs, N_H)."""
    for k, solution in enumerate(result.solutions, 1):
        if np.linalg.norm(response - solution.response) <= SAME * np.linalg.norm(response):
            return f"solution {k}"
    return f"a solution not in the table, of {np.hypot(*response[0, 1:3]):.4g} {result.units[0]}"


def returns(curve: FollowedCurve, frequency: float) -> list[np.ndarray]:
    """Return the responses, (n_outputs, N_H) each, at the ends of segments of a curve that end at ``frequency`` [Hz]."""
    indices = [np.flatnonzero(curve.segment == segment) for segment in np.unique(curve.segment)]
    ends = [of_segment[-1] for of_segment in indices if len(of_segment) > 1]
    return [curve.response[i] for i in ends if np.isclose(curve.frequency[i], frequency, rtol=1e-12, atol=0.0)]


def ended(result: Search) -> list[str]:
    """Return why followed curves end within the range."""
    return [
        f"solution {i}: the curve through it ends within the range: {solution.curve.failure}"
        for i, solution in enumerate(result.solutions, 1)
        if solution.curve is not None and solution.curve.failure
    ]


def draw(result: Search, scene: Titled, path: str) -> None:
    """Draw the solutions, the curve of the level, and the curves through other solutions.  Local."""
    followed = [solution.curve for solution in result.solutions if solution.curve is not None]
    shown = np.concatenate([result.curve.amplitude[:, 0], [solution.amplitude[0] for solution in result.solutions]])
    factor, unit = with_prefix(shown, result.units[0])
    handles = [Line2D([], [], color=_ACCENT, label="curve of the level")]
    if followed:
        handles.append(Line2D([], [], color=_SECOND, label="through other solutions"))
    for stable, label in ((True, "stable"), (False, "unstable"), (None, "stability not computed")):
        if any(solution.stable is stable for solution in result.solutions):
            handles.append(Line2D([], [], color=INK, lw=0, marker="o", ms=4.5, mfc=_filled(stable), label=label))
    drawn = [result.curve, *followed]
    if any(curve.multipliers is not None and not all(map(is_stable, curve.multipliers)) for curve in drawn):
        handles.append(Line2D([], [], color=INK, ls=DASHES, label="unstable part"))
    name = plain(result.outputs[0], 24)
    heading = f"solutions found at {result.frequency:g} Hz and {result.level:g} {result.level_unit}, amplitude of {name}"
    page = Page(scene, heading, WIDTH, 3.2, handles)
    axes = page.grid(1, 1).subplots()
    axes.axvline(result.frequency, color=FAINT, lw=0.8)
    for curve, colour in ((result.curve, _ACCENT), *((curve, _SECOND) for curve in followed)):
        of_points = None if curve.multipliers is None else np.array([is_stable(m) for m in curve.multipliers])
        for segment in segments(curve.segment):
            for part, holds in runs(of_points, segment):
                axes.plot(curve.frequency[part], curve.amplitude[part, 0] * factor, color=colour, ls="-" if holds else DASHES)
    for solution in result.solutions:
        axes.plot(
            result.frequency, solution.amplitude[0] * factor, "o", color=INK, ms=4.5, mfc=_filled(solution.stable), zorder=4
        )
    axes.set(xlabel="frequency [Hz]", ylabel=f"amplitude [{unit}]")
    if shown.min() > FAINTEST * shown.max():
        log_scale(axes, "y")
    page.save(path)


def _filled(stable: bool | None) -> str:
    return {True: INK, False: "white", None: FAINT}[stable]
