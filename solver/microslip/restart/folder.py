"""The folder with the checkpoints of a run.

    restart/identity         the inputs of the last run
    restart/setup-KEY/       the stuck structure: set_up.py, stored_structure.py
    restart/level-KEY/       of; points.S, state.S.0, state.S.1, end.S of each segment S of a level, peak, bifurcation
    restart/over-KEY/        points.0, state.0.0, state.0.1, end.0 of a curve of peaks over a number
    restart/mode-KEY/        the same of a nonlinear mode

Each key is a hash of everything that the part depends on (identity.py), so that any part that exists can be used.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ..continuation.checkpointer import Checkpointer, Checkpointers
from ..library.build import Structure
from ..library.peak_curves import numbers_of
from ..library.prepare import Prepared, prepare
from ..observe.log import RunLog
from ..parallel.agree import on_each, on_root
from ..points.sweep import Sweep
from ..scene.schema import Scene
from ..system.files import file_errors, make_folder
from .branch_files import BranchFiles
from .cache import Cache
from .identity import Identity, identity_of
from .records import Disk, checked_read, read_record, write_record, write_unsynced
from .results_folder import RESULTS, TABLE, UNFINISHED, is_checkpoint
from .set_up import SetUp
from .stored_disc import StoredDisc

NAME = "restart"
_FILES = ("identity", "done")


@dataclass(frozen=True)
class Finished:
    """A finished run: the folder of its results, and the reasons of early ends of levels."""

    folder: Path
    failures: list[str]


@dataclass(eq=False)
class Restart:
    """The checkpoints of a run.  All methods except those on paths are collective on ``comm``.

    Raises
    ------
    CaseError, ResourceError : of every method, on every rank, where files cannot be read or written
    """

    comm: MPI.Comm
    path: Path
    scene: Scene
    identity: Identity  # identity of this run
    notes: tuple[str, ...]  # existing checkpoints, and differences of their inputs
    finished: Finished | None = None  # outcome if the same run is finished; None: points remain to be computed
    cache: Cache | None = None  # cache of set-ups shared by runs
    fresh: bool = False  # no checkpoint is used
    _used: set[str] = field(default_factory=set)  # names of folders that this run has used; on rank 0
    _disk: Disk = field(default_factory=Disk)  # of all journals
    _set_ups: list[SetUp] = field(default_factory=list)  # of this run

    @classmethod
    def open(
        cls,
        comm: MPI.Comm,
        folder: Path,
        scene: Scene,
        options: tuple[str, ...] = (),
        fresh: bool = False,
        shared: Path | None = None,
    ) -> Restart:
        """Return the checkpoints in the folder of a run, none if ``fresh``; ``shared`` is the cache of set-ups, if any."""
        path = folder / NAME
        identity, notes, finished = on_root(comm, checked_read, path, _opened, path, scene, options, fresh)
        is_whole = scene.cyclic is not None and scene.cyclic.whole
        cache = None if shared is None else Cache(comm, shared, identity.setup if is_whole else identity.structure)
        return cls(comm, path, scene, identity, notes, finished, cache, fresh)

    def noting(self, more: Iterable[str]) -> Restart:
        """Return a copy with further notes in front.  Local."""
        return replace(self, notes=(*more, *self.notes))

    # -- the structure -----------------------------------------------------------------------------------------------

    def prepared(self, log: RunLog, build: Callable[[], Structure]) -> Prepared:
        """Return the prepared structure, from this folder, from the cache or by ``build``; in the latter cases it is stored."""
        path, cyclic = self.path / f"setup-{self.identity.setup}", self.scene.cyclic
        self._used.add(path.name)
        set_up = SetUp(self.comm, path, self.cache, self.scene, log, self._disk, self.fresh)
        if cyclic is None:
            self._set_ups = [set_up]
            structure = set_up.structure(build)
        else:
            disc = StoredDisc(set_up)
            self._set_ups, structure = disc.set_ups, disc.structure()
        with log.stage("reduction"):
            prepared = prepare(structure)
        if cyclic is None:
            set_up.store(structure, prepared.reduction.basis)
        return prepared

    def share_columns(self, log: RunLog) -> None:
        """Store the static columns of this run in the cache, and structures that have more data than before again."""
        for set_up in self._set_ups:
            if problem := set_up.share_columns():
                log.note(problem)

    def share_factor(self, prepared: Prepared, log: RunLog) -> None:
        """Store the factor in the cache, if this run has one that the cache lacks."""
        structure = prepared.structure
        if self.cache is None or structure.factored.value is None or self.scene.cyclic is not None:
            return
        if not self.cache.factor.is_wanted(structure.factor):
            return
        with log.stage("factor for other runs"):
            problem = self.cache.share_factor(structure.factor)
        if problem:
            log.note(problem)

    # -- the levels --------------------------------------------------------------------------------------------------

    def checkpointers_of(self, prepared: Prepared, log: RunLog) -> Checkpointers:
        """Return the checkpointers of the levels of a response, which log the branches that they restore.  Local."""
        n_modes = prepared.structure.n_modes

        sweep = prepared.response.sweep

        def checkpointer(comm: MPI.Comm, level: float, segment: int) -> Checkpointer:
            folder, branch = self.path / self._level(level, n_modes), self.identity.branch(level, n_modes)
            on_root(comm, _sign, folder, branch, sweep)
            other_ranges = partial(_of_branch, self.path, branch) if segment == 0 else list
            return BranchFiles(comm, folder, segment, log.note, other_ranges, self._disk)

        self._used |= {self._level(level, n_modes) for level in prepared.response.settings.levels}
        return checkpointer

    def checkpointer_of_peaks(self, prepared: Prepared, log: RunLog) -> Callable[[int, int], Checkpointer]:
        """Return the function that gives the checkpointer of a number and a peak over it, both by index.  Local."""
        n_modes, numbers = prepared.structure.n_modes, numbers_of(prepared)

        def checkpointer(number: int, peak: int) -> Checkpointer:
            name = f"over-{self.identity.over(number, peak, numbers[number].request.level, n_modes)}"
            self._used.add(name)
            return BranchFiles(self.comm, self.path / name, 0, log.note, disk=self._disk)

        return checkpointer

    def checkpointer_of_mode(self, prepared: Prepared, number: int, farthest: float | None, log: RunLog) -> Checkpointer:
        """Return the checkpointer of a nonlinear mode, which logs the restored points.  Local."""
        name = f"mode-{self.identity.mode(number, farthest, prepared.structure.n_modes)}"
        self._used.add(name)
        return BranchFiles(self.comm, self.path / name, 0, log.note, disk=self._disk)

    def _level(self, level: float, n_modes: int) -> str:
        return f"level-{self.identity.level(level, n_modes)}"

    # -- the end -----------------------------------------------------------------------------------------------------

    def final_folder(self, folder: Path, output: Path, failures: list[str]) -> Path:
        """Return the final folder of the results: ``output`` if levels ended early and ``folder`` has complete results."""
        stays = bool(failures) and not self.fresh and on_root(self.comm, _has_complete_results, folder)
        return output if stays else folder

    def finish(self, folder: Path, output: Path, failures: list[str]) -> Finished:
        """Record that the run is finished, with results in ``output``; remove unused checkpoints of other scenes."""
        on_each(self.comm, self._wait)
        on_root(self.comm, self._finish, folder, output, failures)
        return Finished(output, failures)

    def _wait(self) -> None:
        """Wait until all files of this rank are on the disk."""
        with file_errors(str(self.path)):
            self._disk.wait()

    def _finish(self, folder: Path, output: Path, failures: list[str]) -> None:
        record = {"of": self.identity.whole, "results": _hash(output / RESULTS), "failures": failures}
        if output != folder:
            record |= {"place": output.name, "complete": _hash(folder / RESULTS)}
        write_record(self.path / "done", {}, record)
        self._remove_unused()

    def tidy(self) -> None:
        """Wait for the disk, and remove unused checkpoints of other scenes; of a study, whose results are no run's."""
        on_each(self.comm, self._wait)
        on_root(self.comm, self._remove_unused)

    def _remove_unused(self) -> None:
        for other in _parts(self.path):
            if other.name not in self._used:
                shutil.rmtree(other, ignore_errors=True)


