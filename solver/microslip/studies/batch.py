"""Runs of several scenes: one group of ranks runs each scene, from its mesh to its pictures."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

from ..guards.ending import conclude_part
from ..guards.overdue import pass_on_to_first
from ..messages.errors import CaseError, Interrupted
from ..parallel.rank_groups import Counter, Groups, dealt, split
from ..run import RunOptions, run
from ..scene.schema import Scene
from ..system.signals import obey_signals
from ..system.watchdog import unwatched


def run_scenes(scenes: Sequence[Scene], comm: MPI.Comm, out: Path, options: RunOptions) -> int:
    """Run scenes in parallel groups of ranks, or in sequence with one group; return the worst exit status.

    Collective on ``comm``.  Each scene writes to ``out``/NAME.  A group that has finished a scene takes the next one.  A failed
    scene is reported and stops no other scene; after a signal, or near the time limit, no further scene begins.

    Raises
    ------
    CaseError : two scenes have the same name; on every rank, before the first run
    """
    names = [scene.name for scene in scenes]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise CaseError(f"two scenes are called {twice!r}, and both would write to {out / twice}; rename one of the files")
    groups, counter, statuses = split(comm, min(options.n_groups or 1, len(scenes))), Counter(comm), [0]
    obey_signals(groups.is_root)
    pass_on_to_first(groups.comm)
    for number in dealt(groups, counter, len(scenes)):
        statuses.append(_run(scenes[number], groups, out / names[number], options))
        if statuses[-1] == Interrupted.exit_status:
            break
    with unwatched():
        counter.free()
    return max(statuses)


def _run(scene: Scene, groups: Groups, folder: Path, options: RunOptions) -> int:
    """Run one scene on this rank's group and return its exit status.  Collective on ``groups.comm``.

    With several groups the screen shows one line at the begin and one at the end of a scene; run.log has the rest.
    """
    is_alone, began = groups.n == 1, time.perf_counter()
    if groups.is_root and not is_alone:
        print(f"{scene.name}: begun on {groups.where}", flush=True)
    options = replace(options, n_groups=None if is_alone else 1, divides=options.divides and is_alone, screen=is_alone)
    status = conclude_part(groups.comm, scene.name, lambda: run(scene, groups.comm, folder, options))
    if groups.is_root and not is_alone:
        how = "done" if status == 0 else f"ended with status {status}"
        print(f"{scene.name}: {how} after {time.perf_counter() - began:.3g} s, see {folder}", flush=True)
    return status
