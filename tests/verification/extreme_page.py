"""docs/extremes.md and its pictures from the outcomes of the battery."""

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

COMMAND = "PYTHONPATH=solver:tests python tests/verification/extremes.py --docs docs"
COLOURS = {SOLVED: "tab:green", REFUSED: "tab:blue", FAILED: "tab:orange", WRONG: "tab:red", DEFECT: "k"}
ABOUT = """
Each case is a small scene of matrices run by the stages of `microslip run`, one of its dimensions, or a random combination, at the end of its range. Every point that
comes back is judged by an evaluation of its own (`tests/oracles/point_check.py`): from M, C, K, R, loads and pair parameters alone, with dense algebra refined in extended
precision and its own march of the contact law, none of it the program's. A case is **solved** if every level reached the end of its range and every point passed, and so did what the case
expects besides (the linear, frictionless or open structure, the exact Jenkins mass, or itself in other units to 1e-9); **refused** if the program said
before any point why it would not; **failed** if a branch ended early with a reason, the points it kept being judged like all others; **wrong** if a returned point, or the expectation, is off
without a word; **defect** if the program broke down or did not end.
"""
ERRORS = """
Errors of a point, each relative, and its bound: {bounds}. `motion` compares the motion of the pairs with that of the full matrices under the returned forces at every harmonic; `force` is what the law at the returned
motion leaves unbalanced, over the forces; `law` the returned forces against the march; `energy` the closure of work, viscous and friction loss, and `reported` the three against the program's; then `|T| - mu N`
at every sample, tension, and negative loss of a pair over the most its friction could do and over (2 / N_t)^2, the error of the law's samples.
"""
LIMITS = """
## Limits

The structures are small; modes are not left out except in the methods' own bases, so that truncation is no part of this page ([validation](validation.md) measures it). The judge marches
the same law along the same straight lines between samples, by formulas of its own: the error of that against continuous time is measured there as well. A point passes if it is *a* solution: where several exist, which one a branch reaches is that of its
continuation. A level whose branch from the start of its range ended early is followed from the other end as well, and counts as solved where that covers the range; {segments} cases have such a level. Points with the mean slip held by springs (theory, section 5) say so and are judged but for the mean friction force that the springs change; there were {held} of {points}.

**What has no answer.** Damping that feeds energy in, stiffness or mass below zero: no vibration is steady. Resonance without damping: the motion is infinite. A body that neither its springs nor its joint hold: K_L is singular, and any place of the body balances the loads.
Two of the random cases that fail, 7 and 13, have none either, in the end: a body with gaps in all of its contacts, which nothing else holds. Once it has lifted off for all of the cycle its force is zero wherever it is; its mean runs away (to $10^6$ m and more, beside vibrations of 1 m and of 49 m; in case 13 no point that was kept
has a normal force of more than $10^{{-4}}$ N under loads of 45 and 93 N) until the program refuses the point or Newton fails.

**Resonances that nothing holds.** Two frames whose joint lifts off, without damping or damped by $10^{{-6}}$, have a resonance at which motion is infinite, or too high for the digits there are. Their branches are followed up to it, in places to motions $10^5$ times as large as anywhere else, and begin anew beyond it, with a note (theory, section 7). The peak itself is no point.

**What fails.** Friction without bound (mu = 1e6) on pairs that lift off, where a touch of pressure holds everything: forces change by all there is over a millionth of the motion, and the branch turns back at a corner each time. Such a corner can be met by bisection along the tangent, and the piece beyond it followed within that millionth; that
was tried and passes every one of them, but solves none of these cases: without preload the branches then lead out of the range at both ends (begun further off they do the same), and the chain that lifts off far goes through closed loops of corners, 3000 points long. A joint some 10,000 times stiffer than its structure, far beyond its limit of slip
(random 28): Newton stands still at one corner after the other, and small steps, which lead the 3-D pair with k_t = 1e6 past its own, do not there. Levels, bands and numbers of points were chosen, family by family, so that a curve begins below the resonance without the joint and has some tens of points: begun between the
folds of a resonance, or with steps of half a curve, more of them end with the message that a fold leads back.
"""


