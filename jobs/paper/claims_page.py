"""The page about the paper's claims, and its picture."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from claims_runs import IMPROVED, ORIGINAL, Found, Trial, cells, judged
from matplotlib.lines import Line2D
from paper_page import percent, table
from paper_runs import ARC, EPSILON, EQUAL

from microslip.results.style import RC, WIDTH, Page

FLOOR = 1e-8  # of a difference on a logarithmic axis
ONE, OTHER = "#d55e00", "#0072b2"  # original and improved


def page(trials: Sequence[Trial], scene, command: str, minutes: float) -> str:
    """Return the page as Markdown."""
    levels = sorted({trial.level for trial in trials})
    lines = [
        "# The paper's claims, and where its order appears",
        "",
        *first_words(trials, levels),
        "",
        f"    {command}",
        "",
        f"made this page and its picture in {minutes:.0f} min, on the scene of [the case study](paper.md), `{scene.name}`, at {' and '.join(f'{level:g}' for level in levels)} N. *Original*: pairs with \u0394p \u2260 0 in the last "
        f"solution may slip (`adaptive`). *Improved*: those that lose more than {EPSILON:g} J a cycle, or open (`adaptive-energy`). Both look one point back. Errors are differences from `receptance`, all pairs, "
        "at the same frequencies, with the same harmonics and start and the scene's tolerance: the largest of any harmonic along the curve, over the peak; and of the peak itself, with its sign.",
        "",
        "![error along the curve](img/paper_claims.png)",
        "",
        "## Both updated once a point",
        "",
        *once(trials),
        "",
        "## Updated in the point",
        "",
        *again(trials),
        "",
        "## Why",
        "",
        *why(trials),
    ]
    return "\n".join(lines) + "\n"


def first_words(trials: Sequence[Trial], levels: Sequence[float]) -> list[str]:
    """Return what came out, in words."""
    n = len(trials)
    won = {method: sum(trial.better == method for trial in trials) for method in (ORIGINAL, IMPROVED)}
    mixed = [trial for trial in trials if trial.improved_again]
    crossed = [trial for trial in mixed if judged(trial.improved_again, trial.original) == IMPROVED]
    return [
        f"The paper finds its improved method more accurate than the original one. With the same update, once a point, that is so here in {won[IMPROVED]} of {n} trials; the original is the better one in "
        f"{won[ORIGINAL]}, and in {n - sum(won.values())} neither. The paper's order appears",
        "",
        f"- **where the improved method is updated in the point and the original one point late**: in {len(crossed)} of {len(mixed)} trials, all with {_steps_of(crossed)};",
        *_named(trials),
        "",
        f"It does not follow from the energy test itself: updated alike, in the point, the original method has no error beyond the solver's, and the improved one has a floor of "
        f"{_range([trial.improved_again for trial in mixed])}. No setting makes the original method's peak too low by the paper's 2.2 %: the lowest is {min(trial.original.peak for trial in trials):+.1e}.",
    ]


def _steps_of(trials: Sequence[Trial]) -> str:
    rules = {trial.setting.rule for trial in trials}
    return (
        "equal steps of frequency"
        if rules == {EQUAL}
        else "steps of the arc length"
        if rules == {ARC}
        else "steps of either rule"
    )


def _named(trials: Sequence[Trial]) -> list[str]:
    """Return an item for each setting in which the improved method is the better one with the same update."""
    names = dict.fromkeys(trial.setting.name for trial in trials if trial.better == IMPROVED)
    return [
        f"- {name}: at {', '.join(f'{trial.level:g}' for trial in trials if trial.setting.name == name and trial.better == IMPROVED)} N"
        + reason(name)
        + ";"
        for name in names
    ]


def reason(name: str) -> str:
    """Return why the improved method is the better one under a setting."""
    if "keeps |" in name:
        return ", because a test of the size of \u0394p drops pairs that slip a little in every cycle, and these carry more than those that slipped while their cycle settled"
    if "Newton" in name:
        return ", where both errors are of the size of what Newton leaves, so that their order means nothing"
    if "steps" in name:
        return ", where the step jumps over the onset of slip, both err by much, and their order is that of the points"
    return ""


def once(trials: Sequence[Trial]) -> list[str]:
    """Return the trials with the same update."""
    titles = ("level, N", "setting", "points", "original", "improved", "peak: original", "improved", "better")
    return table(titles, [cells(trial) for trial in trials])


def again(trials: Sequence[Trial]) -> list[str]:
    """Return the trials in which every point was solved again with its own set."""
    rows = [
        [
            f"{trial.level:g}",
            trial.setting.name,
            *(
                f"{found.largest:.1e}" + (" (stopped)" if found.failure else "")
                for found in (trial.original, trial.original_again, trial.improved_again)
            ),
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
        "better: improved in the point or original late",
        "both in the point",
    )
    return [
        "Every point is solved a second time, with the set that its first solution gives; the error is that of the second solution.",
        "",
        *table(titles, rows),
    ]


def why(trials: Sequence[Trial]) -> list[str]:
    """Return the reasons, with the trials that show them."""
    settled = [trial for trial in trials if trial.setting.settled]
    return [
        "A pair can slip while its cycle settles from the start of the sliders, and stick ever after: it loses nothing and holds a constant \u0394p. The original method retains it, the improved one does not. "
        "Two things follow. Its traction is missing from the balance, and its neighbours slip otherwise: the floor, which no step and no \u03b5 removes. And such a pair is nearest to slipping in every cycle: the "
        "original has it in its set before it does, and is late for fewer pairs.",
        *(
            [
                "",
                "Shown by the trial in which the original keeps pairs by their state in the kept period alone: its error, "
                + ", ".join(f"{trial.original.largest:.1e} at {trial.level:g} N" for trial in settled)
                + ", is that of the improved method, "
                + ", ".join(f"{trial.improved.largest:.1e}" for trial in settled)
                + ".",
            ]
            if settled
            else []
        ),
        "",
        "So the paper's order needs more than the energy test. That its improved set is taken in the point would be enough, and so would a test of \u0394p against a tolerance of some per cent of \u03bc N0; which of them it is, "
        "if either, the paper does not say.",
    ]


def _range(found: Sequence[Found]) -> str:
    values = [one.largest for one in found if not one.failure]
    return f"{percent(min(values))} to {percent(max(values))}" if values else "none"


def draw(trials: Sequence[Trial], scene) -> Page:
    """Draw the error along the curve at the strongest level: as in the case study, and where the paper's order appears."""
    shown = chosen(trials)
    handles = [
        Line2D([], [], color=ONE, label="original"),
        Line2D([], [], color=OTHER, label="improved"),
        Line2D([], [], color=ONE, ls=":", label="original, in the point"),
        Line2D([], [], color=OTHER, ls=":", label="improved, in the point"),
    ]
    says = f"difference from the full set over its peak ({FLOOR:g} or less at the foot), {shown[0].level:g} N"
    with matplotlib.rc_context(RC):
        sheet = Page(scene, says, WIDTH, 2.7, handles)
        axes = sheet.grid(1, len(shown)).subplots(squeeze=False, sharey=True, sharex=True)[0]
        for ax, trial in zip(axes, shown):
            for found, colour, style in (
                (trial.original, ONE, "-"),
                (trial.improved, OTHER, "-"),
                (trial.original_again, ONE, ":"),
                (trial.improved_again, OTHER, ":"),
            ):
                if found:
                    ax.plot(found.omega / (2.0 * np.pi), np.maximum(found.error, FLOOR), style, color=colour, lw=1.0)
            ax.set(yscale="log", xlabel="frequency [Hz]", ylim=(FLOOR / 2.0, 1.0))
            ax.set_title(trial.setting.name.replace("original keeps", "original keeps\n"), loc="left")
            ax.locator_params(axis="x", nbins=5)
        low, high = _where_pairs_slip(shown)
        axes[0].set_xlim(low, high)
        axes[0].set_ylabel("difference / peak")
    return sheet


def chosen(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials to draw, of the strongest level: the case study's, equal steps, and a test of the size of dp."""
    top = max(trial.level for trial in trials)
    of_level = [trial for trial in trials if trial.level == top]
    equal = [trial for trial in of_level if trial.setting.rule == EQUAL and trial.improved_again]
    crossed = [trial for trial in equal if judged(trial.improved_again, trial.original) == IMPROVED]
    slack = [trial for trial in of_level if trial.setting.slack]
    won = [trial for trial in slack if trial.better == IMPROVED]
    return [of_level[0], *(crossed or equal)[-1:], *(won[:1] or slack[-1:])]


def _where_pairs_slip(trials: Sequence[Trial]) -> tuple[float, float]:
    """Return the frequencies between which any of the trials errs, and a margin [Hz]."""
    wrong = [found.omega[found.error > FLOOR] for trial in trials for found in (trial.original, trial.improved)]
    every = np.concatenate(wrong) / (2.0 * np.pi)
    if len(every) == 0:
        every = trials[0].original.omega / (2.0 * np.pi)
    margin = 0.08 * float(np.ptp(every))
    return float(every.min()) - margin, float(every.max()) + margin
