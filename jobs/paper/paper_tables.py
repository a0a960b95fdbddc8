"""The measured tables of docs/paper.md."""

from __future__ import annotations

import machine
import numpy as np
from page_tables import duration, percent, small, table, times
from paper_runs import EPSILON, EQUAL, Level, Run, Study, errors, idle, peak_error

from microslip.contact.law import OPEN, SLIP, STICK

PEAK_ERROR = 2.2e-2  # of the original method at the paper's highest level, over Rubin
GAINS = "1.00, 1.18, 2.07, 2.38"  # of the paper's improved method over its original one, by level
NOT_MEASURED = "\u2013"
LARGE_LOSS = 1e-4  # J a cycle and pair


def tables(study: Study) -> dict[str, list[str]]:
    """Return the tables of the page by name."""
    made = {
        "summary": summary(study),
        "response": of_levels(study, RESPONSE),
        "original": of_levels(study, ORIGINAL),
        "states": of_levels(study, STATES),
        "size": of_levels(study, SIZE),
        "speed": of_levels(study, SPEED),
        "improved": of_levels(study, IMPROVED, study.slipping),
        "energy": of_levels(study, ENERGY, study.slipping),
        "tolerance": tolerance(study),
        "step": steps(study),
        "methods": of_levels(study, METHODS, study.levels[::-1]),
        "rubin": of_levels(study, WITH_RUBIN),
        "dense": of_levels(study, DENSE),
        "machine": [f"- {line}" for line in machine.lines(machine.facts())],
        "parts": parts(study),
    }
    return made


def of_levels(study: Study, columns: dict, levels: list[Level] | None = None) -> list[str]:
    """Return a table with a row per level; ``columns`` has the function of each cell by title."""
    chosen = study.levels if levels is None else levels
    rows = [[f"{level.level:g}", *(cell(study, level) for cell in columns.values())] for level in chosen]
    return table(("level, N", *columns), rows)


# -- columns by title: a cell of a study and a level --------------------------------------------------------------------


def per_newton(study: Study, level: Level) -> str:
    first = study.levels[0]
    return f"{level.reference.amplitude.max() / level.level / (first.reference.amplitude.max() / first.level):.3f}"


def largest(run: Run, level: Level) -> float:
    """Return the largest difference of a run from the reference on the curve."""
    return float(errors(run, level.reference).max())


def of_rubin(level: Level) -> str:
    """Return the difference of plain Rubin at the peak, where it was solved."""
    if not level.rubin:
        return NOT_MEASURED
    at = level.reference.points[level.reference.peak].response
    return f"{np.abs(level.rubin.response[0] - at).max() / np.abs(at).max():.1e}"


def off(level: Level) -> str:
    late = errors(level.adaptive, level.reference)
    return f"{np.count_nonzero(late > 1e-6)} of {len(late)}"


def at_peak(level: Level):
    """Return the reference's point at the peak."""
    return level.reference.points[level.reference.peak]


def in_state(level: Level, state: int) -> str:
    return str(int(np.count_nonzero(at_peak(level).state == state)))


def range_with_slip(level: Level) -> float:
    """Return the share of the range of frequencies in which a pair slips or opens."""
    frequency = level.reference.frequency
    moving = frequency[level.reference.retained > 0]
    return float(np.ptp(moving) / np.ptp(frequency)) if len(moving) else 0.0


def idle_pairs(study: Study, level: Level) -> str:
    pairs = idle(study, level)
    return f"{pairs.idle} of {pairs.moving}, {percent(pairs.idle / max(pairs.moving, 1))}"


def difference_of_losses(level: Level) -> str:
    """Return the largest difference of the friction loss of both methods over the largest loss."""
    original, improved = (np.array([point.friction for point in run.points]) for run in (level.adaptive, level.improved))
    n = min(len(original), len(improved))
    return percent(float(np.abs(original[:n] - improved[:n]).max() / max(original.max(), 1e-300)))


def idlers_retained(level: Level) -> str:
    """Return the share of the pairs that the original retains, over all points, that lose less than epsilon."""
    retained = level.adaptive.carries
    idlers = retained & (np.array([point.energy for point in level.adaptive.points]) <= EPSILON)
    return percent(float(idlers.sum() / max(retained.sum(), 1)))


