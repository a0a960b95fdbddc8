"""A wear study as a table, wear.csv, wear.png, wear_map.png, a group of results.h5 and wear.vtkhdf.  Rank 0 only."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np

from ...messages.words import counted
from ...observe.screen_table import screen_table
from ...results.read import read_results
from ...results.record import LevelResult, ResultFile
from ...results.style import RC, some
from ...results.wear import WearHistory, store_wear, write_wear_series
from ...results.wear_plots import draw_wear, draw_wear_map
from ..records import cell, write_csv

_ROWS = 14  # of the table on the screen


def write_wear(history: WearHistory, folder: Path, worn: Path | None) -> str:
    """Write the files of a study, whose curve is in results.h5, of the ``worn`` joint in another; return a table.  Local.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    rows = history.records()
    write_csv(str(folder / "wear.csv"), rows[0], rows, unknown="")
    store_wear(str(folder / "results.h5"), history)
    write_wear_series(str(folder), history)
    results = read_results(str(folder / "results.h5"), motion=False)
    curves = [*results.solved, *(read_results(str(worn / "results.h5"), motion=False).solved if worn is not None else ())]
    draw_pictures(results, history, curves, folder)
    return "\n".join([on_screen(history), *in_words(history)])


def draw_pictures(results: ResultFile, history: WearHistory, curves: Sequence[LevelResult], folder: Path) -> None:
    """Draw wear.png and, where something is worn and pairs have places, wear_map.png.  Local."""
    with matplotlib.rc_context(RC):
        draw_wear(results, history, curves).save(str(folder / "wear.png"))
        for name, page in draw_wear_map(results, history).items():
            page.save(str(folder / name))


def on_screen(history: WearHistory) -> str:
    """Return the table for the screen: numbers of cycles evenly spread."""
    head = [
        "cycles",
        f"{history.output} {history.output_unit}",
        "frequency Hz",
        "damping %",
        "depth m",
        "energy J",
        "slip",
        "open",
    ]
    keys = ("cycles", "amplitude", "frequency_Hz", "damping", "depth_max_m", "energy_J", "slipping", "open")
    digits, rows = (5, 5, 7, 4, 4, 4, 0, 0), some(history.records(), _ROWS)
    table = [
        (0, [cell(row[k] * (100.0 if k == "damping" else 1.0), n) if n else str(row[k]) for k, n in zip(keys, digits)])
        for row in rows
    ]
    return screen_table(f"wear at {history.level:g} {history.level_unit}, by {history.law}", head, table)


def in_words(history: WearHistory) -> list[str]:
    """Return lines on the effect of wear on the response and on each joint."""
    if len(history.cycles) < 2:
        return []
    rows, n = history.records(), len(history.cycles) - 1
    shift, growth = history.frequency[-1] - history.frequency[0], history.amplitude[-1] / history.amplitude[0] - 1.0
    lines = [
        f"after {history.cycles[-1]:.6g} cycles in {counted(n, 'jump')}: amplitude {100.0 * growth:+.3g} %, frequency "
        f"{shift:+.4g} Hz, "
        f"worn volume {rows[-1]['volume_m3']:.4g} m3 by {rows[-1]['energy_J']:.4g} J"
    ]
    errors, deepest = rows[-1]["jump_errors_m"], rows[-1]["depth_max_m"]
    if deepest > 0.0:
        lines.append(f"  errors of all jumps: {errors:.2g} m, {100.0 * errors / deepest:.2g} % of the largest depth")
    for k, name in enumerate(history.joint.names):
        of_joint = history.joint.joint == k
        first, last = history.normal_force[[0, -1]][:, of_joint]
        lost = np.count_nonzero((first > 0.0) & (last <= 0.0))
        lines.append(
            f"  {name}: {np.count_nonzero(history.depth[-1, of_joint])} of {counted(of_joint.sum(), 'pair')} worn, up to "
            f"{history.depth[-1, of_joint].max():.4g} m; normal force {first.sum():.5g} -> {last.sum():.5g} N; "
            f"{counted(lost, 'pair')} have "
            "lost all of theirs"
        )
    return lines
