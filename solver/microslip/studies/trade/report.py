"""The report of a trade: table, trade.csv, sentences about each setting, and choices.  Rank 0 only."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import matplotlib
import numpy as np

from ...observe.screen_table import screen_table
from ...results.style import RC, Titled
from ...system.files import make_folder
from ..records import cell, write_csv
from .study import COMBINED, TARGETS, Curve, Run, Score, Study, score


@dataclass(frozen=True)
class Record:
    """A row of trade.csv: a run at one or all levels, and its errors."""

    run: Run
    level: str
    curves: Sequence[Curve]
    score: Score
    parameter_error: float = np.nan
    is_best: bool = False
    corrected: float = np.nan  # error of the corrected amplitude


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


COLUMNS: dict[str, tuple[str, Callable[[Record], Any]]] = {  # heading, and the value from a record
    "parameter": ("parameter", lambda of: of.run.parameter),
    "value": ("value", lambda of: of.run.value),
    "level_N": ("level N", lambda of: of.level),
    "method": ("method", lambda of: of.run.setting.method),
    "modes": ("modes", lambda of: of.run.setting.modes),
    "harmonics": ("H", lambda of: of.run.setting.harmonics),
    "samples": ("N_t", lambda of: of.run.setting.samples),
    "tolerance": ("tolerance", lambda of: of.run.setting.tolerance),
    "energy_tolerance_J": ("eps J", lambda of: _or_nan(of.run.setting.energy_tolerance)),
    "accuracy": ("accuracy", lambda of: _or_nan(of.run.setting.accuracy)),
    "unknowns": ("unknowns", lambda of: of.run.unknowns),
    "points": ("points", lambda of: sum(len(curve.omega) for curve in of.curves)),
    "setup_s": ("set-up s", lambda of: of.run.setup),
    "seconds": ("time s", lambda of: of.run.seconds),
    "cpu_s": ("CPU s", lambda of: of.run.cpu),
    "cpu_with_bars_s": ("+ bars s", lambda of: of.run.cpu_with_bars),
    "error_percent": ("error %", lambda of: 100 * of.score.error),
    "rms_percent": ("rms %", lambda of: 100 * of.score.rms),
    "own_percent": ("own %", lambda of: 100 * of.parameter_error),
    "peak_percent": ("peak %", lambda of: 100 * of.score.peak),
    "frequency_percent": ("frequency %", lambda of: 100 * of.score.frequency),
    "bar_percent": ("bar %", lambda of: 100 * of.score.bar),
    "covered_percent": ("covered %", lambda of: 100 * of.score.coverage),
    "bar_over_error": ("bar/error", lambda of: of.score.ratio),
    "on_front": ("front", lambda of: "yes" if of.is_best else ""),
    "failure": ("failure", lambda of: of.run.failure or ""),
    "corrected_percent": ("corrected %", lambda of: 100 * of.corrected),
}
SHOWN = (
    "parameter value modes harmonics samples unknowns setup_s seconds cpu_s cpu_with_bars_s error_percent corrected_percent "
    "rms_percent own_percent peak_percent bar_percent covered_percent bar_over_error on_front"
).split()


def write_trade(study: Study, scene: Titled, folder: str) -> str:
    """Write trade.csv and trade.png; return the text for the screen.  Local.

    Raises
    ------
    CaseError, ResourceError : a file cannot be written
    """
    from .speed_plots import draw_trade

    make_folder(folder)
    write_csv(f"{folder}/trade.csv", COLUMNS, records(study), 6, "")
    with matplotlib.rc_context(RC):
        draw_trade(study, scene, f"{folder}/trade.png")
    return "\n".join([table(study), *failure_lines(study), "", *summary(study)])


def summary(study: Study) -> list[str]:
    """Return the lines of the report in addition to the table."""
    return [
        *linear_lines(study),
        *reference_lines(study),
        *validation_lines(study),
        "",
        "what each parameter costs and buys, in processor time of the response:",
        *(f"  {line}" for line in (*sentences(study), *corrected_sentences(study))),
        "",
        "the front, nothing of what was run is both faster and better:",
        *(f"  {line}" for line in front_lines(study)),
        "",
        *(line for target in TARGETS for line in choice_lines(study, target)),
        *mesh_lines(study),
        *study.notes,
    ]


# -- numbers -------------------------------------------------------------------------------------------------------


def records(study: Study) -> list[dict]:
    """Return one record per run over all levels, by the names of ``COLUMNS``; for several levels also one per level."""
    front, table_rows, exact = {id(run) for run in study.front()}, list[Record](), study.reference.curves
    for run in study.ordered():
        parameter_error, is_best = study.parameter_error(run, run.parameter) if run.failure is None else np.nan, id(run) in front
        table_rows.append(
            Record(run, "all", run.curves, study.score(run), parameter_error, is_best, study.error_of_corrected(run.corrected))
        )
        for i, curve in enumerate(run.curves if len(exact) > 1 else ()):
            corrected = study.error_of_corrected(run.corrected[i : i + 1])
            table_rows.append(Record(run, f"{curve.level:g}", [curve], score([curve], exact), np.nan, is_best, corrected))
    for run in study.meshes:
        finest = {curve.level: curve for curve in study.meshes[-1].curves}
        table_rows.append(Record(run, "all", run.curves, score(run.curves, finest)))
    return [{name: of(record) for name, (_, of) in COLUMNS.items()} for record in table_rows]


# -- the table -----------------------------------------------------------------------------------------------------


def rows(study: Study) -> list[list[str]]:
    """Return the cells of the table, one row per run with points."""
    return [
        [_cell(name, record, study.reference.floor) for name in SHOWN]
        for record in records(study)
        if record["level_N"] == "all" and record["parameter"] != "mesh" and record["points"]
    ]


def failure_lines(study: Study) -> list[str]:
    """Return lines on failed runs, grouped by reason."""
    reasons: dict[str, dict[str, list[str]]] = {}
    for run in study.runs:
        if run.failure:
            reasons.setdefault(run.failure, {}).setdefault(run.parameter, []).append(run.value or str(run.setting))
    lines = []
    for reason, parameters in reasons.items():
        names = "; ".join(
            f"{parameter} {', '.join(values)}" if parameter != COMBINED else f"{len(values)} combinations"
            for parameter, values in parameters.items()
        )
        lines.append(f"{reason}: {names}")
    return lines


def _cell(name: str, record: dict, floor: float) -> str:
    value = record[name]
    if name in ("harmonics", "samples") and np.isfinite(record["accuracy"]):
        return "chosen"
    if name in ("error_percent", "corrected_percent", "own_percent", "peak_percent", "rms_percent") and value < 100.0 * floor:
        return f"< {100.0 * floor:.2g}"
    return cell(value, 3 if name in ("setup_s", "seconds", "cpu_s", "cpu_with_bars_s", "covered_percent") else 2)


def table(study: Study) -> str:
    """Return the runs as a table for the screen."""
    names, lines = [COLUMNS[name][0] for name in SHOWN], rows(study)
    heading = "errors in % of the reference's peak; set-up: modes and reduction, without what all runs share"
    return screen_table(heading, names, [(line[0], line) for line in lines], left=("parameter", "value"), close=True)


# -- sentences -----------------------------------------------------------------------------------------------------


def percent(share: float) -> str:
    """Return a fraction in per cent, with two digits."""
    return "unknown" if not np.isfinite(share) else f"{100.0 * share:.2g} %"


def linear_lines(study: Study) -> list[str]:
    """Return lines on a response without slip, and on the remaining settings."""
    if not study.is_linear:
        return []
    levels = ", ".join(f"{level:g} N" for level in study.reference.curves)
    return [
        f"no pair slips or opens at {levels}: the response is linear; harmonics, samples, tolerance and eps change nothing",
        "and were not varied: modes, method and mesh are all there is to trade; what is chosen below holds without slip",
        "",
    ]


def reference_lines(study: Study) -> list[str]:
    """Return lines on the reference and its uncertainty."""
    reference = study.reference
    lines = [
        f"reference: {reference.setting}, {sum(len(c.omega) for c in reference.curves.values())} points at "
        + ", ".join(f"{level:g} N" for level in reference.curves)
    ]
    for check in reference.checks:
        steps = ", ".join(f"{a} -> {b}: {percent(step)}" for (a, b), step in zip(pairwise(check.values), check.steps))
        lines.append(
            f"  {check.parameter} {steps}; more would change {percent(check.rest)}"
            if check.steps
            else f"  {check.parameter}: all there are"
        )
    verdict = "known to" if reference.floor <= min(TARGETS) else "known only to"
    return [
        *lines,
        f"  {verdict} {percent(reference.floor)} of the peak; smaller errors are not distinguished",
        f"  {reference.why}",
    ]


def validation_lines(study: Study) -> list[str]:
    """Return lines on the quality of the error bars."""
    validation = study.validation()
    if not validation.n_above:
        return ["error bars: no error above what the reference is known to; nothing to judge them by"]
    covered = f"{100.0 * validation.coverage:.1f} %"
    return [
        f"error bars: of {validation.n_above} points with an error above that, {covered} lie under their bar; the bar is "
        f"{validation.ratio:.2g} times the error in the median"
    ]


def sentences(study: Study) -> list[str]:
    """Return sentences on the cost and effect of each step of a setting."""
    lines = []
    for parameter in ("harmonics", "samples", "modes", "tolerance", "eps"):
        for before, after in pairwise(study.sweep(parameter)):
            lines.append(step_sentence(study, parameter, before, after))
    return [*lines, *method_sentences(study), *accuracy_sentences(study)]


def accuracy_sentences(study: Study) -> list[str]:
    """Return sentences on each run with an accuracy: error, time, and the time over that of the best fixed setting."""
    lines = []
    for run in study.complete:
        if run.setting.accuracy is not None:
            error = study.score(run).error
            text = (
                "met"
                if error + study.reference.floor <= run.setting.accuracy
                else "met within the accuracy of the reference"
                if error <= max(run.setting.accuracy, study.reference.floor)
                else "missed"
            )
            cost = f"{run.cost:.2g} s{_beside_fixed(study, run)}"
            lines.append(f"accuracy = {run.value}: {text}, error {percent(error)}, in {cost}")
    return lines


def method_sentences(study: Study) -> list[str]:
    """Return sentences on cost and error of every other method compared with the base, if it was run."""
    base = study.run_of_base
    if base is None:
        return []
    return [
        f"{run.value} instead of {base.setting.method}: {run.cost / base.cost:.2g}x the time{_more_setup(base, run)}, "
        f"error {percent(study.score(base).error)} -> {percent(study.score(run).error)}"
        for run in study.sweep("method")
    ]


def corrected_sentences(study: Study) -> list[str]:
    """Return sentences on the error of corrected amplitudes, and the number of harmonics that is as good without."""
    sweep, lines = study.sweep("harmonics"), []
    for run in sweep:
        error = study.error_of_corrected(run.corrected)
        if not np.isfinite(error) or study.score(run).error < study.reference.floor:
            continue
        errors = " -> ".join(_known(value, study) for value in (study.score(run).error, error))
        as_good = next((value for value in sweep if study.score(value).error <= max(error, study.reference.floor)), None)
        alternative = "" if as_good is None else f"; without it takes {as_good.setting.harmonics}, {as_good.cost / run.cost:.2g}x"
        text = f"harmonics {run.setting.harmonics}, corrected: error {errors}"
        lines.append(f"{text} for {run.cpu_with_bars / run.cost:.2g}x the time{alternative}")
    return lines


def _beside_fixed(study: Study, run: Run) -> str:
    """Return a text that compares the cost of a run with an accuracy, bars included, with the best fixed setting."""
    best = study.best_fixed(run.setting.accuracy or 0.0)
    if best is None:
        return ", bars included; no fixed setting that was run reaches it"
    return (
        f", bars included: {run.cost / best.cost:.2g}x that of the best fixed setting ({best.parameter} {best.value}".rstrip()
        + f"), {run.cost / best.cpu_with_bars:.2g}x with its bars"
    )


def step_sentence(study: Study, parameter: str, before: Run, after: Run) -> str:
    """Return a sentence on cost and effect of a step from one value of a setting to the next."""
    first, second = (_value(parameter, run) for run in (before, after))
    text = f"{parameter} {first} -> {second}: {after.cost / before.cost:.2g}x the time"
    text += _more_setup(before, after) if parameter == "modes" else ""
    parameter_errors = study.parameter_error(before, parameter), study.parameter_error(after, parameter)
    if parameter == "harmonics":
        return f"{text}, error {_known(parameter_errors[0], study)} -> {_known(parameter_errors[1], study)}"
    last = parameter_errors[1] == 0.0 and parameter != "eps"
    of_it = (
        f"changes {percent(parameter_errors[0])}"
        if last
        else f"its own error {percent(parameter_errors[0])} -> {percent(parameter_errors[1])}"
    )
    errors = " -> ".join(_known(study.score(run).error, study) for run in (before, after))
    return f"{text}, {of_it} (with all others of the base: {errors})"


def _more_setup(before: Run, after: Run) -> str:
    """Return a text on the longer set-up, if the difference is significant."""
    more = after.setup - before.setup
    return f", {more:+.2g} s of set-up" if abs(more) > 0.02 + 0.02 * before.setup else ""


def _value(parameter: str, run: Run) -> str:
    return f"{run.setting.energy_tolerance:g} J" if parameter == "eps" else f"{getattr(run.setting, parameter):g}"


def _known(error: float, study: Study) -> str:
    return f"below {percent(study.reference.floor)}" if error < study.reference.floor else percent(error)


def front_lines(study: Study) -> list[str]:
    """Return the runs of the Pareto front, one line each."""
    lines = []
    for run in study.front():
        lines.append(f"{run.cost:8.3g} s  error {_known(study.score(run).error, study):>14}  {run.setting}")
    return lines or ["no run reached every frequency"]


def choice_lines(study: Study, target: float) -> list[str]:
    """Return lines with the settings for an accuracy: a table for the scene, or the best alternative."""
    run, request = study.choice(target), percent(target)
    if run is not None:
        error = _known(study.score(run).error, study)
        text = f"for {request}: error {error} measured, {run.cost:.2g} s for {run.n_points} points, {run.setup:.2g} s of set-up"
        table = run.setting.table().splitlines()
        lines = [line for line in table if not (study.is_linear and line.startswith(("harmonics", "samples", "tolerance")))]
        return [text, *(f"    {line}" for line in lines), ""]
    best = study.most_accurate
    if best is None:
        return [f"for {request}: not reached: no run reached every frequency", ""]
    error, known = _known(study.sure_error(best), study), percent(study.reference.floor)
    best_of_all = f"the best is {error} by {best.setting}, {best.cost:.2g} s"
    if study.is_undecided(target):
        return [f"for {request}: not decided, the reference itself is known to {known} only; {best_of_all}; raise --seconds", ""]
    return [f"for {request}: not reached; {best_of_all}", ""]


def mesh_lines(study: Study) -> list[str]:
    """Return lines on the effect of other meshes."""
    if not study.meshes:
        return []
    finest = {curve.level: curve for curve in study.meshes[-1].curves}
    lines = [f"meshes, against the finest, {study.meshes[-1].value}; bars do not include the error of the mesh:"]
    for run in study.meshes:
        scored = score(run.curves, finest)
        errors = f"peak {percent(scored.peak)} and frequency {percent(scored.frequency)} off, curve {percent(scored.error)}"
        lines.append(f"  {run.value}: set-up {run.setup:.2g} s, response {run.seconds:.2g} s, {run.failure or errors}")
    return [*lines, ""]