def _parts(path: Path) -> list[Path]:
    """Return the folders of set-ups and levels.  Rank 0."""
    return [part for part in path.iterdir() if is_checkpoint(part)]


def _empty(path: Path) -> None:
    """Remove all checkpoints.  Rank 0.  Raises CaseError, ResourceError: they cannot be removed."""
    with file_errors(str(path)):
        for name in _FILES:
            (path / name).unlink(missing_ok=True)
        for part in _parts(path):
            shutil.rmtree(part)


def _sign(folder: Path, branch: str, sweep: Sweep) -> None:
    """Record the branch and the range of a level's folder.  Rank 0."""
    make_folder(str(folder))
    if read_record(folder / "of") is None:
        write_unsynced(folder / "of", {"range": np.array([sweep.start, sweep.stop])}, {"branch": branch})


def _of_branch(path: Path, branch: str) -> list[tuple[Path, Sweep]]:
    """Return the folders and ranges of a branch.  Rank 0."""
    ranges = []
    for folder in path.glob("level-*"):
        of = read_record(folder / "of")
        if of is not None and of[1]["branch"] == branch:
            start, stop = map(float, of[0]["range"])
            ranges.append((folder, Sweep(start, stop)))
    return ranges


def _opened(path: Path, scene: Scene, options: tuple[str, ...], fresh: bool) -> tuple[Identity, tuple[str, ...], Finished | None]:
    """Return the identity of a run, notes on the last run in this folder, and the outcome if this run is finished.  Rank 0."""
    if fresh and path.is_dir():
        _empty(path)
    identity, notes = identity_of(scene, options), tuple[str, ...]()
    record = read_record(path / "identity")
    if record is not None and record[1].keys() == identity.as_texts().keys():
        notes = tuple(_differences_from(path, identity, Identity.from_texts(record[1])))
    make_folder(str(path))
    write_record(path / "identity", {}, identity.as_texts())
    return identity, notes, _done(path, identity)


