"""A cache of structures that several runs share, next to their folders for results.

    cache/setup-KEY/model, modes-NAME, columns   a stuck structure: stored_structure.py; columns of the run with most of them
    cache/setup-KEY/diameter-D/                  of a disc instead of these: stored_disc.py
    cache/setup-KEY/factor-N                     its factor on N ranks: cached_factor.py

The key is a hash of everything that a stuck structure depends on (identity.py).  Files are written under temporary names, renamed
atomically and never changed afterwards, so that any number of runs may read and write at the same time; the last writer wins.
Damaged files are removed.  Without a usable entry a run computes its structure.
"""

import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from mpi4py import MPI

from ..library.build import Structure
from ..linear.factor import Factor
from ..messages.errors import CaseError, ResourceError
from ..parallel.agree import on_root
from .cached_factor import CachedFactor
from .columns_file import n_pairs_in
from .records import Arrays
from .results_folder import is_checkpoint
from .stored_structure import StoredStructure, extent_of, link_or_copy

NAME, VARIABLE, OFF = "cache", "MICROSLIP_CACHE", "off"
LARGEST = 4e9  # bytes of the cache, beyond which the least recently used factors and then set-ups are removed


def cache_of(folder: Path) -> Path | None:
    """Return the folder of the cache, next to the results folder or from the environment; None if it is off."""
    choice = os.environ.get(VARIABLE, "")
    return None if choice == OFF else Path(choice) if choice else folder.absolute().parent / NAME


@dataclass(eq=False)
class Cache:
    """A structure in the cache.  All methods are collective on ``comm``; faulty files raise no errors."""

    comm: MPI.Comm
    path: Path  # folder of the cache
    key: str  # key of the structure
    part: str = ""  # folder of a nodal diameter within the entry

    @property
    def entry(self) -> Path:
        """The folder of the structure, of a disc with all nodal diameters."""
        return self.path / f"setup-{self.key}"

    @cached_property
    def factor(self) -> CachedFactor:
        """The factor on the number of ranks of this run."""
        return CachedFactor(self.comm, self.entry)

    @cached_property
    def files(self) -> StoredStructure:
        """The files of the structure."""
        return StoredStructure(self.comm, self.entry / self.part, self.factor)

    def read(self) -> tuple[Arrays, dict[str, Any]] | None:
        """Return the stored arrays and texts and mark them as used now; remove a damaged structure.  Rank 0."""
        with suppress(OSError):
            for _ in range(2):  # another run may replace the model and its modes between the two reads
                stored = self.files.read()
                if stored is not None and (self.files.path / stored[1]["modes"]).is_file():
                    with suppress(OSError):  # of another owner
                        os.utime(self.files.model)
                    return stored
            if self.files.model.exists():
                shutil.rmtree(self.files.path, ignore_errors=True)
        return None

    def share(self, structure: Structure, of_run: StoredStructure, computation: str, renews: bool) -> str:
        """Store a structure unless the cache has it in the same extent already; return an error message or nothing."""
        return self._tried(self._share, structure, of_run, computation, renews)

    def _share(self, structure: Structure, of_run: StoredStructure, computation: str, renews: bool) -> None:
        cached = None if renews else self.files.read()
        if cached is None or [cached[1][key] for key in ("extent", "computation")] != [extent_of(structure), computation]:
            self.files.copy_from(of_run)
            if renews:
                self.files.columns.path.unlink(missing_ok=True)
            make_room(self.path, self.entry)

    def share_columns(self, journal: Path) -> str:
        """Store the static columns of a run if they are more than the cached ones; return an error message or nothing."""
        return self._tried(self._link_columns, journal)

    def _link_columns(self, journal: Path) -> None:
        columns = self.files.columns.path
        if self.files.model.is_file() and n_pairs_in(journal) > n_pairs_in(columns):
            link_or_copy(journal, columns)
            make_room(self.path, self.entry)

    def share_factor(self, factor: Factor) -> str:
        """Store a factor for later runs; return an error message or nothing."""
        return self.factor.keep(factor) or self._tried(make_room, self.path, self.entry)

    def _tried(self, write: Callable[..., None], *arguments: object) -> str:
        """Write on rank 0; return the error message or nothing, on every rank."""

        def tried() -> str:
            try:
                write(*arguments)
            except (CaseError, ResourceError, OSError) as problem:
                return f"the set-up is not stored for other runs: {problem}"
            return ""

        return on_root(self.comm, tried)


def make_room(path: Path, newest: Path) -> None:
    """Remove the least recently used factors, then set-ups, until the cache is no larger than ``LARGEST``.  Rank 0.

    Factors are the largest files and save the least time: computing modes takes longer.
    """
    entries = sorted(filter(is_checkpoint, path.glob("setup-*")), key=lambda entry: (entry == newest, _used(entry)))
    factors = [factor for entry in entries for factor in entry.glob("factor-*")]
    for part in (*factors, *entries):
        if sum(map(size_of, entries)) <= LARGEST:
            return
        shutil.rmtree(part, ignore_errors=True)


def size_of(folder: Path) -> int:
    """Return the size of all files in a folder [bytes]; other runs may remove some of them meanwhile.  Rank 0."""
    size = 0
    for file in folder.rglob("*"):
        with suppress(OSError):
            size += file.stat().st_size if file.is_file() else 0
    return size


def _used(entry: Path) -> float:
    """Return the time of the last use of a set-up, of a disc of a nodal diameter of it; 0 without a model."""
    with suppress(OSError):
        return max((model.stat().st_mtime for model in entry.rglob("model")), default=0.0)
    return 0.0