RESPONSE = {
    "points": lambda study, level: str(len(level.reference.points)),
    "peak, mm": lambda study, level: f"{1e3 * level.reference.amplitude.max():.4g}",
    "at Hz": lambda study, level: f"{level.reference.frequency[level.reference.peak]:.5g}",
    "per newton, over the stuck peak": per_newton,
    "friction at the peak, mJ a cycle": lambda study, level: f"{1e3 * at_peak(level).friction:.3g}",
}
ORIGINAL = {
    "difference of the original, largest": lambda study, level: small(largest(level.adaptive, level)),
    "of the peak": lambda study, level: small(abs(peak_error(level.adaptive, level.reference))),
    "points off by more than 1e-6": lambda study, level: off(level),
    "checked: largest": lambda study, level: small(largest(level.checked, level)),
    "plain Rubin at the peak": lambda study, level: of_rubin(level),
}
STATES = {
    "stick": lambda study, level: in_state(level, STICK),
    "slip": lambda study, level: in_state(level, SLIP),
    "open": lambda study, level: in_state(level, OPEN),
}
SIZE = {
    "least": lambda study, level: f"{level.adaptive.unknowns.min():,}",
    "mean": lambda study, level: f"{level.adaptive.unknowns.mean():,.0f}",
    "most after the first point": lambda study, level: f"{level.adaptive.unknowns[1:].max():,}",
    "most over plain Rubin": lambda study, level: f"{level.adaptive.unknowns[1:].max() / study.rubin_size:.3f}",
}
SPEED = {
    "a step": lambda study, level: times(speed_of_step(study, level)),
    "the level": lambda study, level: times(speed_of_level(study, level)),
    "a step, dense algebra on both sides": lambda study, level: times(speed_dense(study, level)),
}
IMPROVED = {
    "largest difference: original": lambda study, level: small(largest(level.adaptive, level)),
    "improved": lambda study, level: small(largest(level.improved, level)),
    "of the peak: original": lambda study, level: small(peak_error(level.adaptive, level.reference), "+.1e"),
    "of the peak: improved": lambda study, level: small(peak_error(level.improved, level.reference), "+.1e"),
}
ENERGY = {
    "loss at the peak, mJ a cycle": lambda study, level: f"{1e3 * at_peak(level).energy.sum():.3g}",
    "of the strongest pair": lambda study, level: f"{1e3 * at_peak(level).energy.max():.2g}",
    "pairs above 1e-4 J": lambda study, level: str(np.count_nonzero(at_peak(level).energy > LARGE_LOSS)),
    "pairs below \u03b5 with \u0394p \u2260 0": idle_pairs,
    "difference of the losses": lambda study, level: difference_of_losses(level),
}
METHODS = {
    "improved": lambda study, level: duration(level.improved.total("cpu")),
    "Newton steps of the improved": lambda study, level: f"{newton(level.improved):,}",
    "original": lambda study, level: duration(level.adaptive.total("cpu")),
    "Newton steps of the original": lambda study, level: f"{newton(level.adaptive):,}",
    "points": lambda study, level: str(len(level.adaptive.points)),
    "speed-up a step": lambda study, level: f"{gain_of_step(study, level):.2f}",
    "with dense algebra": lambda study, level: f"{gain_dense(study, level):.2f}",
    "speed-up of the level": lambda study, level: f"{level.adaptive.total('cpu') / level.improved.total('cpu'):.2f}",
}
WITH_RUBIN = {
    "points": lambda study, level: str(len(level.reference.points)),
    "Newton steps of the full set": lambda study, level: f"{newton(level.reference):,}",
    "Rubin: a step": lambda study, level: duration(rubin_step(study)),
    "Rubin: the level": lambda study, level: duration(newton(level.reference) * rubin_step(study)),
    "adaptive: unknowns, mean": lambda study, level: f"{level.adaptive.unknowns.mean():,.0f}",
    "Newton steps": lambda study, level: f"{newton(level.adaptive):,}",
    "adaptive: a step": lambda study, level: duration(a_step(level.adaptive)),
    "adaptive: the level": lambda study, level: duration(level.adaptive.total("cpu")),
    "speed-up a step": lambda study, level: times(speed_of_step(study, level)),
    "speed-up of the level": lambda study, level: times(speed_of_level(study, level)),
    "`receptance`: the level": lambda study, level: duration(level.reference.total("cpu")),
    "speed-up of `receptance`": lambda study, level: times(
        newton(level.reference) * rubin_step(study) / level.reference.total("cpu")
    ),
}
DENSE = {
    "Rubin: one LU": lambda study, level: duration(float(study.lu_seconds(study.rubin_size))),
    "adaptive: one LU, mean": lambda study, level: duration(
        dense_seconds(study, level.adaptive) / max(newton(level.adaptive), 1)
    ),
    "speed-up a step": lambda study, level: times(speed_dense(study, level)),
    "Rubin: the level": lambda study, level: duration(newton(level.reference) * float(study.lu_seconds(study.rubin_size))),
    "adaptive: the level": lambda study, level: duration(dense_seconds(study, level.adaptive)),
    "speed-up of the level": lambda study, level: times(
        newton(level.reference) * float(study.lu_seconds(study.rubin_size)) / dense_seconds(study, level.adaptive)
    ),
}


# -- tables with rows of another kind -----------------------------------------------------------------------------------


