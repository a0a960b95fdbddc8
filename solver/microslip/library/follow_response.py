"""Follow the levels of a prepared structure, one after the other or in parallel on groups of ranks."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..continuation.checkpointer import Checkpointers, no_checkpoints
from ..continuation.levels import ResponseProblem, follow_levels, levels_of_slip
from ..messages.words import counted, rounded
from ..observe.log import RunLog
from ..observe.observer import Observer, Observers
from ..points.branch import Branch
from .side_by_side import follow_divided, follow_side_by_side

_AT_ONCE = 1e-6  # of the highest level: from there on means from the first newton on


def follow(
    response: ResponseProblem,
    observers: Iterable[Observer] = (),
    n_groups: int = 1,
    log: RunLog | None = None,
    checkpointers: Checkpointers = no_checkpoints,
    keeps_motion: bool = True,
    divides: bool = False,
) -> list[Branch]:
    """Return the branches of all levels, in their order; the motion of the points is on rank 0, if it is to be stored.

    Collective on the model's communicator.  ``observers`` are notified of levels and points; ``checkpointers`` save them,
    so that a later run does not compute them again.

    Raises
    ------
    MicroslipError : on every rank; a level that ends early raises nothing, its branch has the reason
    """
    comm, n_pairs = response.model.comm, response.model.n_pairs
    all_observers, log = Observers(comm, response.settings.levels, observers, keeps_motion), log or RunLog(comm, screen=False)
    if (slip := levels_of_slip(response)) is not None:
        log.note(_in_words(slip, max(response.settings.levels)))
    if not in_turn(response, n_groups, divides):
        in_groups = follow_divided if divides else follow_side_by_side
        return in_groups(response, n_groups, all_observers, log, checkpointers)
    branches = follow_levels(response, all_observers.notify, checkpointers)
    per_diameter = response.model.receptances
    for d in per_diameter.groups if n_pairs else ():
        if per_diameter.knows(d):
            columns, where = per_diameter.of_group(d).static.G_static, f" of nodal diameter {d}" * (len(per_diameter.groups) > 1)
            number, batches = f"{columns.known.sum()} of {counted(n_pairs, 'pair')}", counted(columns.batches, "batch")
            log.note(f"static columns{where}: of {number}, in {batches}")
    return branches


def _in_words(levels: np.ndarray, highest: float) -> str:
    """Return for the log the levels (n_pairs,) [N] from which pairs slip; pairs that are open or slide at rest have 0 or less."""
    n_at_once = np.count_nonzero(levels <= _AT_ONCE * highest)
    half, later = levels[(len(levels) - 1) // 2], levels[n_at_once:]
    of_half = f", half of all from {rounded(half)} N" if np.isfinite(half) and half > _AT_ONCE * highest else ""
    if n_at_once:
        at_next = f"; the next slips from about {rounded(later[0])} N on{of_half}" if len(later) and np.isfinite(later[0]) else ""
        return f"by the linear peak, pairs that slip or are open at any level: {n_at_once} of {len(levels)}{at_next}"
    if not np.isfinite(levels[0]):
        return "by the linear peak, no pair slips at any level"
    summary = f"by the linear peak, pairs slip from about {rounded(levels[0])} N on{of_half}"
    return summary if highest > levels[0] else f"{summary}; the highest level is {highest:g} N, where nothing does"


def in_turn(response: ResponseProblem, n_groups: int, divides: bool = False) -> bool:
    """Return whether all ranks follow one level after the other.  Local."""
    if divides and response.model.n_pairs > 0:
        return False
    return min(n_groups, len(response.settings.levels)) == 1


def known_columns(response: ResponseProblem) -> np.ndarray:
    """Return the pairs whose static columns were solved for, (n_pairs,) bool.  Local."""
    structures = [response.model, *([] if response.enriched is None else [response.enriched.structure])]
    known = [columns.known for structure in structures for columns in structure.static_columns]
    return np.logical_or.reduce(known)
