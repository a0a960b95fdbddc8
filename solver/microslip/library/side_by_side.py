"""Levels in parallel: one model, distributed to groups of ranks that each follow different levels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..continuation.checkpoint import Arrays
from ..continuation.checkpointer import Checkpointers, no_checkpoints
from ..continuation.divided import PARTS, Beginning, Part, beginning, coarse_curve, follow_part, joined, places
from ..continuation.levels import ResponseProblem, follow_level, levels_of_slip, whole_branch, with_peaks
from ..messages.words import counted
from ..observe.log import RunLog
from ..observe.observer import Observers
from ..parallel.rank_groups import Groups, results_of, split
from ..points.branch import NOTHING, Branch

if TYPE_CHECKING:
    from mpi4py import MPI


MOST_PAIRS = 1000  # pairs whose columns every group may store: 72 MB, docs/parallel.md
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
    log.note(f"{counted(len(levels), 'level')} on {groups.n} groups of {_sizes(groups.limits)}, the highest first")
    with log.stage("static columns of all pairs"):
        of_ranks = of.on_ranks(groups.comm)
    highest_first = sorted(range(len(levels)), key=lambda number: -levels[number])

    def whole_level(number: int, notify: Callable[..., None]) -> None:
        notify("level_started", number, groups.where)
        branch = follow_level(of_ranks, levels[number], partial(notify, "point", number), checkpointers)
        notify("level_finished", number, replace(branch, points=[]))

    results_of(groups, [partial(whole_level, number) for number in highest_first], observers.receive)
    groups.comm.Free()
    return _shared(groups.world, observers.branches)


def follow_divided(
    of: ResponseProblem, n_groups: int, observers: Observers, log: RunLog, checkpointers: Checkpointers = no_checkpoints
) -> list[Branch]:
    """Return the branches of all levels, in their order, each divided into parts that the groups follow at the same time.

    Collective.  Parameters, motion and errors as of :func:`follow_side_by_side`, but for the number of groups, which may be any.
    A level whose parts do not join is followed again as a whole, by all ranks.
    """
    comm, levels = of.model.comm, of.settings.levels
    groups = split(comm, n_groups)
    log.note(f"each level divided among {groups.n} group{'s' * (groups.n > 1)} of {_sizes(groups.limits)}")
    with log.stage("static columns of all pairs"):
        of_ranks = of.on_ranks(groups.comm)
    branches = []
    for number, level in enumerate(levels):
        checkpointer = checkpointers(comm, level, 0)
        observers.notify("level_started", number, groups.where)
        branch, on_point = checkpointer.finished(), partial(observers.notify, "point", number)
        if branch is not None and branch.failure is not None:
            branch = whole_branch(of, level, on_point, checkpointers)  # with its further segments
        elif branch is not None:
            for point in branch.points:
                on_point(point)
        else:
            branch = _divided(of_ranks, level, groups, partial(observers.receive, "point", number))
            if branch is None:
                log.note("  its parts do not join: followed as a whole")
                observers.branches[number].points.clear()
                observers.notify("level_started", number)
                branch = whole_branch(of, level, on_point, checkpointers)
            else:
                observers.branches[number].points[:] = branch.points  # in their order
                checkpointer.save(of.task(level), None, branch.points)
                checkpointer.finish(branch)
        branches.append(with_peaks(of, branch, checkpointers))
        observers.notify("level_finished", number, branch)
    groups.comm.Free()
    return branches


def _divided(of_ranks: ResponseProblem, level: float, groups: Groups, on_point: Callable[..., None]) -> Branch | None:
    """Return a level [N] joined from its parts; None where they do not join.  Collective on ``groups.world``."""
    world = groups.world

    def curve_of_level(notify: Callable[..., None]) -> list[Arrays]:
        return coarse_curve(of_ranks, level)

    def begin(i: int, notify: Callable[..., None]) -> Beginning | None:
        return beginning(of_ranks, level, curve, i)

    def part(k: int, notify: Callable[..., None]) -> Part:
        return follow_part(of_ranks, level, beginnings, k, notify)

    (curve,) = world.bcast(results_of(groups, [curve_of_level]))
    begun = world.bcast(results_of(groups, [partial(begin, i) for i in places(curve, PARTS * groups.n)]))
    beginnings = [each for each in begun if each is not None]
    parts = results_of(groups, [partial(part, k) for k in range(len(beginnings) + 1)], on_point)
    branch = joined(parts) if world.rank == 0 else None
    is_joined = world.bcast(branch is not None)
    return _shared(world, [branch or Branch(level)])[0] if is_joined else None


def _sizes(limits: np.ndarray) -> str:
    """Name the sizes of the groups."""
    sizes = sorted(set(np.diff(limits)))
    return " or ".join(map(str, sizes)) + (" rank" if sizes == [1] else " ranks")


def _shared(comm: MPI.Comm, branches: list[Branch]) -> list[Branch]:
    """Return the branches of rank 0 on every rank, without the motion on other ranks.  Collective: one broadcast."""
    light = [replace(branch, points=[replace(point, U=NOTHING, p=NOTHING) for point in branch.points]) for branch in branches]
    shared = comm.bcast(light)
    return branches if comm.rank == 0 else shared
