"""The levels of a run: continuation with log, files and limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ..continuation.checkpointer import Checkpointer, Checkpointers
from ..fourier.coefficients import amplitude
from ..observe.level_log import LevelLog, over_lines
from ..observe.log import RunLog
from ..observe.not_computed import not_computed
from ..observe.stops import Stops
from ..parallel.agree import on_root
from ..points.branch import Branch, Point
from ..points.peak import Peak, top_of_curve
from ..results.audit import audit_text
from ..results.fields import RunRecord, StageRecord
from ..results.measures import shown_with
from ..results.origin import Origin
from ..results.over import store_peaks_over
from ..results.read import read_results
from ..results.record import PeaksOver
from ..results.sensitivities import write_sensitivities
from ..results.table import write_table
from ..system.walltime import TimeLimit
from .build import WholeStructure
from .follow_response import follow, in_turn, known_columns
from .mode_at_rest import note_on_mode
from .peak_curves import followed, numbers_of, refuse_without_peaks
from .prepare import Prepared, prepare
from .result_files import extent_of, head_of, writer_of
from .sensitivities import varied_numbers
from .settings import output_names, units_of
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
    stages = (StageRecord(stage.name, stage.seconds, stage.memory, stage.depth) for stage in log.summary())
    return RunRecord(tuple(stages), tuple(log.notes))


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
    names = output_names(prepared.scene)
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
    names = output_names(prepared.scene)
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


FILE = "sectors.csv"
COLUMNS = ("level", "sector", "peak", "frequency_Hz", "amplification", "friction_J")


@dataclass(frozen=True, eq=False)
class LevelBySector:
    """One level: the largest amplitude of harmonic 1 of the first output in each sector; alike sectors have one."""

    level: float
    peak: np.ndarray  # (N,) in the output's unit
    frequency: np.ndarray  # (N,) Hz, of each
    friction: np.ndarray  # (N,) J, friction loss of the pairs of each sector, a cycle, at the peak of the sector that moves most
    alike: float  # peak of the disc with alike sectors

    @property
    def amplification(self) -> np.ndarray:
        """The peaks over that of alike sectors, (N,)."""
        return self.peak / self.alike

    @property
    def localisation(self) -> float:
        """Share of the sector that moves most in the sum of squares of the peaks: 1/N to 1."""
        return float(self.peak.max() ** 2 / np.sum(self.peak**2))

    def in_words(self) -> str:
        """Return a line for the log."""
        N, most = len(self.peak), int(np.argmax(self.peak))
        return (
            f"sectors at {self.level:g}: sector {most} moves most, {self.peak[most]:.4e} at {self.frequency[most]:.6g} Hz, "
            f"{self.amplification[most]:.4g} times alike sectors ({self.alike:.4e}; Whitehead's bound of one family of modes, "
            f"(1 + sqrt(N)) / 2 = {whitehead(N):.3g}); {100.0 * self.localisation:.3g} % of the sum of squares of all peaks"
        )


def whitehead(N: int) -> float:
    """Return the largest amplification in a linear disc of N blades with one family of modes.  Local."""
    return 0.5 * (1.0 + float(np.sqrt(N)))


def levels_by_sector(prepared: Prepared, branches: Sequence[Branch]) -> list[LevelBySector] | None:
    """Return the results of all levels by sector, on rank 0; None elsewhere.

    Collective: the response of alike sectors at the same levels, with solved peaks and without error bars.

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : on every rank
    """
    structure = prepared.structure
    assert isinstance(structure, WholeStructure), "a whole disc"
    of_alike = prepare(structure.alike, has_bars=False).response
    settings = replace(of_alike.settings, peaks=1 in of_alike.model.harmonics, stability=False, sensitivities=False)
    alike = follow(replace(of_alike, settings=settings))
    N, n_outputs = structure.waves.n_sectors, len(prepared.scene.outputs)
    return on_root(prepared.model.comm, _by_sector, branches, alike, N, n_outputs, share=False)


def _by_sector(branches: Sequence[Branch], alike: Sequence[Branch], N: int, n_outputs: int) -> list[LevelBySector]:
    """Return the results of the levels that have points.  Rank 0."""
    levels = []
    for branch, other in zip(branches, alike):
        if not (branch.points and other.points):
            continue
        omega = np.array([point.omega for point in branch.points])
        sizes = np.array([amplitude(point.response[::n_outputs]) for point in branch.points])  # (n_points, N)
        tops = np.array([top_of_curve(omega, of_sector) for of_sector in sizes.T])
        most = branch.points[int(np.argmax(sizes[:, np.argmax(tops[:, 1])]))]
        levels.append(
            LevelBySector(
                level=branch.level,
                peak=tops[:, 1],
                frequency=tops[:, 0] / (2.0 * np.pi),
                friction=most.energy.reshape(N, -1).sum(axis=1),
                alike=max(_largest(point) for point in (*other.points, *(other.peaks or ()))),
            )
        )
    return levels


def _largest(at: Point | Peak) -> float:
    """Return the amplitude of the first output; 0 at a peak of another one.  Local."""
    if isinstance(at, Peak):
        return abs(at.amplitude) if at.output == 0 else 0.0
    return float(amplitude(at.response[0]))


def write_by_sector(levels: Sequence[LevelBySector], folder: Path) -> None:
    """Write a row for each level and sector.  Rank 0.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    rows = (
        [f"{each.level:.10g}", s, *(f"{value:.10g}" for value in row)]
        for each in levels
        for s, row in enumerate(zip(each.peak, each.frequency, each.amplification, each.friction))
    )
    write_table(str(folder / FILE), COLUMNS, rows)