def _done(path: Path, identity: Identity) -> Finished | None:
    """Return the outcome of a finished run whose results exist, None otherwise.  Rank 0."""
    record = read_record(path / "done")
    if record is None or record[1]["of"] != identity.whole:
        return None
    output = path.parent / UNFINISHED if record[1].get("place") == UNFINISHED else path.parent
    if not (output / TABLE).is_file() or _hash(output / RESULTS) != record[1]["results"]:
        return None
    return Finished(output, record[1]["failures"])


def _has_complete_results(folder: Path) -> bool:
    """Return whether the results in a folder are of a run in which no level ended early.  Rank 0."""
    record = read_record(folder / NAME / "done")
    if record is None:
        return False
    complete = record[1].get("complete", "") if record[1]["failures"] else record[1]["results"]
    return complete != "" and complete == _hash(folder / RESULTS)


def _hash(path: Path) -> str:
    """Return a hash of a file; "" without a file."""
    if not path.is_file():
        return ""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _differences_from(path: Path, identity: Identity, last: Identity) -> list[str]:
    """Return notes on the set-up of the last run in this folder, and on the differences of its inputs."""
    differences = identity.differences(last)
    folder = path / f"setup-{identity.setup}"
    has_setup = (folder / "model").is_file() or any(folder.glob("*diameter-*/model"))
    setup = "a set-up of the present inputs is stored here" if has_setup else "its set-up is one of other inputs"
    if not differences:
        return [
            f"continues from the checkpoints in {path}" if has_setup else f"{path} has no set-up yet: starts from the beginning"
        ]
    return ["\n  ".join([f"the last run in this folder was of another scene or program ({setup}):", *differences])]