def write_page(docs: str, outcomes: list, seconds: float, processes: int) -> None:
    """Write extremes.md, img/extremes.png and img/fold.png into a folder."""
    folder = Path(docs)
    (folder / "img").mkdir(parents=True, exist_ok=True)
    folds = fold.draw(folder / "img")
    draw(outcomes, folder / "img" / "extremes.png")
    counts = Counter(outcome.status for outcome in outcomes)
    expected = sum(outcome.expected for outcome in outcomes)
    points, held = (sum(getattr(outcome, name) for outcome in outcomes) for name in ("n_points", "held"))
    answered = sum(outcome.has_answer for outcome in outcomes)
    by_rule = sum(outcome.expected and outcome.has_answer for outcome in outcomes)
    first = (
        f"How far can a scene be driven to the ends of every range before the program fails, and can what it returns there be trusted? "
        f"Of {len(outcomes)} such cases {len(outcomes) - answered} have no answer, and a rule on what may be asked for refuses {by_rule} "
        f"(a range far above all modes, a load in a harmonic that is left out); of the other {answered - by_rule} it solved {counts[SOLVED]} "
        f"({100 * counts[SOLVED] / (answered - by_rule):.1f} %; {100 * counts[SOLVED] / answered:.1f} % of all that have an answer). It refused "
        f"{counts[REFUSED]} ({expected} as expected) and failed with a reason on {counts[FAILED]}. Of {points} returned points each was judged "
        f"from the matrices alone: **{counts[WRONG]} cases wrong without a word, {counts[DEFECT]} defects.** In the picture every case is a dot, "
        "and right of the dotted line it would be wrong."
    )
    lines = [
        first,
        "",
        "![Largest unbalanced force of every case, family by family](img/extremes.png)",
        *ABOUT.splitlines(),
        *table(outcomes),
        *ERRORS.format(bounds=", ".join(f"{name} {bound:g}" for name, bound in BOUNDS.items())).splitlines(),
        *not_solved(outcomes),
        "",
        "## Folds, forward and backward",
        "",
        "One mass on a spring with a contact in its way, 7 harmonics and 512 samples, swept over the same range both ways (`fold.py`, test_mpi_fold.py on one and two ranks).",
        "",
        "![Both folds, swept up and down](img/fold.png)",
        "",
        *[f"- {line}" for line in folds],
        *LIMITS.format(held=held, segments=sum(outcome.in_segments for outcome in outcomes), points=points).splitlines(),
    ]
    facts = {**machine.facts(), "date": f"{datetime.date.today():%Y-%m-%d}", **load(outcomes, seconds, processes)}
    (folder / "extremes.md").write_text(machine.page("Extremes", lines, [f"`{COMMAND}`", *machine.lines(facts)]))


def load(outcomes: list, seconds: float, processes: int) -> dict[str, str]:
    """Return how busy the machine was, so that a time means something."""
    return {
        "time": f"{seconds:.0f} s of wall clock for {sum(outcome.cpu for outcome in outcomes):.0f} s of processor on {processes} processes "
        f"(load average of the last quarter of an hour {os.getloadavg()[2]:.1f})"
    }


def table(outcomes: list) -> list[str]:
    """Return the families, a row each."""
    rows = [
        "| family | cases | solved | refused | failed | wrong | points | largest motion | force | law | energy | processor s |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for family in dict.fromkeys(outcome.family for outcome in outcomes):
        mine = [outcome for outcome in outcomes if outcome.family == family]
        counts = Counter(outcome.status for outcome in mine)
        worst = [
            max((outcome.errors.get(name, 0.0) for outcome in mine), default=0.0) for name in ("motion", "force", "law", "energy")
        ]
        rows.append(
            f"| {family} | {len(mine)} | {counts[SOLVED]} | {counts[REFUSED]} | {counts[FAILED]} | {counts[WRONG] + counts[DEFECT]} | "
            f"{sum(outcome.n_points for outcome in mine)} | "
            + " | ".join(f"{error:.0e}" for error in worst)
            + f" | {sum(outcome.cpu for outcome in mine):.0f} |"
        )
    return ["", *rows]


def not_solved(outcomes: list) -> list[str]:
    """Return the list of every case that was not solved, with the program's own words."""
    lines = [
        "",
        "## Every case that was not solved",
        "",
        "| case | outcome | points kept | in the program's words |",
        "| --- | --- | ---: | --- |",
    ]
    for outcome in outcomes:
        if outcome.status != SOLVED:
            words = outcome.words.split("/scene.toml: ")[-1].splitlines()[0].replace("|", "\\|") if outcome.words else ""
            what = outcome.status + ("" if not outcome.expected else ", by a rule" if outcome.has_answer else ", has no answer")
            lines.append(f"| {outcome.name} | {what} | {outcome.n_points} | {words} |")
    return lines


def draw(outcomes: list, path: Path) -> None:
    """Draw the largest force residual of every case, a row a family, coloured by what became of it."""
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
