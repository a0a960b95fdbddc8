"""The command `compare`: one structure, several methods at the same frequencies, one table."""

from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from ...continuation.grid import at_frequencies
from ...library.build import Structure, build
from ...library.prepare import Prepared, prepare
from ...library.settings import by_method, reduction_settings, units_of
from ...messages.errors import CaseError, ConvergenceError
from ...messages.words import hint
from ...observe.log import RunLog
from ...parallel.agree import on_root
from ...points.branch import Branch
from ...reduction.methods import METHODS, check_modes
from ...results.measures import shown_with
from ...scene.schema import Scene
from ..log import log_of
from .report import Row, write_comparison

LARGEST_REFERENCE = 20_000  # DOF up to which `full` is the default reference


@dataclass(frozen=True)
class Request:
    """Options of the command line."""

    methods: tuple[str, ...] = ()  # empty: all that are suitable


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, options: tuple[str, ...] = ()) -> None:
    """Solve one scene by several methods at the same frequencies; print and write one table.

    Collective on ``comm``.  The reference is `full` if its size allows, else `receptance`.  Its curve, followed by arc length,
    gives the frequencies of each level; there every method, including the reference, starts from its own last two points.

    Raises
    ------
    CaseError : an unknown or unsuitable method, or too few modes for a method, before the first run; on every rank
    ConvergenceError : a method ended early, after all files were written; on every rank
    """
    methods, notes = known_methods(scene, request.methods)
    with log_of(comm, folder / "compare.log", scene, options, methods=", ".join(methods)) as log:
        for note in notes:
            log.note(note)
        structure = build(by_method(scene, "receptance"), comm, log)
        if structure.pairs.n_pairs == 0:
            raise CaseError(f"{scene.path}: [[joints]] is missing: without a joint every method is the same linear response")
        for method in methods:
            check_modes(structure, reduction_settings(by_method(structure.scene, method)))
        comparison = Comparison(structure, log)
        reference, prepared = comparison.reference("full" in methods)
        comparison.points_of(reference, prepared)
        rows = comparison.rows(reference, prepared)
        for method in methods:
            if method != reference:
                rows += comparison.rows(method, comparison.reduced(method))
        log.note(on_root(comm, write_comparison, rows, scene, str(folder)))
        log.note(f"results in {folder}")
        structure.close()
    failed = [row for row in rows if row.failure]
    if failed:
        raise ConvergenceError(
            "\n".join(f"{row.method} at {Branch(row.level, row.points, row.failure).why_ended}" for row in failed)
            + f"\nwhat converged is in {folder}"
        )


def known_methods(scene: Scene, methods: tuple[str, ...]) -> tuple[tuple[str, ...], list[str]]:
    """Return the requested methods, each once, or by default all suitable ones, and notes on the others.  Local.

    Raises
    ------
    CaseError : an unknown method, or a requested method that is not suitable for the scene
    """
    for name in methods:
        if name not in METHODS:
            raise CaseError(f"--methods: unknown method {name!r}{hint(name, METHODS, str)}; known: {', '.join(METHODS)}")
    known, notes = [], []
    for name in dict.fromkeys(methods or METHODS):
        try:
            by_method(scene, name)
            known.append(name)
        except CaseError as problem:
            if methods:
                raise
            notes.append(f"{name} is left out: {problem}")
    return tuple(known), notes


class Comparison:
    """Data shared by all methods: the structure, the range and, from the reference, the frequencies of each level."""

    def __init__(self, structure: Structure, log: RunLog):
        self.structure, self.log = structure, log
        self.omegas: dict[float, list[float]] = {}

    def reference(self, is_requested: bool) -> tuple[str, Prepared]:
        """Return the reduced model of the reference: `full` if its size allows.  Collective.

        Raises
        ------
        CaseError : `full` was requested and is too large; on every rank
        """
        if is_requested or self.structure.n_dof <= LARGEST_REFERENCE:
            try:
                return "full", self.reduced("full")
            except CaseError as reason:
                if is_requested:
                    raise
                self.log.note(f"the reference is receptance: {reason}")
        return "receptance", self.reduced("receptance")

    def reduced(self, method: str) -> Prepared:
        """Return the structure reduced by a method.  Collective."""
        with self.log.stage(f"reduction: {method}"):
            return prepare(self.structure, by_method(self.structure.scene, method), has_bars=False)

    def points_of(self, method: str, prepared: Prepared) -> None:
        """Follow the reference by arc length; its frequencies are used for every method.  Collective.

        Raises
        ------
        ConvergenceError : no second point at some level; on every rank
        """
        response, settings = prepared.response, prepared.response.settings
        with self.log.stage(f"frequencies, along the curve of {method}"):
            for level in settings.levels:
                branch, self.omegas[level] = response.frequencies_of(level)
                if len(self.omegas[level]) < 2:
                    raise ConvergenceError(f"{method} at {level:g} N: {branch.failure}")

    def rows(self, method: str, prepared: Prepared) -> list[Row]:
        """Return the results of a method at the frequencies of each level.  Collective."""
        rows, response = [], prepared.response
        units = units_of(self.structure.scene)
        shown = shown_with(response.model.harmonics.highest, units.outputs[0], units.level)
        with self.log.stage(f"response: {method}"):
            for level, omegas in self.omegas.items():
                problem, tolerance = response.at_level(level), response.settings.tolerance
                branch = at_frequencies(problem, response.selection, omegas, tolerance=tolerance)
                rows.append(Row(level, method, prepared.seconds, branch.points, branch.failure, shown))
        return rows