def summary(study: Study) -> list[str]:
    """Return the paper's numbers and those measured here."""
    first, last, top = study.levels[0], study.levels[-1], (study.slipping or study.levels)[-1]
    rows = [
        ("error of the peak, original, by level", f"-{percent(PEAK_ERROR)} at 8 N", peaks(study, "adaptive")),
        ("the same at the fewest equal steps of frequency", NOT_MEASURED, coarsest(study)),
        ("error of the peak, improved, by level", "none left", peaks(study, "improved")),
        ("largest difference with all pairs checked in the point, any \u03b5", NOT_MEASURED, small(checked(study), ".0e")),
        ("dense Newton over all pairs at the strongest peak", NOT_MEASURED, dense_newton(study)),
        ("curves whose largest difference comes at or before the peak", NOT_MEASURED, early(study)),
        (
            "speed-up of the original over Rubin, a step, lowest and highest level",
            "120x, 36x",
            _both(speed_of_step, study, first, last),
        ),
        ("the same with dense algebra on both sides", "120x, 36x", _both(speed_dense, study, first, last)),
        ("speed-up of the improved over the original, an evaluation, by level", GAINS, gains(study, gain_of_step)),
        ("the same with dense algebra on both sides", GAINS, gains(study, gain_dense)),
        ("pairs with \u0394p \u2260 0 that \u03b5 removes at the strongest peak", "54, some 40 %", idle_pairs(study, top)),
        ("the largest constant traction of such a pair, over \u03bc N0", NOT_MEASURED, f"{traction(study):.2g}"),
        ("share of the range with slip, slipping levels", NOT_MEASURED, range_of_slip(study)),
        ("pairs retained over all points of the strongest level: original, improved", NOT_MEASURED, retained(top)),
        ("share of the original's that lose less than \u03b5", NOT_MEASURED, idlers_retained(top)),
        ("most unknowns at the strongest level: original, improved", NOT_MEASURED, most_unknowns(top)),
        ("seconds of the strongest level: original, improved", "2272.6, 831.3", seconds_of(top.adaptive, top.improved)),
        ("seconds of the strongest level, `receptance`", NOT_MEASURED, seconds_of(top.reference)),
        ("seconds with the largest \u03b5: unchecked, checked; `adaptive`, checked", NOT_MEASURED, seconds_checked(top)),
    ]
    return table(("what", "the paper", "here"), rows, words=2)


def peaks(study: Study, name: str) -> str:
    """Return the error of the peak of a method by level."""
    return ", ".join(small(peak_error(getattr(level, name), level.reference), "+.0e") for level in study.levels)


def coarsest(study: Study) -> str:
    """Return the error of the peak of the original with the fewest points, at equal steps of frequency."""
    equal = [step for step in study.steps if step.rule == EQUAL and not step.failure]
    fewest = min((step.requested for step in equal), default=0)
    coarsest = [step for step in equal if step.requested == fewest]
    return ", ".join(f"{100.0 * step.at_peak:+.1f} % at {step.level:g} N" for step in coarsest) or NOT_MEASURED


def checked(study: Study) -> float:
    """Return the largest difference of any run with all pairs checked at each point."""
    return max(
        (largest(run, level) for level in study.slipping for run in (level.checked, *level.energy_checked.values())), default=0.0
    )


def dense_newton(study: Study) -> str:
    """Return the difference of dense Newton over all pairs from the reference, if solved."""
    solved = [level for level in study.levels if level.condensed]
    pairs = [(level.condensed.response[0], at_peak(level).response) for level in solved]
    return small(max(np.abs(dense - ours).max() / np.abs(dense).max() for dense, ours in pairs), ".0e") if pairs else NOT_MEASURED


def early(study: Study) -> str:
    """Return the number of curves of the improved method whose largest difference is at or before the peak."""
    at = [
        int(np.argmax(errors(run, level.reference))) <= level.reference.peak
        for level in study.slipping
        for run in level.energy.values()
    ]
    return f"{sum(at)} of {len(at)}"


def _both(ratio, study: Study, *levels: Level) -> str:
    return ", ".join(times(ratio(study, level)) for level in levels)


def gains(study: Study, gain) -> str:
    return ", ".join(f"{gain(study, level):.2f}" for level in study.levels)


def range_of_slip(study: Study) -> str:
    widths = [range_with_slip(level) for level in study.slipping] or [0.0]
    return f"{percent(min(widths))} to {percent(max(widths))}"


def traction(study: Study) -> float:
    return max((idle(study, level).traction for level in study.slipping), default=0.0)


def retained(level: Level) -> str:
    return f"{level.adaptive.carries.sum():,}, {level.improved.carries.sum():,}"


def most_unknowns(level: Level) -> str:
    return f"{level.adaptive.unknowns[1:].max():,}, {level.improved.unknowns[1:].max():,}"


