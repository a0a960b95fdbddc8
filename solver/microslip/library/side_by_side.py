"""Levels in parallel: one model, distributed to groups of ranks that each follow different levels."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..continuation.checkpointer import Checkpointers, no_checkpoints
from ..continuation.levels import ResponseProblem, follow_level, levels_of_slip
from ..observe.log import RunLog
from ..observe.observer import Observers
from ..parallel.agree import on_root
from ..parallel.rank_groups import Counter, Reports, dealt, split
from ..points.branch import NOTHING, Branch
from ..system.watchdog import unwatched

if TYPE_CHECKING:
    from mpi4py import MPI


MOST_PAIRS = 1000  # whose columns every group may store: 72 MB, docs/parallel.md
MOST_COLUMNS = 1e8  # pairs times DOFs, up to which the columns of all pairs take a few seconds


def groups_that_pay(of: ResponseProblem, n_dof: int) -> int:
    """Return the number of groups of ranks for the levels: one for each level at which pairs slip, if there are few pairs.

    Collective: one broadcast.  Otherwise one group: the columns of all pairs, which several groups need, cost too much.
    """
    if of.model.n_pairs > min(MOST_PAIRS, MOST_COLUMNS / n_dof) or (slip := levels_of_slip(of)) is None:
        return 1
    return max(1, min(of.model.comm.size, sum(level > slip[0] for level in of.settings.levels)))


def follow_side_by_side(
    of: ResponseProblem, n_groups: int, observers: Observers, log: RunLog, checkpointers: Checkpointers = no_checkpoints
) -> list[Branch]:
    """Return the branches of all levels, in their order; the motion of the points is on rank 0.

    Collective.  A group that has finished takes the highest remaining level, because high levels
    take longest.  A level that ends early keeps its points, and the other levels continue.

    Parameters
    ----------
    n_groups : at least 2; there are no more groups than levels
    observers : are notified of levels and points on rank 0

    Raises
    ------
    MicroslipError : the error that ended a group, on the ranks of all groups
    """
    levels = of.settings.levels
    groups = split(of.model.comm, min(n_groups, len(levels)))
    log.note(f"{len(levels)} levels on {groups.n} groups of {_sizes(groups.limits)}, the highest first")
    with log.stage("static columns of all pairs"):
        of_ranks = of.on_ranks(groups.comm)
    highest_first = sorted(range(len(levels)), key=lambda number: -levels[number])
    counter, reports = Counter(groups.world), Reports(groups, observers.hear)

    def notify(*news) -> None:
        on_root(groups.comm, reports.notify, *news)

    with reports.shared_failure():
        for task in dealt(groups, counter, len(levels)):
            number = highest_first[task]
            notify("level_started", number, groups.where)
            branch = follow_level(of_ranks, levels[number], partial(notify, "point", number), checkpointers)
            notify("level_finished", number, replace(branch, points=[]))
        with unwatched():
            on_root(groups.comm, reports.finish)
    reports.free()
    counter.free()
    groups.comm.Free()
    return _shared(groups.world, observers.branches)


def _sizes(limits: np.ndarray) -> str:
    """Name the sizes of the groups."""
    sizes = sorted(set(np.diff(limits)))
    return " or ".join(map(str, sizes)) + (" rank" if sizes == [1] else " ranks")


def _shared(comm: MPI.Comm, branches: list[Branch]) -> list[Branch]:
    """Return the branches of rank 0 on every rank, without the motion on other ranks.  Collective: one broadcast."""
    light = [replace(branch, points=[replace(point, U=NOTHING, p=NOTHING) for point in branch.points]) for branch in branches]
    shared = comm.bcast(light)
    return branches if comm.rank == 0 else shared
