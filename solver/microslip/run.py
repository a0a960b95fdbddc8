"""The story of a run: one call a stage, from the scene to the response and its pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .continuation.branch import Branch
from .library.build import build
from .library.files import write_shapes, writer_of
from .library.follow import follow, in_turn, known_columns
from .library.prepare import Prepared, prepare
from .library.settings import units_of
from .observe.level_log import LevelLog
from .observe.log import RunLog
from .observe.not_computed import not_computed
from .parallel.agree import on_each
from .parallel.errors import ConvergenceError
from .parallel.versions import versions
from .results.audit import audit_text
from .results.fields import RunRecord, StageRecord
from .results.measures import shown_with
from .results.plots import draw_all
from .scene.schema import Scene

if TYPE_CHECKING:
    from mpi4py import MPI


def run(
    scene: Scene, comm: MPI.Comm, folder: Path, options: tuple[str, ...] = (), n_groups: int = 1, screen: bool = True
) -> None:
    """Solve one scene, from mesh or matrices to response and pictures.

    Collective on ``comm``, whose ranks part into ``n_groups`` for the levels.  Without ``screen`` only files are written.

    Raises
    ------
    CaseError, ResourceError : on every rank, before anything is solved or as soon as it is known
    ConvergenceError : a level ended early, after everything that converged was written and drawn; on every rank
    """
    facts = {"scene": scene.source, "method": scene.solver.method, "PETSc options": " ".join(options) or "none", **versions()}
    with RunLog(comm, str(folder / "run.log"), screen=screen, facts=facts) as log:
        structure = build(scene, comm, log)
        with log.stage("reduction"):
            prepared = prepare(structure)
        with log.stage("response"):
            branches = follow_logged(prepared, folder, options, n_groups, log)
        with log.stage("fields for ParaView"):
            write_shapes(prepared, branches, folder, record_of(log))
        with log.stage("pictures"):
            on_each(comm, draw_all, str(folder / "results.h5"), str(folder), slice(comm.rank, None, comm.size))
        log.note(f"results in {folder}")
        structure.close()
    failed = [branch for branch in branches if branch.failure]
    if failed:
        raise ConvergenceError(
            "\n".join(f"level {branch.level:g} N ends after {len(branch.points)} points: {branch.failure}" for branch in failed)
            + f"\nwhat converged is in {folder}"
        )


def record_of(log: RunLog) -> RunRecord:
    """Return what a log has noted so far.  Local."""
    return RunRecord(tuple(StageRecord(stage.name, stage.seconds, stage.memory) for stage in log.stages), tuple(log.notes))


def follow_logged(prepared: Prepared, folder: Path, options: tuple[str, ...], n_groups: int, log: RunLog) -> list[Branch]:
    """Return the branches of all levels, written and logged as they come, and say what they left out.  Collective."""
    response, units = prepared.response, units_of(prepared.scene)
    shown = shown_with(prepared.model.harmonics.highest, units.outputs[0], units.level)
    writer = writer_of(prepared, folder, options)
    levels = LevelLog(log, response.sweep, len(response.settings.levels), shown)
    try:
        branches = follow(response, [levels, writer], n_groups, log)
        if not in_turn(response, n_groups):
            writer.put_in_order(branches)
    finally:
        writer.close()
    log.note(audit_text(branches, units.works))
    known = known_columns(response) if in_turn(response, n_groups) else None
    log.note("\n  ".join(["not computed, and why, or what it would change:", *not_computed(prepared, branches, known)]))
    return branches
