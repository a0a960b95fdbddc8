"""The measured tables of docs/paper_claims.md, and its picture."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from claims_runs import IMPROVED, ORIGINAL, REFERENCE, Errors, Own, Trial, cells, judged
from matplotlib.lines import Line2D
from page_tables import table
from paper_runs import EQUAL

from microslip.results.style import RC, WIDTH, Page

FLOOR = 1e-8  # of a difference on a logarithmic axis
ONE, OTHER = "#d55e00", "#0072b2"  # original and improved


def tables(trials: Sequence[Trial], own: Sequence[Own]) -> dict[str, list[str]]:
    """Return the tables of the page by name."""
    return {"summary": summary(trials, own), "once": once(trials), "in-point": in_point(trials), "own-steps": own_steps(own)}


def summary(trials: Sequence[Trial], own: Sequence[Own]) -> list[str]:
    """Return the number of trials in which each method errs less, and the extremes of their errors."""
    mixed = [trial for trial in trials if trial.improved_again]
    verdicts = {
        "both updated once a point": [trial.better for trial in trials],
        "improved in the point, original one point late": [judged(one.improved_again, one.original) for one in mixed],
        "both updated in the point": [judged(one.improved_again, one.original_again) for one in mixed],
    }
    rows = [[f"{what}: improved, original, neither errs less", counts(of), str(len(of))] for what, of in verdicts.items()]
    lowest = min(trial.original.peak for trial in trials)
    rows.append(["lowest error of the original's peak (the paper: -2.2e-02)", f"{lowest:+.1e}", str(len(trials))])
    for method, name in ((REFERENCE, "full set"), (ORIGINAL, "original")):
        peaks = [one.peak[method] for one in own]
        rows.append([f"highest point of the {name}'s own steps, lowest", f"{min(peaks, default=0.0):+.1e}", str(len(own))])
    return table(("what", "result", "trials"), rows)


def counts(verdict: Sequence[str]) -> str:
    better = [verdict.count(method) for method in (IMPROVED, ORIGINAL)]
    return ", ".join(map(str, [*better, len(verdict) - sum(better)]))


def once(trials: Sequence[Trial]) -> list[str]:
    """Return the trials with the same update."""
    titles = ("level, N", "setting", "points", "original", "improved", "peak: original", "peak: improved", "better")
    return table(titles, map(cells, trials), words=2)


def in_point(trials: Sequence[Trial]) -> list[str]:
    """Return the trials in which every point was solved a second time with its own set."""
    rows = [
        [
            f"{trial.level:g}",
            trial.setting.name,
            *map(largest, (trial.original, trial.original_again, trial.improved_again)),
            *(f"{followed.peak:+.1e}" for followed in (trial.original, trial.improved_again)),
            judged(trial.improved_again, trial.original),
            judged(trial.improved_again, trial.original_again),
        ]
        for trial in trials
        if trial.improved_again
    ]
    titles = (
        "level, N",
        "setting",
        "original, one point late",
        "original, in the point",
        "improved, in the point",
        "peak: original late",
        "peak: improved in the point",
        "better: improved in the point or original late",
        "better: both in the point",
    )
    return table(titles, rows, words=2)


def largest(followed: Errors | None) -> str:
    return "" if followed is None else f"{followed.largest:.1e}" + (" (stopped)" if followed.failure else "")


def own_steps(own: Sequence[Own]) -> list[str]:
    """Return the highest points of curves with different frequencies."""
    methods = (REFERENCE, ORIGINAL, IMPROVED)
    rows = [
        [
            f"{one.level:g}",
            str(one.requested),
            *(str(one.solved[method]) for method in methods),
            *(f"{one.peak[method]:+.1e}" for method in methods),
        ]
        for one in own
    ]
    points = ("points: full set", "points: original", "points: improved")
    return table(("level, N", "points requested", *points, "highest: full set", "highest: original", "highest: improved"), rows)


def draw(trials: Sequence[Trial], scene) -> Page:
    """Draw the error along the curve at the highest level: as in the case study, and under settings with the paper's order."""
    shown = chosen(trials)
    handles = [
        Line2D([], [], color=ONE, label="original"),
        Line2D([], [], color=OTHER, label="improved"),
        Line2D([], [], color=ONE, ls=":", label="original, in the point"),
        Line2D([], [], color=OTHER, ls=":", label="improved, in the point"),
    ]
    heading = f"difference from the full set over its peak ({FLOOR:g} or less at the foot), {shown[0].level:g} N"
    with matplotlib.rc_context(RC):
        sheet = Page(scene, heading, WIDTH, 2.7, handles)
        axes = sheet.grid(1, len(shown)).subplots(squeeze=False, sharey=True, sharex=True)[0]
        for ax, trial in zip(axes, shown):
            for followed, colour, style in (
                (trial.original, ONE, "-"),
                (trial.improved, OTHER, "-"),
                (trial.original_again, ONE, ":"),
                (trial.improved_again, OTHER, ":"),
            ):
                if followed:
                    ax.plot(followed.omega / (2.0 * np.pi), np.maximum(followed.error, FLOOR), style, color=colour, lw=1.0)
            ax.set(yscale="log", xlabel="frequency [Hz]", ylim=(FLOOR / 2.0, 1.0))
            ax.set_title(trial.setting.name.replace("original retains ", "original retains\n"), loc="left")
            ax.locator_params(axis="x", nbins=5)
        low, high = _where_pairs_slip(shown)
        axes[0].set_xlim(low, high)
        axes[0].set_ylabel("difference / peak")
    return sheet


def chosen(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials to draw, of the highest level: the case study's, equal steps, and a test of the size of dp."""
    top = max(trial.level for trial in trials)
    of_level = [trial for trial in trials if trial.level == top]
    equal = [trial for trial in of_level if trial.setting.rule == EQUAL and trial.improved_again]
    crossed = [trial for trial in equal if judged(trial.improved_again, trial.original) == IMPROVED]
    slack = [trial for trial in of_level if trial.setting.slack]
    won = [trial for trial in slack if trial.better == IMPROVED]
    return [of_level[0], *(crossed or equal)[-1:], *(won[:1] or slack[-1:])]


def _where_pairs_slip(trials: Sequence[Trial]) -> tuple[float, float]:
    """Return the frequencies between which any of the trials errs, and a margin [Hz]."""
    wrong = [followed.omega[followed.error > FLOOR] for trial in trials for followed in (trial.original, trial.improved)]
    every = np.concatenate(wrong) / (2.0 * np.pi)
    if len(every) == 0:
        every = trials[0].original.omega / (2.0 * np.pi)
    margin = 0.08 * float(np.ptp(every))
    return float(every.min()) - margin, float(every.max()) + margin
