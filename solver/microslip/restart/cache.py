"""Set-ups that the runs of one structure share, beside their folders for results.

    cache/setup-KEY/model         the reduced model of all modes that were found, samples, pairs; names the file of its modes
    cache/setup-KEY/modes-NAME    the modes themselves, for fields on the mesh
    cache/setup-KEY/columns       static columns, of the run that knew most of them
    cache/setup-KEY/factor-N      the factor on N ranks: kept_factor.py

The key is a hash of all that these depend on (identity.py).  Files are written beside, take their places whole and are never
changed there, so that any number of runs may read and write them at a time: whoever comes last is the one who counts.  What is
damaged is dropped.  Nothing here is needed: where the cache fails, a run does without.
"""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from ..library.prepare import Prepared
from ..messages.errors import CaseError, ResourceError
from ..observe.log import RunLog
from ..parallel.agree import on_root
from ..system.files import make_folder
from .kept_columns import KeptColumns, n_pairs_in
from .kept_factor import KeptFactor
from .place import is_part
from .records import Arrays, read_record, write_record
from .restore import KeptSetup
from .shared import WHY, all_found, is_shared, made_of, shared_arrays

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..linear.factor import Factor
    from ..scene.schema import Scene

NAME, VARIABLE, OFF = "cache", "MICROSLIP_CACHE", "off"
LARGEST = 4e9  # bytes: factors, and then set-ups, that were used longest ago are removed beyond


def cache_of(folder: Path) -> Path | None:
    """Return the folder of the set-ups that a run shares, beside that for its results or where the environment says; or None."""
    said = os.environ.get(VARIABLE, "")
    return None if said == OFF else Path(said) if said else folder.absolute().parent / NAME


@dataclass(eq=False)
class Cache:
    """The set-up of one structure in a cache.  All methods are collective on ``comm``; files at fault raise nothing."""

    comm: MPI.Comm
    path: Path  # of the cache
    key: str  # of the structure

    @property
    def _entry(self) -> Path:
        return self.path / f"setup-{self.key}"

    @cached_property
    def factor(self) -> KeptFactor:
        """The factor on as many ranks as this run has."""
        return KeptFactor(self.comm, self._entry)

    def prepared(self, scene: Scene, log: RunLog) -> tuple[Prepared, list[str], Path] | None:
        """Return a scene prepared from the set-up that is there, its notes, the file of its modes; None where that is none."""
        found = on_root(self.comm, self._read)
        if found is None:
            return None
        texts = found[1]
        modes = self._entry / texts["modes"]
        columns = KeptColumns(self.comm, self._entry / "columns")
        with log.stage("set-up of an earlier run"):
            made = made_of(KeptSetup(found[0], texts, columns, lambda: read_modes(modes), self.factor), scene, log)
        if made is None:
            return None
        prepared, why = made
        return prepared, [f"the set-up is that of an earlier run, in {self._entry}", *texts["notes"], why], modes

    def _read(self) -> tuple[Arrays, dict] | None:
        """Return what is there, as used now; an entry that is damaged is removed.  Rank 0."""
        path = self._entry / "model"
        with suppress(OSError):
            found = read_record(path)
            if found is not None and (self._entry / found[1]["modes"]).is_file():
                os.utime(path)
                return found
            if path.exists():
                shutil.rmtree(self._entry, ignore_errors=True)
        return None

    def keep(self, prepared: Prepared, notes: list[str]) -> str:
        """Keep a set-up that was made anew; return why that could not be, or nothing."""
        if not is_shared(prepared):
            return ""
        try:
            arrays, texts = shared_arrays(prepared)
        except CaseError:
            return ""  # of modes that this run does without
        structure = prepared.structure
        phi = structure.in_user_order(all_found(structure).phi_owned)
        said = [note for note in notes if not note.startswith(WHY)]
        return self._tried(lambda: self._write(arrays, {**texts, "notes": said}, phi))

    def _write(self, arrays: Arrays, texts: dict, phi) -> None:
        """Write the modes, then the model that names them, and make room.  Rank 0."""
        make_folder(str(self._entry))
        name = f"modes-{uuid.uuid4().hex[:12]}"
        write_record(self._entry / name, {"phi": phi})
        write_record(self._entry / "model", arrays, {**texts, "modes": name})
        for other in self._entry.glob("modes-*"):
            if other.name != name:
                other.unlink(missing_ok=True)
        make_room(self.path, self._entry)

    def keep_columns(self, journal: Path) -> str:
        """Keep the static columns in the journal of a run, where they are more than those there; return why not, or nothing."""
        return self._tried(lambda: self._link_columns(journal))

    def _link_columns(self, journal: Path) -> None:
        if (self._entry / "model").is_file() and n_pairs_in(journal) > n_pairs_in(self._entry / "columns"):
            take(journal, self._entry / "columns")
            make_room(self.path, self._entry)

    def keep_factor(self, factor: Factor) -> str:
        """Keep a factor that is wanted for later runs; return why that could not be, or nothing."""
        return self.factor.keep(factor) or self._tried(lambda: make_room(self.path, self._entry))

    def _tried(self, write: Callable[[], None]) -> str:
        """Write on rank 0; return what went wrong, on every rank."""

        def tried() -> str:
            try:
                write()
            except (CaseError, ResourceError, OSError) as problem:
                return f"the set-up is not kept for other runs: {problem}"
            return ""

        return on_root(self.comm, tried)


def read_modes(path: Path):
    """Return modes from their file, None where it is gone or damaged.  Rank 0."""
    with suppress(OSError):
        found = read_record(path)
        return None if found is None else found[0]["phi"]
    return None


def take(source: Path, target: Path) -> None:
    """Give a file a second name, in place of what has it, or copy it where the file system has but one name each.  Rank 0."""
    beside = target.with_name(f"{target.name}-{uuid.uuid4().hex[:12]}.part")
    try:
        try:
            os.link(source, beside)
        except OSError:
            shutil.copyfile(source, beside)
        os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)


def make_room(path: Path, newest: Path) -> None:
    """Remove the factors of the set-ups used longest ago, then set-ups, until the rest is no larger than ``LARGEST``.  Rank 0.

    A factor is most of what is there and saves least: modes take longer.
    """
    entries = sorted(filter(is_part, path.glob("setup-*")), key=lambda entry: (entry == newest, _used(entry)))
    factors = [factor for entry in entries for factor in entry.glob("factor-*")]
    for part in (*factors, *entries):
        if sum(map(size_of, entries)) <= LARGEST:
            return
        shutil.rmtree(part, ignore_errors=True)


def size_of(folder: Path) -> int:
    """Return the bytes of all files in a folder; others may remove some of them meanwhile.  Rank 0."""
    size = 0
    for file in folder.rglob("*"):
        with suppress(OSError):
            size += file.stat().st_size if file.is_file() else 0
    return size


def _used(entry: Path) -> float:
    """Return when a set-up was used last; one without a model is the oldest."""
    with suppress(OSError):
        return (entry / "model").stat().st_mtime
    return 0.0
