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
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ..formats.model import FileModel
from ..library.build import Structure
from ..library.complete import read_completed
from ..library.settings import reduction_settings
from ..linear.factor import Factor
from ..mesh.data import ContactPairs
from ..mesh.pairing import pair_contacts
from ..mesh.read import read_mesh
from ..messages.errors import CaseError, ResourceError
from ..observe.log import RunLog
from ..parallel.agree import on_root
from ..reduction.choose_modes import choose_modes
from ..scene.schema import Scene
from .cached_factor import CachedFactor
from .columns_file import n_pairs_in
from .records import Arrays
from .results_folder import is_checkpoint
from .stored_structure import StoredStructure, extent_of, link_or_copy
from .structure_arrays import numbers_of

NAME, VARIABLE, OFF = "cache", "MICROSLIP_CACHE", "off"
WHY = "modes: "  # start of the note that gives the reason for the number of modes
_LIMITS = ("mu", "N0", "law_columns/mu_y", "law_columns/start")  # columns of pairs that the stuck structure does not depend on
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

    @property
    def entry(self) -> Path:
        """The folder of the structure."""
        return self.path / f"setup-{self.key}"

    @cached_property
    def factor(self) -> CachedFactor:
        """The factor on the number of ranks of this run."""
        return CachedFactor(self.comm, self.entry)

    @cached_property
    def stored(self) -> StoredStructure:
        """The files of the structure."""
        return StoredStructure(self.comm, self.entry, self.factor)

    def structure(self, scene: Scene, log: RunLog) -> tuple[Structure, list[str], Path] | None:
        """Return the structure for a scene, notes, and the file of its modes; None if the cache has none to use."""
        stored = on_root(self.comm, self._read)
        if stored is None:
            return None
        arrays, texts = stored
        with log.stage("structure from the cache"):
            structure = self.stored.structure((arrays, texts), scene, log)
            pairs = structure.pairs if texts["is_at_rest"] else pairs_for(scene, structure.pairs, texts["joints"], self.comm)
            if pairs is None:
                return None
            self.stored.columns.restore(structure.statics.G_static, is_known=False)
            structure, why = choose_modes(replace(structure, pairs=pairs), reduction_settings(scene))
        before = [note for note in texts["notes"] if not note.startswith(WHY)]
        notes = [f"the set-up is that of an earlier run, in {self.entry}", *before, why]
        return structure, notes, self.entry / texts["modes"]

    def _read(self) -> tuple[Arrays, dict[str, Any]] | None:
        """Return the stored arrays and texts and mark the entry as used now; remove a damaged entry.  Rank 0."""
        with suppress(OSError):
            stored = self.stored.read()
            if stored is not None and (self.entry / stored[1]["modes"]).is_file():
                os.utime(self.stored.model)
                return stored
            if self.stored.model.exists():
                shutil.rmtree(self.entry, ignore_errors=True)
        return None

    def share(self, structure: Structure, of_run: StoredStructure, renews: bool, stored: StoredStructure | None = None) -> str:
        """Store a structure unless the cache has the same extent already; return an error message or nothing.

        ``stored``: its files in the cache; for a disc the files of a nodal diameter.
        """
        return self._tried(lambda: self._share(structure, of_run, renews, stored or self.stored))

    def _share(self, structure: Structure, of_run: StoredStructure, renews: bool, stored: StoredStructure) -> None:
        cached = None if renews else stored.read()
        if cached is None or cached[1]["extent"] != extent_of(structure):
            stored.copy_from(of_run)
            make_room(self.path, self.entry)

    def share_columns(self, journal: Path, stored: StoredStructure | None = None) -> str:
        """Store the static columns of a run if they are more than the cached ones; return an error message or nothing."""
        return self._tried(lambda: self._link_columns(journal, stored or self.stored))

    def _link_columns(self, journal: Path, stored: StoredStructure) -> None:
        columns = stored.columns.path
        if stored.model.is_file() and n_pairs_in(journal) > n_pairs_in(columns):
            link_or_copy(journal, columns)
            make_room(self.path, self.entry)

    def share_factor(self, factor: Factor) -> str:
        """Store a factor for later runs; return an error message or nothing."""
        return self.factor.keep(factor) or self._tried(lambda: make_room(self.path, self.entry))

    def _tried(self, write: Callable[[], None]) -> str:
        """Write on rank 0; return the error message or nothing, on every rank."""

        def tried() -> str:
            try:
                write()
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
    """Return the time of the last use of a set-up; 0 without a model."""
    with suppress(OSError):
        return (entry / "model").stat().st_mtime
    return 0.0


# -- the pairs of another friction or preload ----------------------------------------------------------------------


def joints_of(scene: Scene) -> list[dict[str, Any]]:
    """Return the joints of a scene as stated, as JSON values.  Local."""
    return [joint.model_dump(mode="json", exclude_unset=True) for joint in scene.joints]


def pairs_for(scene: Scene, cached: ContactPairs, joints: list[dict[str, Any]], comm: MPI.Comm) -> ContactPairs | None:
    """Return the cached contact pairs with the limits of a scene; None if other properties differ.

    Collective.
    """
    if joints == joints_of(scene):
        return cached
    if scene.model.mesh is None:
        return None
    file, completed, _ = read_completed(scene, comm)
    return on_root(comm, _paired, completed, file, cached)


def _paired(scene: Scene, file: FileModel | None, cached: ContactPairs) -> ContactPairs | None:
    """Return newly paired contact pairs of a scene if their springs and places equal the cached ones.  Rank 0."""
    pairs = pair_contacts(read_mesh(scene, file), scene.joints, scene.cyclic)
    mine, other = ({k: v for k, v in numbers_of(which).items() if k not in _LIMITS} for which in (pairs, cached))
    same = mine.keys() == other.keys() and all(np.array_equal(mine[key], other[key], equal_nan=True) for key in mine)
    same = same and pairs.joint == cached.joint and np.array_equal(pairs.laws, cached.laws)
    return pairs if same and np.array_equal(pairs.law.stiffness, cached.law.stiffness) else None
