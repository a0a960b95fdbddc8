"""The tables of docs/extremes.md and its pictures, from the results of the battery."""

from __future__ import annotations

import datetime
import os
import sys
from collections import Counter
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from oracles.point_check import BOUNDS
from verification import fold
from verification.extreme_run import DEFECT, FAILED, REFUSED, SOLVED, WRONG

sys.path.insert(0, str(Path(__file__).parents[2] / "jobs" / "bench"))
import machine
from page_tables import put, table

COMMAND = "PYTHONPATH=solver:tests python tests/verification/extremes.py --docs docs"
COLOURS = {SOLVED: "tab:green", REFUSED: "tab:blue", FAILED: "tab:orange", WRONG: "tab:red", DEFECT: "k"}


def write_page(docs: str, outcomes: list, seconds: float, processes: int) -> None:
    """Write the tables of extremes.md, and img/extremes.png and img/fold.png, into a folder."""
    folder = Path(docs)
    (folder / "img").mkdir(parents=True, exist_ok=True)
    folds = fold.draw(folder / "img")
    draw(outcomes, folder / "img" / "extremes.png")
    facts = {**machine.facts(), "date": f"{datetime.date.today():%Y-%m-%d}", **load(outcomes, seconds, processes)}
    tables = {
        "summary": summary(outcomes),
        "families": families(outcomes),
        "not-solved": not_solved(outcomes),
        "folds": [f"- {line}" for line in folds],
        "machine": [f"- {line}" for line in machine.lines(facts)],
    }
    put(folder / "extremes.md", tables)


def load(outcomes: list, seconds: float, processes: int) -> dict[str, str]:
    """Return the load of the machine during the battery, which affects the times."""
    return {
        "time": f"{seconds:.0f} s of wall clock for {sum(outcome.cpu for outcome in outcomes):.0f} s of processor on {processes} processes "
        f"(load average of the last quarter of an hour {os.getloadavg()[2]:.1f})"
    }


def summary(outcomes: list) -> list[str]:
    """Return the numbers of cases and points by outcome."""
    counts = Counter(outcome.status for outcome in outcomes)
    answered = sum(outcome.has_answer for outcome in outcomes)
    by_rule = sum(outcome.expected and outcome.has_answer for outcome in outcomes)
    expected = sum(outcome.expected for outcome in outcomes)
    requested = answered - by_rule
    rows = [
        ("cases", "", len(outcomes)),
        ("without a solution", "", len(outcomes) - answered),
        ("refused by a rule for requests", "", by_rule),
        ("solved of the others", requested, f"{counts[SOLVED]}, {100 * counts[SOLVED] / requested:.1f} %"),
        ("refused, of these as expected", expected, f"{counts[REFUSED]}, {expected}"),
        ("failed with a reason", 0, counts[FAILED]),
        ("wrong without a message", 0, counts[WRONG]),
        ("defects", 0, counts[DEFECT]),
        ("points judged from the matrices alone", "", sum(outcome.n_points for outcome in outcomes)),
        ("points with the mean slip held by springs", "", sum(outcome.held for outcome in outcomes)),
        ("cases with a level that was followed more than once", "", sum(outcome.in_segments for outcome in outcomes)),
    ]
    return table(("what", "target", "result"), [tuple(map(str, row)) for row in rows])


def families(outcomes: list) -> list[str]:
    """Return the families, one per row."""
    rows = []
    for family in dict.fromkeys(outcome.family for outcome in outcomes):
        of_family = [outcome for outcome in outcomes if outcome.family == family]
        counts = Counter(outcome.status for outcome in of_family)
        worst = [
            max((outcome.errors.get(name, 0.0) for outcome in of_family), default=0.0)
            for name in ("motion", "force", "law", "energy")
        ]
        numbers = [len(of_family), counts[SOLVED], counts[REFUSED], counts[FAILED], counts[WRONG] + counts[DEFECT]]
        numbers.append(sum(outcome.n_points for outcome in of_family))
        seconds = sum(outcome.cpu for outcome in of_family)
        rows.append([family, *map(str, numbers), *(f"{error:.0e}" for error in worst), f"{seconds:.0f}"])
    counted = ("family", "cases", "solved", "refused", "failed", "wrong", "points")
    return table((*counted, "largest motion", "force", "law", "energy", "processor s"), rows)


def not_solved(outcomes: list) -> list[str]:
    """Return every case that was not solved, with the message of the program."""
    rows = []
    for outcome in outcomes:
        if outcome.status != SOLVED:
            words = outcome.words.split("/scene.toml: ")[-1].splitlines()[0].replace("|", "\\|") if outcome.words else ""
            what = outcome.status + ("" if not outcome.expected else ", by a rule" if outcome.has_answer else ", has no solution")
            rows.append([outcome.name, what, str(outcome.n_points), words])
    return table(("case", "outcome", "points computed", "message"), rows, words=4)


def draw(outcomes: list, path: Path) -> None:
    """Draw the largest force residual of every case, one family per row, coloured by its outcome."""
    families = list(dict.fromkeys(outcome.family for outcome in outcomes))[::-1]
    figure, axis = plt.subplots(figsize=(9.0, 4.6), constrained_layout=True)
    rng = np.random.default_rng(0)
    for status, colour in COLOURS.items():
        mine = [outcome for outcome in outcomes if outcome.status == status and outcome.n_points]
        if mine:
            axis.semilogx(
                [max(outcome.errors["force"], 1e-17) for outcome in mine],
                [families.index(outcome.family) + rng.uniform(-0.3, 0.3) for outcome in mine],
                "o",
                ms=4,
                alpha=0.7,
                color=colour,
                label=f"{status} ({len(mine)})",
            )
    axis.axvline(BOUNDS["force"], color="k", lw=0.8, ls=":")
    axis.annotate(
        "bound", (BOUNDS["force"], 1.0), (4, -10), xycoords=("data", "axes fraction"), textcoords="offset points", fontsize=8
    )
    axis.set(
        yticks=range(len(families)),
        yticklabels=families,
        xlabel="largest unbalanced force of any point of a case, over the forces [-]",
    )
    axis.set_title(
        f"{sum(outcome.n_points for outcome in outcomes)} points of {len(outcomes)} cases, judged from the matrices alone",
        loc="right",
    )
    axis.legend(fontsize=8, loc="upper right", bbox_to_anchor=(1.0, -0.14), ncol=2)
    axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)
    plt.close(figure)
