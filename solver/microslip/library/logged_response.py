"""The levels of a run: continuation with log, files and limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from ..continuation.checkpointer import Checkpointer, Checkpointers
from ..observe.level_log import LevelLog, over_lines
from ..observe.log import RunLog
from ..observe.not_computed import not_computed
from ..observe.stops import Stops
from ..parallel.agree import on_root
from ..points.branch import Branch
from ..results.audit import audit_text
from ..results.fields import RunRecord, StageRecord
from ..results.measures import shown_with
from ..results.origin import Origin
from ..results.over import store_peaks_over
from ..results.read import read_results
from ..results.record import PeaksOver
from ..results.sensitivities import write_sensitivities
from ..system.walltime import TimeLimit
from .build import WholeStructure
from .follow_response import follow, in_turn, known_columns
from .mode_at_rest import note_on_mode
from .peak_curves import followed, numbers_of, refuse_without_peaks
from .prepare import Prepared
from .result_files import extent_of, head_of, writer_of
from .sectors import levels_by_sector, write_by_sector
from .sensitivities import varied_numbers
from .settings import units_of
from .side_by_side import groups_that_pay


@dataclass(frozen=True)
class RunOptions:
    """Options of a run that the scene does not state."""

    petsc: tuple[str, ...] = ()  # options of PETSc
    n_groups: int | None = None  # of ranks, for the levels; None: chosen by the program
    divides: bool = False  # whether the groups share each level, instead of having levels of their own
    screen: bool = True  # or files alone
    fresh: bool = False  # recompute; earlier results move to ``earlier-N/``
    limit: TimeLimit | None = None  # at which the run stops with the results so far


def _write_sensitivities(prepared: Prepared, folder: Path) -> None:
    """Write the table of sensitivities from the levels on the disk.  Local, on rank 0."""
    results = read_results(str(folder / "results.h5"), motion=False)
    write_sensitivities(str(folder), results, varied_numbers(prepared.scene, prepared.pairs))


def record_of(log: RunLog) -> RunRecord:
    """Return the entries of a log so far.  Local."""
    return RunRecord(tuple(StageRecord(stage.name, stage.seconds, stage.memory) for stage in log.stages), tuple(log.notes))


def follow_peaks_logged(
    prepared: Prepared, folder: Path, options: RunOptions, log: RunLog, checkpointer_of: Callable[[int, int], Checkpointer]
) -> list[str]:
    """Follow peaks over the numbers of the scene, write and log them; return why curves ended early.  Collective.

    ``checkpointer_of`` returns the checkpointer of a number and of a peak of the linear response, both by their order.
    """
    comm, curves, failures = prepared.model.comm, list[PeaksOver](), list[str]()
    numbers = numbers_of(prepared)
    if not numbers:
        return []
    names = [output.name for output in prepared.scene.outputs]
    saved = "the next run continues from this point"  # which its checkpointer has saved before
    stops = Stops(log, lambda: None, options.limit, saved)
    for k, number in enumerate(numbers):
        with log.stage(f"peaks over {number.key}"):
            of_number = followed(prepared, number, partial(on_root, comm, stops.point, k, 0), partial(checkpointer_of, k))
        for line in (line for curve in of_number for line in over_lines(curve, names[curve.linear.output])):
            log.note(line)
        failures += [f"peaks over {curve.key}: {curve.points.failure}" for curve in of_number if curve.points.failure]
        curves += of_number
        on_root(comm, store_peaks_over, str(folder), head_of(prepared), curves)
    return failures


def follow_logged(
    prepared: Prepared, folder: Path, options: RunOptions, origin: Origin, log: RunLog, checkpointers: Checkpointers
) -> list[Branch]:
    """Return the branches of all levels, written and logged while computed; log the omitted parts.  Collective."""
    response, units = prepared.response, units_of(prepared.scene)
    refuse_without_peaks(prepared)
    for note in note_on_mode(prepared):
        log.note(note)
    shown = shown_with(prepared.model.harmonics.highest, units.outputs[0], units.level)
    n_groups = options.n_groups or (
        response.model.comm.size if options.divides else groups_that_pay(response, prepared.structure.n_dof)
    )
    writer = writer_of(prepared, folder, options.petsc, replace(origin, n_groups=n_groups))
    names = tuple(output.name for output in prepared.scene.outputs)
    levels = LevelLog(log, response.sweep, len(response.settings.levels), shown, names)
    stops = Stops(log, writer.save, options.limit)
    try:
        with stops.saving_if_interrupted():
            branches = follow(response, [levels, writer, stops], n_groups, log, checkpointers, False, options.divides)
        if not in_turn(response, n_groups, options.divides) or writer.table_is_gone():
            writer.put_in_order(branches)
    finally:
        writer.close()
    log.note(audit_text(branches, units.works))
    if response.settings.sensitivities:
        on_root(prepared.model.comm, _write_sensitivities, prepared, folder)
    if isinstance(prepared.structure, WholeStructure):
        by_sector = levels_by_sector(prepared, branches)
        on_root(prepared.model.comm, write_by_sector, by_sector, folder, share=False)
        for level in by_sector or ():
            log.note(level.in_words())
    known = known_columns(response) if in_turn(response, n_groups, options.divides) else None
    log.note(
        "\n  ".join(["not computed, and why, or what it would change:", *not_computed(extent_of(prepared), branches, known)])
    )
    return branches
