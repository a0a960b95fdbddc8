"""The story of a run: one call a stage, from the scene to the response and its pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from .continuation.keeper import Keepers
from .guards.lock import locked
from .library.build import build
from .library.follow_response import follow, in_turn, known_columns
from .library.origin_of_run import origin_of
from .library.prepare import Prepared, prepare
from .library.result_files import extent_of, shapes_of, write_shapes, writer_of
from .library.settings import units_of
from .library.side_by_side import groups_that_pay
from .messages.errors import ConvergenceError
from .observe.level_log import LevelLog
from .observe.log import RunLog
from .observe.not_computed import not_computed
from .observe.stops import Stops, goes_on
from .parallel.agree import on_each, on_root
from .points.branch import Branch
from .restart.cache import cache_of
from .restart.folder import Finished, Restart
from .restart.place import RESULTS, place_of, settle
from .results.audit import audit_text
from .results.beside import Drawers
from .results.fields import RunRecord, StageRecord
from .results.measures import shown_with
from .results.origin import Origin
from .scene.schema import Scene
from .system.versions import versions
from .system.walltime import TimeLimit

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True)
class RunOptions:
    """How a scene is run, beside what it says."""

    petsc: tuple[str, ...] = ()  # options of PETSc
    n_groups: int | None = None  # of ranks, for the levels; None: as many as pay
    screen: bool = True  # or files alone
    fresh: bool = False  # anew, with the results that are there kept in a folder of their own
    limit: TimeLimit | None = None  # at which it stops, with what it has


def run(
    scene: Scene,
    comm: MPI.Comm,
    folder: Path,
    asked: RunOptions = RunOptions(),  # noqa: B008  frozen
) -> None:
    """Solve one scene, from mesh or matrices to response and pictures; go on where an earlier run in the folder was left.

    Collective on ``comm``.

    Raises
    ------
    CaseError, ResourceError : on every rank, before anything is solved or as soon as it is known
    ConvergenceError : a level ended early, after everything that converged was written and drawn; on every rank
    Interrupted : a signal or the time limit stopped the run, after everything that converged was written
    """
    with locked(comm, folder) as left:
        restart = Restart.open(comm, folder, scene, asked.petsc, asked.fresh, cache_of(folder)).noting(left)
        finished = restart.done
        if finished is not None:
            draw_again(comm, finished.place, asked.screen)
        else:
            finished = compute(restart, comm, folder, asked)
    if finished.failures:
        stays = "" if finished.place == folder else f"; the complete results of an earlier run stay in {folder}"
        raise ConvergenceError("\n".join(finished.failures) + f"\nwhat converged is in {finished.place}{stays}")


def compute(restart: Restart, comm: MPI.Comm, folder: Path, asked: RunOptions) -> Finished:
    """Compute what is left of a run, write and draw all of it, and return where it is and why levels ended early.  Collective."""
    scene, place = restart.scene, on_root(comm, place_of, folder)
    facts = {"scene": scene.source, "method": scene.solver.method, "PETSc options": " ".join(asked.petsc) or "none", **versions()}
    origin = origin_of(scene, comm)
    with goes_on(place), RunLog(comm, str(place / "run.log"), screen=asked.screen, facts=facts) as log, Drawers(comm) as drawers:
        for note in restart.notes:
            log.note(note)
        prepared = restart.prepared(log, partial(set_up, scene, comm, log))
        with log.stage("response"):
            branches = follow_logged(prepared, place, asked, origin, log, restart.keepers_of(prepared, log))
        drawers.begin(place / RESULTS, place)
        restart.share_columns(log)
        with log.stage("fields for ParaView"):
            shapes = shapes_of(prepared, branches)
        restart.share_factor(prepared, log)  # late, while processes beside draw the pictures
        with log.stage("pictures"):
            draw(comm, place, drawers, partial(write_shapes, prepared, branches, shapes, place, record_of(log)))
        prepared.close()
        failures = [f"level {branch.why_ended}" for branch in branches if branch.failure]
        final = restart.final_place(folder, place, failures)
        log.note(f"results in {final}")
    if final != place:
        on_root(comm, settle, folder, place, asked.fresh)
    return restart.finish(folder, final, failures)


def draw_again(comm: MPI.Comm, folder: Path, screen: bool) -> None:
    """Draw the pictures of a run that was computed before.  Collective."""
    with RunLog(comm, screen=screen) as log, Drawers(comm) as drawers:
        log.note(f"all of it is in {folder}, nothing is left to compute (--fresh computes it anew)")
        drawers.begin(folder / RESULTS, folder)
        with log.stage("pictures"):
            draw(comm, folder, drawers)


def draw(comm: MPI.Comm, folder: Path, drawers: Drawers, write: Callable[[], None] | None = None) -> None:
    """Draw the pictures of the results in a folder, shared among the ranks and the processes beside them.

    Collective.  Rank 0, which has the least to draw, begins with what there is to ``write``.
    """
    on_each(comm, draw_shares, folder, drawers, write if comm.rank == 0 else None)


def draw_shares(folder: Path, drawers: Drawers, write: Callable[[], None] | None) -> None:
    """Write, and draw the rank's own share of the pictures and what the processes beside it have not drawn.  Local."""
    if write is not None:
        write()
    draw_share(folder, drawers.own)
    for share in drawers.left():
        draw_share(folder, share)


def draw_share(folder: Path, share: slice) -> None:
    """Draw a share of the pictures of the results in a folder.  Local."""
    from .results.plots import draw_all  # not before: matplotlib takes a fifth of a second

    draw_all(str(folder / RESULTS), str(folder), share)


def set_up(scene: Scene, comm: MPI.Comm, log: RunLog) -> Prepared:
    """Return the structure of a scene, built and reduced.  Collective."""
    structure = build(scene, comm, log, keeps_unloaded=False)
    with log.stage("reduction"):
        return prepare(structure)


def record_of(log: RunLog) -> RunRecord:
    """Return what a log has noted so far.  Local."""
    return RunRecord(tuple(StageRecord(stage.name, stage.seconds, stage.memory) for stage in log.stages), tuple(log.notes))


def follow_logged(
    prepared: Prepared, folder: Path, asked: RunOptions, origin: Origin, log: RunLog, keepers: Keepers
) -> list[Branch]:
    """Return the branches of all levels, written and logged as they come, and say what they left out.  Collective."""
    response, units = prepared.response, units_of(prepared.scene)
    shown = shown_with(prepared.model.harmonics.highest, units.outputs[0], units.level)
    n_groups = asked.n_groups or groups_that_pay(response, prepared.outline.n_dof)
    writer = writer_of(prepared, folder, asked.petsc, replace(origin, n_groups=n_groups))
    levels, stops = LevelLog(log, response.sweep, len(response.settings.levels), shown), Stops(log, writer.save, asked.limit)
    try:
        with stops.kept():
            branches = follow(response, [levels, writer, stops], n_groups, log, keepers, keeps_motion=False)
        if not in_turn(response, n_groups) or writer.table_is_gone():
            writer.put_in_order(branches)
    finally:
        writer.close()
    log.note(audit_text(branches, units.works))
    known = known_columns(response) if in_turn(response, n_groups) else None
    log.note(
        "\n  ".join(["not computed, and why, or what it would change:", *not_computed(extent_of(prepared), branches, known)])
    )
    return branches
