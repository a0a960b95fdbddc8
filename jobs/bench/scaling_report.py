"""Tables of scaling.py: what was measured on one rank and on two, what ranks exchange, and the least time that more ranks take.

The work of a stage, processor time outside MPI, has three parts: that of rank 0 alone, that which every rank does, and that which
ranks share.  On P ranks a stage takes at least

    serial + replicated + shared / P

Messages and waiting come on top.  The parts follow from the work of every rank on all numbers of ranks that were run.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from page_tables import table
from scipy.optimize import nnls

KINDS = ("sums", "gathers", "messages")  # shown
ORDER = (
    "reading",
    "partition",
    "assembly",
    "factor: analysis",
    "factor",
    "modes",
    "proof of modes: analysis",
    "proof of modes",
    "reduction",
    "static columns",
    "response",
)
POINT, SET_UP = "response", "**set-up**"  # numbers of the first are those of a point
SHARED_BY = {  # what says how the shared work of a stage is divided; else evenly
    "factor": "flops",
    "proof of modes": "flops",
    "modes": "entries",
    "reduction": "entries",
    "static columns": "entries",
    "response": "pairs",
}
RANKS = (2, 4, 8, 16, 32, 64)
GAIN = 1.1  # a doubling of the ranks that is less than so many times as fast is no gain
_TRUSTED = 3.0  # weight of work on ranks with a core each over that on ranks that share them

Parts = tuple[float, float, float]  # serial, replicated and shared work [s]


def amount(run: dict, stage: str, name: str) -> np.ndarray:
    """Return a number of every rank in a stage, of the response a point; zeros where the stage was not run."""
    values = np.array(run["stages"].get(stage, {}).get(name, [0.0] * run["ranks"]))
    return values / run["points"] if stage == POINT else values


def work(run: dict, stage: str) -> np.ndarray:
    """Return the processor time outside MPI of every rank [s]."""
    return np.maximum(amount(run, stage, "cpu") - amount(run, stage, "mpi_cpu"), 0.0)


def wall(run: dict, stage: str) -> float:
    """Return the wall time of the slowest rank [s]."""
    return float(amount(run, stage, "wall").max())


def stages(runs: list[dict]) -> Iterator[str]:
    """Yield the stages that were run."""
    yield from (stage for stage in ORDER if wall(runs[0], stage) > 0.0)


# -- the least time -----------------------------------------------------------------------------------------------------


def parts_of(runs: list[dict], stage: str) -> Parts:
    """Return the parts of the work of a stage."""
    # between the many gathers of a point, ranks that share cores lose their caches: more than two say nothing
    used = [run for run in runs if stage != POINT or run["ranks"] <= 2]
    name = SHARED_BY.get(stage)
    shares = {run["ranks"]: np.array(run["shares"][name]) / sum(runs[0]["shares"][name]) for run in used if name}
    return parts_of_work({run["ranks"]: work(run, stage) for run in used}, shares)


def parts_of_work(work: dict[int, np.ndarray], shares: dict[int, np.ndarray]) -> Parts:
    """Return serial, replicated and shared work [s], none negative, that fit the work of every rank best.

    ``work`` and ``shares`` (of the shared work, even where not given) of each rank by number of ranks.  Two ranks weigh most: more
    may have shared cores, and caches.  One rank by itself counts only where two were run at most: it has no messages to prepare.
    """
    rows, values = [], []
    several = {ranks: taken for ranks, taken in work.items() if ranks > 1}
    for ranks, taken in (several if len(several) > 1 else work).items():
        share = shares.get(ranks, np.full(ranks, 1.0 / ranks))
        weight = (_TRUSTED if ranks <= 2 else 1.0) / max(float(np.mean(taken)), 1e-9) / np.sqrt(ranks)
        rows += [[weight * (rank == 0), weight, weight * share[rank]] for rank in range(ranks)]
        values += [weight * one for one in taken]
    serial, replicated, shared = nnls(np.array(rows), np.array(values))[0].tolist()
    return serial, replicated, shared


def least(parts: Parts, ranks: int) -> float:
    """Return the least time on so many ranks [s]."""
    serial, replicated, shared = parts
    return serial + replicated + shared / ranks


def gains_until(parts: Parts) -> int:
    """Return from how many ranks on a doubling no longer gains, by the least time."""
    ranks = 1
    while ranks < RANKS[-1] and least(parts, ranks) > GAIN * least(parts, 2 * ranks):
        ranks *= 2
    return ranks


# -- tables -------------------------------------------------------------------------------------------------------------


def seconds(value: float) -> str:
    """Return a time, in ms below a second."""
    return f"{value:.3g} s" if value >= 1.0 else f"{1e3 * value:.3g} ms"


def name_of(stage: str) -> str:
    return "a point of the response" if stage == POINT else stage


def measured(runs: list[dict]) -> list[str]:
    """Return the table of one rank and of two."""
    one, two = runs[:2]
    rows = []
    for stage in stages(runs):
        times = wall(one, stage), wall(two, stage)
        in_mpi = amount(two, stage, "mpi_wall") / np.maximum(amount(two, stage, "wall"), 1e-12)
        memory = [run["memory_MiB"].get(stage) for run in (one, two)]
        rows.append(
            [
                name_of(stage),
                *map(seconds, times),
                f"{times[0] / times[1]:.2f}",
                "; ".join(map(seconds, work(two, stage))),
                "; ".join(f"{100 * part:.0f} %" for part in in_mpi),
                *("" if value is None else f"{value:,.0f}" for value in memory),
            ]
        )
    titles = ("stage, times and memory", "1 rank", "2 ranks", "times as fast", "work of ranks 0; 1, outside MPI")
    return table((*titles, "in MPI, rank 0; 1", "MiB in all, 1", "2"), rows)


def messages(runs: list[dict]) -> list[str]:
    """Return the table of what ranks exchange, on two ranks and on the most that were run."""
    shown = [runs[1], *runs[2:][-1:]]
    titles = [f"{run['ranks']} ranks: {what}" for run in shown for what in (*KINDS, "kB")]
    rows = []
    for stage in stages(runs):
        cells = []
        for run in shown:
            size = sum(amount(run, stage, name).max() for name in run["stages"].get(stage, {}) if name.endswith("bytes"))
            cells += [short(amount(run, stage, f"{kind}, calls").max()) for kind in KINDS] + [short(1e-3 * size)]
        rows.append([name_of(stage), *cells])
    return table(("stage", *titles), rows)


def short(value: float) -> str:
    return "\u2013" if value == 0.0 else f"{value:,.0f}" if value >= 100 else f"{value:.2g}"


def more_ranks(runs: list[dict]) -> list[str]:
    """Return the table of the parts of the work and of the least time on more ranks."""
    parts = {stage: parts_of(runs, stage) for stage in stages(runs)}
    whole = np.sum([of for stage, of in parts.items() if stage != POINT], axis=0)
    rows = [
        [name, *map(seconds, of), *(seconds(least(of, ranks)) for ranks in RANKS), str(gains_until(of))]
        for name, of in ((name_of(stage), parts[stage]) for stage in parts)
    ]
    rows.append([SET_UP, *map(seconds, whole), *(seconds(least(whole, ranks)) for ranks in RANKS), str(gains_until(whole))])
    titles = ("least time of a stage, s", "rank 0 alone", "every rank", "shared", *(f"{ranks} ranks" for ranks in RANKS))
    return table((*titles, "gains until"), rows)


def summary(sizes: dict[str, list[dict]]) -> list[str]:
    """Return what more ranks gain for each size: the set-up and a point of the response."""
    rows = []
    for size, runs in sizes.items():
        set_up = [stage for stage in stages(runs) if stage != POINT]
        whole = np.sum([parts_of(runs, stage) for stage in set_up], axis=0)
        for what, chosen, parts in (("set-up", set_up, whole), ("a point", [POINT], parts_of(runs, POINT))):
            one, two = (sum(wall(run, stage) for stage in chosen) for run in runs[:2])
            rows.append([f"{what} of {size}", seconds(one), seconds(two), f"{one / two:.2f}", str(gains_until(parts))])
    return table(("what, times", "1 rank", "2 ranks", "times as fast (ideal: 2)", "gains until, ranks"), rows)


def tables(sizes: dict[str, list[dict]]) -> dict[str, list[str]]:
    """Return the tables of the page by name."""
    made = {"summary": summary(sizes)}
    for size, runs in sizes.items():
        made |= {f"{size}-measured": measured(runs), f"{size}-messages": messages(runs), f"{size}-more": more_ranks(runs)}
    return made
