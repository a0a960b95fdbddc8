"""The page about the paper's claims, and its picture."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from claims_runs import IMPROVED, ORIGINAL, REFERENCE, Own, Trial, cells, judged
from matplotlib.lines import Line2D
from paper_page import PEAK_ERROR, percent, table
from paper_runs import ARC, EPSILON, EQUAL

from microslip.results.style import RC, WIDTH, Page

PAPER_POINTS = 98  # a level
FLOOR = 1e-8  # of a difference on a logarithmic axis
ONE, OTHER = "#d55e00", "#0072b2"  # original and improved


def page(trials: Sequence[Trial], own: Sequence[Own], scene, command: str, minutes: float) -> str:
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
        "## Each method in its own steps",
        "",
        *own_steps(own),
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
    alike = sum(judged(trial.improved_again, trial.original_again) == ORIGINAL for trial in mixed)
    below = min(trial.original.peak for trial in trials)
    return [
        f"The paper finds its improved method more accurate than the original one. With the same update, once a point, that is so here in {won[IMPROVED]} of {n} trials; the original is the better one in "
        f"{won[ORIGINAL]}, and in {n - sum(won.values())} neither. The paper's order appears",
        "",
        f"- **where the improved method is updated in the point and the original one point late**: in {len(crossed)} of {len(mixed)} trials, {_steps_of(crossed)}{_example(crossed)};",
        *_named(trials),
        "",
        f"It does not follow from the energy test itself. Where both are updated in the point the original is the better one in {alike} of {len(mixed)} trials. Nor does any setting put the original's peak too "
        f"low by the paper's {percent(PEAK_ERROR)}: the lowest is {below:+.1e}, and where it is far off it is too high, as a pair held stuck takes no energy.",
    ]


def _steps_of(trials: Sequence[Trial]) -> str:
    rules = {trial.setting.rule for trial in trials}
    return f"all with {EQUAL}" if rules == {EQUAL} else f"all with {ARC}" if rules == {ARC} else "with either rule of steps"


def _example(crossed: Sequence[Trial]) -> str:
    """Return the trial with the paper's number of points at the highest level, and that whose peak is off as the paper's."""
    if not crossed:
        return ""
    like = max(
        (trial for trial in crossed if trial.setting.points == PAPER_POINTS), key=lambda trial: trial.level, default=crossed[-1]
    )
    off = min(crossed, key=lambda trial: abs(np.log(max(abs(trial.original.peak), 1e-15) / PEAK_ERROR)))
    return (
        f". With {like.setting.points} points and {like.level:g} N the original errs by {percent(like.original.largest)} on the curve and the improved one by "
        f"{percent(like.improved_again.largest)}; with {off.setting.points} points and {off.level:g} N the peak of the original is off by {off.original.peak:+.1e} and that of the improved one by "
        f"{off.improved_again.peak:+.1e}. That is the size of the {percent(PEAK_ERROR)} that the paper sees vanish"
    )


def _named(trials: Sequence[Trial]) -> list[str]:
    """Return an item for each setting in which the improved method is the better one with the same update."""
    won = [trial for trial in trials if trial.better == IMPROVED]
    at = {trial.setting.name: [f"{other.level:g}" for other in won if other.setting == trial.setting] for trial in won}
    return [f"- **{name}**: at {' and '.join(at[name])} N, {reason(one(won, name))};" for name in at]


def one(trials: Sequence[Trial], name: str) -> Trial:
    return next(trial for trial in trials if trial.setting.name == name)


def reason(trial: Trial) -> str:
    """Return why one method is the better one in a trial, or neither."""
    setting, wins = trial.setting, trial.better
    if setting.settled:
        return "the test of the kept period keeps what the energy test keeps" if wins == "\u2013" else "the two tests differ"
    if setting.slack and wins == IMPROVED:
        return "pairs with less \u0394p slip in every cycle and carry more than those that \u03b5 drops"
    if setting.slack:
        return "pairs with less \u0394p carry less than those that \u03b5 drops"
    if setting.tolerance and wins == IMPROVED:
        return "Newton may leave as much as either errs, and their order means nothing"
    if setting.rule == EQUAL and wins == "\u2013":
        return "the step jumps over the onset of slip, for both alike"
    if setting.rule == EQUAL and wins == IMPROVED:
        return "the step jumps over the onset of slip, and their order is that of the points"
    if setting.rule == EQUAL:
        return "both are late, the improved one for more pairs"
    if wins == ORIGINAL:
        return "steps are short where slip sets in: little is late, and what \u03b5 drops is missing"
    return "little is late by either, and \u03b5 drops nothing that is missed"


def once(trials: Sequence[Trial]) -> list[str]:
    """Return the trials with the same update."""
    titles = ("level, N", "setting", "points", "original", "improved", "peak: original", "improved", "better", "because")
    return table(titles, [[*cells(trial), reason(trial)] for trial in trials])


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
            *(f"{found.peak:+.1e}" for found in (trial.original, trial.improved_again)),
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
        "improved in the point",
        "better: improved in the point or original late",
        "both in the point",
    )
    return [
        "Every point is solved a second time, with the set that its first solution gives; the error is that of the second solution. Where steps are coarse one such round does not yet settle the set: the check in the "
        "point of `adaptive` goes on until it does.",
        "",
        *table(titles, rows),
    ]


def own_steps(own: Sequence[Own]) -> list[str]:
    """Return the highest points of curves that do not share their frequencies."""
    if not own:
        return ["Not run."]
    methods = (REFERENCE, ORIGINAL, IMPROVED)
    lowest = min(one.peak[ORIGINAL] for one in own)
    reference = min(one.peak[REFERENCE] for one in own)
    rows = [
        [
            f"{one.level:g}",
            str(one.asked),
            *(str(one.solved[method]) for method in methods),
            *(f"{one.peak[method]:+.1e}" for method in methods),
        ]
        for one in own
    ]
    return [
        f"The highest point of a curve lies beside its true peak. Where every method goes its own steps, as in a continuation, the highest points differ by that too: against the highest point of the full set's "
        f"finest curve the full set itself is up to {percent(abs(reference))} too low and the original method {percent(abs(lowest))}. So a peak that is lower than Rubin's need not say anything of the method.",
        "",
        *table(
            (
                "level, N",
                "points asked for",
                "points: full set",
                "original",
                "improved",
                "highest: full set",
                "original",
                "improved",
            ),
            rows,
        ),
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
        f"So the paper's order needs more than the energy test. Taking the improved method's set in the point would be enough{_crossing(trials)}; which of them it is, if either, the paper does not say.",
    ]


def _crossing(trials: Sequence[Trial]) -> str:
    """Return from which size of dp on its test is worse than the energy test at every level."""
    sizes = sorted({trial.setting.slack for trial in trials if trial.setting.slack})
    won = [all(trial.better == IMPROVED for trial in trials if trial.setting.slack == size) for size in sizes]
    if not any(won):
        return ""
    first = won.index(True)
    between = f"between {100 * sizes[first - 1]:g} and {100 * sizes[first]:g} %" if first else f"of {100 * sizes[0]:g} % or less"
    return f", and so would a test of \u0394p that takes for stuck what is smaller than a threshold {between} of \u03bc N0"


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
            ax.set_title(trial.setting.name.replace("original keeps ", "original keeps\n"), loc="left")
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
