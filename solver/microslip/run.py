"""A run: one call for each stage, from the scene to the response and its pictures."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from .guards.lock import locked
from .library.build import build
from .library.libraries import libraries_used
from .library.logged_response import RunOptions, follow_logged, follow_peaks_logged, record_of
from .library.origin_of_run import origin_of
from .library.result_files import notes_on_size, shapes_of, write_shapes
from .messages.errors import ConvergenceError
from .observe.log import RunLog
from .observe.stops import explaining_continuation
from .parallel.agree import on_root
from .restart.cache import cache_of
from .restart.folder import Finished, Restart
from .restart.results_folder import RESULTS, move_results, note_on_replaced, output_folder
from .results.draw import draw
from .scene.schema import Scene
from .system.versions import versions

if TYPE_CHECKING:
    from mpi4py import MPI


def run(
    scene: Scene,
    comm: MPI.Comm,
    folder: Path,
    options: RunOptions = RunOptions(),  # noqa: B008  frozen
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
        restart = Restart.open(comm, folder, scene, options.petsc, options.fresh, cache_of(folder)).noting(left)
        finished = restart.finished
        if finished is not None:
            draw_again(comm, finished.folder, options.screen)
        else:
            finished = compute(restart, comm, folder, options)
    if finished.failures:
        stays = "" if finished.folder == folder else f"; the complete results of an earlier run stay in {folder}"
        raise ConvergenceError("\n".join(finished.failures) + f"\nwhat converged is in {finished.folder}{stays}")


def compute(restart: Restart, comm: MPI.Comm, folder: Path, options: RunOptions) -> Finished:
    """Compute the remainder of a run, write and draw the results; return their folder and why levels ended early.  Collective."""
    scene, output = restart.scene, on_root(comm, output_folder, folder)
    facts = {
        "scene": scene.source,
        "method": scene.solver.method,
        "PETSc options": " ".join(options.petsc) or "none",
        **versions(),
    }
    origin = origin_of(scene, comm)
    with explaining_continuation(output), RunLog(comm, str(output / "run.log"), screen=options.screen, facts=facts) as log:
        for note in restart.notes:
            log.note(note)
        prepared = restart.prepared(log, partial(build, scene, comm, log, keeps_reference=False))
        with log.stage("response"):
            branches = follow_logged(prepared, output, options, origin, log, restart.checkpointers_of(prepared, log))
        checkpointer_of = restart.checkpointer_of_peaks(prepared, log)
        failed_peaks = follow_peaks_logged(prepared, output, options, log, checkpointer_of)
        restart.share_columns(log)
        with log.stage("fields for ParaView"):
            shapes = shapes_of(prepared, branches)
        for note in notes_on_size(prepared, branches, shapes):
            log.note(note)
        log.note(libraries_used(prepared, branches, output / RESULTS), on_screen=False)
        restart.share_factor(prepared, log)
        with log.stage("pictures"):
            draw(comm, output, partial(write_shapes, prepared, branches, shapes, output, record_of(log)))
        prepared.close()
        failures = [f"level {branch.why_ended}" for branch in branches if branch.failure] + failed_peaks
        final = restart.final_folder(folder, output, failures)
        if final != output and (replaced := on_root(comm, note_on_replaced, folder, output, options.fresh)):
            log.note(replaced)
        log.note(f"results in {final}")
    if final != output:
        on_root(comm, move_results, folder, output, options.fresh)
    return restart.finish(folder, final, failures)


def draw_again(comm: MPI.Comm, folder: Path, screen: bool) -> None:
    """Draw the pictures of a run that was computed before.  Collective."""
    with RunLog(comm, screen=screen) as log:
        log.note(f"the results in {folder} are complete, nothing is left to compute (--fresh recomputes them)")
        with log.stage("pictures"):
            draw(comm, folder)