def seconds_checked(level: Level) -> str:
    eps = max(level.energy_checked)
    return seconds_of(level.energy[eps], level.energy_checked[eps], level.checked)


def seconds_of(*runs: Run) -> str:
    return ", ".join(f"{run.total('cpu'):.3g}" for run in runs)


def tolerance(study: Study) -> list[str]:
    """Return error, size and dropped pairs, by level and tolerance."""
    rows = []
    for level in study.slipping:
        runs = {f"{NOT_MEASURED} (\u0394p \u2260 0)": level.adaptive, **{f"{eps:g}": run for eps, run in level.energy.items()}}
        for name, run in runs.items():
            at = min(level.reference.peak, len(run.points) - 1)
            rows.append(
                [
                    f"{level.level:g}",
                    name + (" (stopped)" if run.failure else ""),
                    f"{largest(run, level):.1e}",
                    NOT_MEASURED if run.failure else f"{peak_error(run, level.reference):+.1e}",
                    f"{run.unknowns.mean():,.0f}",
                    f"{run.unknowns[1:].max():,}",
                    str(run.retained[at]),
                    str(run.dropped[at]),
                    percent(share_lost(run)),
                ]
            )
    titles = ("level, N", "\u03b5, J", "difference, largest", "of the peak", "unknowns, mean", "most", "pairs in B at the peak")
    return table((*titles, "assumed stuck with \u0394p \u2260 0", "their friction loss, largest, over that of all"), rows)


def share_lost(run: Run) -> float:
    """Return the largest friction loss of dropped pairs at a point, over the largest of all pairs at a point."""
    friction = np.array([point.friction for point in run.points])
    return float(run.lost.max() / max((friction + run.lost).max(), 1e-300))


def steps(study: Study) -> list[str]:
    """Return the error of the original method by rule and number of points."""
    rows = [
        [
            f"{step.level:g}",
            step.rule,
            str(step.requested),
            f"{step.solved}{' (stopped)' if step.failure else ''}",
            f"{step.spacing:.3g}",
            f"{step.largest:.1e}",
            NOT_MEASURED if step.failure else f"{abs(step.at_peak):.1e}",
        ]
        for step in study.steps
    ]
    titles = ("level, N", "rule", "points requested", "solved", "Hz between points at the peak", "difference, largest")
    return table((*titles, "of the peak"), rows)


def parts(study: Study) -> list[str]:
    """Return processor time and memory of each part of the study."""
    rows = [[name, f"{seconds:.1f}", f"{mebibytes:,.0f}"] for name, (seconds, mebibytes) in study.parts.items()]
    return table(("part", "s", "peak MiB until its end"), rows)


# -- steps and their times ----------------------------------------------------------------------------------------------


def newton(run: Run) -> int:
    return int(run.total("newton"))


def a_step(run: Run) -> float:
    """Return the processor time of a Newton step [s]."""
    return run.total("cpu") / max(newton(run), 1)


def rubin_step(study: Study) -> float:
    """Return the processor time of a Newton step of plain Rubin [s]; if not solved, of one LU of its size."""
    rows = [level.rubin for level in study.levels if level.rubin and sum(level.rubin.newton)]
    if not rows:
        return float(study.lu_seconds(study.rubin_size))
    return sum(sum(row.cpu) for row in rows) / sum(sum(row.newton) for row in rows)


def speed_of_step(study: Study, level: Level) -> float:
    """Return how many times less processor time a Newton step of `adaptive` takes than one of plain Rubin."""
    return rubin_step(study) / a_step(level.adaptive)


def speed_of_level(study: Study, level: Level) -> float:
    """Return the same of the whole level; plain Rubin's is the time of its step times the steps of the full set."""
    return newton(level.reference) * rubin_step(study) / level.adaptive.total("cpu")


def dense_seconds(study: Study, run: Run) -> float:
    """Return the seconds of one dense LU in every Newton step of a run, of the size of its model there."""
    return float(np.sum(np.array(run.row.newton) * study.lu_seconds(run.unknowns)))


def speed_dense(study: Study, level: Level) -> float:
    """Return the ratio of one LU of plain Rubin to the mean one of `adaptive`."""
    return float(study.lu_seconds(study.rubin_size)) * max(newton(level.adaptive), 1) / dense_seconds(study, level.adaptive)


def gain_of_step(study: Study, level: Level) -> float:
    """Return how many times cheaper a Newton step of the improved method is than one of the original."""
    return a_step(level.adaptive) / a_step(level.improved)


def gain_dense(study: Study, level: Level) -> float:
    """Return how many times cheaper one dense LU per step is in the improved method than in the original."""
    original, improved = (dense_seconds(study, run) / max(newton(run), 1) for run in (level.adaptive, level.improved))
    return original / improved
