"""The folder in which a run keeps its work: what is there of it already, and where the rest goes.

    restart/identity         what the last run was of
    restart/setup-KEY/       the stuck structure: stored_structure.py
    restart/level-KEY/       of; points.S, state.S.0, state.S.1, end.S of each segment S of a level

Each key is a hash of all that the part depends on (identity.py), so that a part which is there is one that can be used.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..library.build import Structure
from ..library.prepare import Prepared, prepare, put_basis
from ..observe.log import RunLog
from ..parallel.agree import on_each, on_root
from ..points.sweep import Sweep
from ..reduction.reduction import Basis
from ..system.files import make_folder, said_of
from .cache import Cache, joints_of
from .identity import Identity, identity_of
from .kept_branch import KeptBranch
from .place import RESULTS, TABLE, UNFINISHED, is_part
from .records import Arrays, Disk, as_written, note_record, read_record, write_record
from .stored_structure import StoredStructure
from .structure_arrays import basis_of

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..continuation.keeper import Keeper, Keepers
    from ..scene.schema import Scene

NAME = "restart"
_FILES = ("identity", "done")


@dataclass(frozen=True)
class Finished:
    """A run that came to its end: where its results are, and why levels ended early, if some did."""

    place: Path
    failures: list[str]


@dataclass(eq=False)
class Restart:
    """What a run keeps in its folder.  All methods but those on paths are collective on ``comm``.

    Raises
    ------
    CaseError, ResourceError : of every method, on every rank, where files cannot be read or written
    """

    comm: MPI.Comm
    path: Path
    scene: Scene
    identity: Identity  # of this run
    notes: tuple[str, ...]  # what is there, and how it differs
    done: Finished | None = None  # this very run, where it was finished before; None: there is something left to compute
    cache: Cache | None = None  # of set-ups that runs share
    fresh: bool = False  # nothing of it is used
    _used: set[str] = field(default_factory=set)  # names of folders that this run has used; on rank 0
    _disk: Disk = field(default_factory=Disk)  # of all files that grow

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
        """Return what is kept in the folder of a run; nothing if it is to start afresh.  ``shared`` is a cache of set-ups."""
        path = folder / NAME
        identity, notes, done = on_root(comm, as_written, path, _opened, path, scene, options, fresh)
        cache = None if shared is None else Cache(comm, shared, identity.structure)
        return cls(comm, path, scene, identity, notes, done, cache, fresh)

    def noting(self, more: Iterable[str]) -> Restart:
        """Return the same with more to say of the folder, first.  Local."""
        return replace(self, notes=(*more, *self.notes))

    # -- the structure -----------------------------------------------------------------------------------------------

    @cached_property
    def _stored(self) -> StoredStructure:
        """The files of the structure in this folder."""
        factor = None if self.cache is None else self.cache.factor
        return StoredStructure(self.comm, self.path / f"setup-{self.identity.setup}", factor, self._disk)

    def prepared(self, log: RunLog, build: Callable[[], Structure]) -> Prepared:
        """Return the structure made ready: that of this folder, or of the cache, or as ``build`` makes it; then it is stored."""
        self._used.add(self._stored.path.name)
        before, modes = len(log.notes), None
        structure = self._restored(log)
        is_stored, cached = structure is not None, None
        if structure is None:
            cached = None if self.cache is None or self.fresh else self.cache.structure(self.scene, log)
            structure, notes, modes = cached if cached is not None else (build(), log.notes[before:], None)
            for note in notes if cached is not None else ():
                log.note(note)
        with log.stage("reduction"):
            prepared = prepare(structure)
        if not is_stored:
            self._store(prepared, notes[1:] if cached else notes, modes, log)
        self._stored.columns.follow(structure.statics.G_static)
        return prepared

    def _restored(self, log: RunLog) -> Structure | None:
        """Return the structure of this folder, and note what was noted of it; None where there is none."""
        found = on_root(self.comm, self._stored.read)
        if found is None:
            return None
        with log.stage("structure from this folder"):
            structure, basis = as_written(self._stored.path, self._structure_and_basis, found, log)
            if basis is not None:
                put_basis(structure, basis)
            if self.cache is not None:
                self.cache.stored.columns.restore(structure.statics.G_static, is_known=False)
            self._stored.columns.restore(structure.statics.G_static, is_known=True)
        for note in found[1]["notes"]:
            log.note(note)
        return structure

    def _structure_and_basis(self, found: tuple[Arrays, dict[str, Any]], log: RunLog) -> tuple[Structure, Basis | None]:
        return self._stored.structure(found, self.scene, log), basis_of(*found)

    def _store(self, prepared: Prepared, notes: list[str], modes: Path | None, log: RunLog) -> None:
        """Store a structure in this folder, and for other runs; its modes are those of a file, if nothing was computed."""
        structure = prepared.structure
        more = {"notes": notes, "joints": joints_of(structure.scene), "is_at_rest": structure.scene.statics is not None}
        modes = modes if structure.factored.value is None else None
        self._stored.write(structure, prepared.reduction.basis, modes, more)
        if self.cache is not None and (problem := self.cache.share(structure, self._stored, self.fresh)):
            log.note(problem)

    def share_columns(self, log: RunLog) -> None:
        """Let other runs use the static columns that this one has solved for."""
        problem = "" if self.cache is None else self.cache.share_columns(self._stored.columns.path)
        if problem:
            log.note(problem)

    def share_factor(self, prepared: Prepared, log: RunLog) -> None:
        """Let later runs use the factor, if there is one that they lack: it is made for the fields on the mesh alone."""
        factored = prepared.structure.factored.value
        if self.cache is None or factored is None or not self.cache.factor.is_wanted(factored.linearised.factor):
            return
        with log.stage("factor for other runs"):
            problem = self.cache.share_factor(factored.linearised.factor)
        if problem:
            log.note(problem)

    # -- the levels --------------------------------------------------------------------------------------------------

    def keepers_of(self, prepared: Prepared, log: RunLog) -> Keepers:
        """Return what keeps the levels of a response, and says what it has of them.  Local."""
        n_modes = prepared.structure.n_modes

        sweep = prepared.response.sweep

        def keeper(comm: MPI.Comm, level: float, segment: int) -> Keeper:
            folder, branch = self.path / self._level(level, n_modes), self.identity.branch(level, n_modes)
            on_root(comm, _sign, folder, branch, sweep)
            others = partial(_of_branch, self.path, branch) if segment == 0 else list
            return KeptBranch(comm, folder, segment, log.note, others, self._disk)

        self._used |= {self._level(level, n_modes) for level in prepared.response.settings.levels}
        return keeper

    def _level(self, level: float, n_modes: int) -> str:
        return f"level-{self.identity.level(level, n_modes)}"

    # -- the end -----------------------------------------------------------------------------------------------------

    def final_place(self, folder: Path, place: Path, failures: list[str]) -> Path:
        """Return where results made in ``place`` stay: in ``folder``, unless levels ended early and those there are complete."""
        stays = bool(failures) and not self.fresh and on_root(self.comm, _has_complete_results, folder)
        return place if stays else folder

    def finish(self, folder: Path, place: Path, failures: list[str]) -> Finished:
        """Note that the run is finished, its results in ``place``; remove what it has not used: that belongs to other scenes."""
        on_each(self.comm, self._wait)
        on_root(self.comm, self._finish, folder, place, failures)
        return Finished(place, failures)

    def _wait(self) -> None:
        """Wait until all files of this rank have reached the disk."""
        with said_of(str(self.path)):
            self._disk.wait()

    def _finish(self, folder: Path, place: Path, failures: list[str]) -> None:
        found = {"of": self.identity.whole, "results": _hash(place / RESULTS), "failures": failures}
        if place != folder:
            found |= {"place": place.name, "complete": _hash(folder / RESULTS)}
        write_record(self.path / "done", {}, found)
        for other in _parts(self.path):
            if other.name not in self._used:
                shutil.rmtree(other, ignore_errors=True)


def _parts(path: Path) -> list[Path]:
    """Return the folders of set-ups and levels; others there are not of this program.  Rank 0."""
    return [part for part in path.iterdir() if is_part(part)]


def _empty(path: Path) -> None:
    """Remove what runs have kept.  Rank 0.

    Raises
    ------
    CaseError, ResourceError : it cannot be removed
    """
    with said_of(str(path)):
        for name in _FILES:
            (path / name).unlink(missing_ok=True)
        for part in _parts(path):
            shutil.rmtree(part)


def _sign(folder: Path, branch: str, sweep: Sweep) -> None:
    """Note of which branch the folder of a level is, and its range.  Rank 0."""
    make_folder(str(folder))
    if read_record(folder / "of") is None:
        note_record(folder / "of", {"range": np.array([sweep.start, sweep.stop])}, {"branch": branch})


def _of_branch(path: Path, branch: str) -> list[tuple[Path, Sweep]]:
    """Return the folders of one branch and their ranges.  Rank 0."""
    found = []
    for folder in path.glob("level-*"):
        of = read_record(folder / "of")
        if of is not None and of[1]["branch"] == branch:
            start, stop = map(float, of[0]["range"])
            found.append((folder, Sweep(start, stop)))
    return found


def _opened(path: Path, scene: Scene, options: tuple[str, ...], fresh: bool) -> tuple[Identity, tuple[str, ...], Finished | None]:
    """Return the identity of a run, what there is to say of the last one in this folder, and how this one ended, if it did.

    Rank 0.
    """
    if fresh and path.is_dir():
        _empty(path)
    identity, notes = identity_of(scene, options), tuple[str, ...]()
    found = read_record(path / "identity")
    if found is not None and found[1].keys() == identity.as_texts().keys():
        notes = tuple(_told(path, identity, Identity.from_texts(found[1])))
    make_folder(str(path))
    write_record(path / "identity", {}, identity.as_texts())
    return identity, notes, _done(path, identity)


def _done(path: Path, identity: Identity) -> Finished | None:
    """Return a run that was finished and whose results are there; None of any other.  Rank 0."""
    found = read_record(path / "done")
    if found is None or found[1]["of"] != identity.whole:
        return None
    place = path.parent / UNFINISHED if found[1].get("place") == UNFINISHED else path.parent
    if not (place / TABLE).is_file() or _hash(place / RESULTS) != found[1]["results"]:
        return None
    return Finished(place, found[1]["failures"])


def _has_complete_results(folder: Path) -> bool:
    """Return whether the results in a folder are those of a run of which no level ended early.  Rank 0."""
    found = read_record(folder / NAME / "done")
    if found is None:
        return False
    complete = found[1].get("complete", "") if found[1]["failures"] else found[1]["results"]
    return complete != "" and complete == _hash(folder / RESULTS)


def _hash(path: Path) -> str:
    """Return a hash of a file, "" of none."""
    if not path.is_file():
        return ""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _told(path: Path, identity: Identity, last: Identity) -> list[str]:
    """Say what the last run in this folder left, and where it was of something else."""
    differences = identity.differences(last)
    has_setup = (path / f"setup-{identity.setup}" / "model").is_file()
    kept = "its set-up is used again" if has_setup else "its set-up cannot be used again"
    if not differences:
        return [f"goes on with what is in {path}" if has_setup else f"{path} holds no set-up yet: begins anew"]
    return ["\n  ".join([f"the last run in this folder was of another scene or program ({kept}):", *differences])]
