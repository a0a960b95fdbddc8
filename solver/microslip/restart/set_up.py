"""The stuck structure of a run: from its folder, from the cache or computed, and then stored in both.

A disc has one for each nodal diameter in use (stored_disc.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ..formats.model import FileModel
from ..library.build import Structure
from ..library.complete import read_completed
from ..library.prepare import put_basis
from ..library.settings import reduction_settings
from ..mesh.data import ContactPairs
from ..mesh.pairing import pair_contacts
from ..mesh.read import read_mesh
from ..messages.errors import CaseError, ResourceError
from ..observe.log import RunLog
from ..parallel.agree import on_root
from ..reduction.choose_modes import choose_modes
from ..reduction.reduction import Basis
from ..scene.schema import Scene
from .cache import Cache
from .records import Arrays, Disk, checked_read
from .stored_structure import Large, StoredStructure, extent_of
from .structure_arrays import basis_of, numbers_of

_WHY = "modes: "  # start of the note that gives the reason for the number of modes
_OF_SECTOR = "factor"  # start of the note on the factor that all nodal diameters share, which a restored one does without
_LIMITS = ("mu", "N0", "law_columns/mu_y", "law_columns/start")  # columns of pairs that the stuck structure does not depend on


@dataclass(eq=False)
class SetUp:
    """A stuck structure of a run.  All methods are collective on ``comm``.

    Raises
    ------
    CaseError, ResourceError : of every method, on every rank, where files of the run cannot be read or written
    """

    comm: MPI.Comm
    path: Path  # its folder
    cache: Cache | None  # its place in the cache
    scene: Scene
    log: RunLog
    disk: Disk
    fresh: bool  # a cached structure is replaced, not used
    name: str = "the set-up"  # in notes
    large: Large | None = None  # of a nodal diameter: computes the large parts
    of_group: Mapping[str, Any] = field(default_factory=dict)  # of a nodal diameter: fields of its structure
    has_choices: bool = False  # whether the place in the cache depends on the pairs and on what the modes are chosen by
    computation: str = ""  # of a disc whose sectors may differ: name of the computation of all nodal diameters, this one in it
    _notes: list[str] = field(default_factory=list)  # that a continued run repeats
    _modes: Path | None = None  # file of its modes in the cache, if they are from there
    _stored: tuple[Structure, Basis | None, list[int]] | None = None  # the structure in the folder, its basis and extent

    @cached_property
    def files(self) -> StoredStructure:
        """The files in the folder."""
        return StoredStructure(self.comm, self.path, None if self.cache is None else self.cache.factor, self.disk)

    def structure(self, build: Callable[[], Structure]) -> Structure:
        """Return the structure from the folder, from the cache or by ``build``; in the latter cases it is to be stored."""
        structure = self._restored()
        if structure is not None:
            return structure
        structure = None if self.cache is None or self.fresh else self._cached(self.cache)
        if structure is not None:
            return structure
        before = len(self.log.notes)
        structure = build()
        self._notes = [note for note in self.log.notes[before:] if not (self.of_group and note.startswith(_OF_SECTOR))]
        return structure

    def _restored(self) -> Structure | None:
        """Return the structure in the folder and repeat its notes; None if there is none."""
        stored = on_root(self.comm, self.files.read)
        if stored is None:
            return None
        with self._stage("structure from this folder"):
            structure = checked_read(self.path, self._structure_of, self.files, stored)
            basis = checked_read(self.path, basis_of, *stored)
            if basis is not None:
                put_basis(structure, basis)
            if self.cache is not None:
                self.cache.files.columns.restore(structure.statics.G_static, is_known=False)
            self.files.columns.restore(structure.statics.G_static, is_known=True)
        self._notes, self.computation = stored[1]["notes"], stored[1]["computation"]
        self._repeat_notes("that of this folder")
        self._follow(structure, basis)
        return structure

    def _cached(self, cache: Cache) -> Structure | None:
        """Return the structure in the cache, with its notes; None if there is none to use."""
        stored = on_root(self.comm, cache.read)
        if stored is None:
            return None
        texts = stored[1]
        with self._stage("structure from the cache"):
            structure, self._notes = self._structure_of(cache.files, stored, self.path), texts["notes"]
            has_pairs = texts["is_at_rest"] or self.has_choices
            pairs = structure.pairs if has_pairs else pairs_for(self.scene, structure.pairs, texts["joints"], self.comm)
            if pairs is None:
                return None
            cache.files.columns.restore(structure.statics.G_static, is_known=False)
            if not self.has_choices:
                structure, why = choose_modes(replace(structure, pairs=pairs), reduction_settings(self.scene))
                self._notes = [*(note for note in self._notes if not note.startswith(_WHY)), why]
        self._modes, self.computation = cache.files.path / texts["modes"], texts["computation"]
        self._repeat_notes(f"that of an earlier run, in {cache.entry}")
        return structure

    def _stage(self, name: str) -> AbstractContextManager[None]:
        """Return a stage of the log; none for one of the many parts of a disc whose sectors may differ."""
        return nullcontext() if self.has_choices else self.log.stage(name)

    def _repeat_notes(self, origin: str) -> None:
        """Log the origin of the structure and its notes, but none that another nodal diameter has logged.  Local."""
        for note in (f"{self.name} is {origin}", *self._notes):
            if note not in self.log.notes:
                self.log.note(note)

    def _structure_of(
        self, files: StoredStructure, stored: tuple[Arrays, dict[str, Any]], copies: Path | None = None
    ) -> Structure:
        return replace(files.structure(stored, self.scene, self.log, self.large, copies), **self.of_group)

    def forget(self, computation: str) -> None:
        """Forget the structure from a folder, so that one of another ``computation`` is stored in its place.  Local."""
        self._stored, self._modes, self.fresh, self.computation = None, None, True, computation

    def store(self, structure: Structure, basis: Basis | None = None) -> None:
        """Store the structure in the folder and in the cache, unless it is from the folder; append new static columns."""
        if self._stored is None:
            self._write(structure, basis)
            self._follow(structure, basis)

    def _follow(self, structure: Structure, basis: Basis | None) -> None:
        self._stored = structure, basis, extent_of(structure)
        self.files.columns.follow(structure.statics.G_static)

    def _write(self, structure: Structure, basis: Basis | None) -> None:
        modes = self._modes if structure.factored.value is None else None
        more = {"notes": self._notes, "joints": joints_of(self.scene), "is_at_rest": self.scene.statics is not None}
        self.files.write(structure, basis, modes, {**more, "computation": self.computation})
        if self.cache is not None and (problem := self.cache.share(structure, self.files, self.computation, self.fresh)):
            self.log.note(problem)

    def share_columns(self) -> str:
        """Store static columns in the cache, and the structure again if it has more data; return an error message or nothing."""
        assert self._stored is not None, "a structure that was stored"
        structure, basis, extent = self._stored
        if structure.factored.value is not None and extent_of(structure) != extent:
            try:
                self._write(structure, basis)
            except (CaseError, ResourceError) as problem:
                return f"the set-up of this folder does not get the data computed since: {problem}"
            self._stored = structure, basis, extent_of(structure)
        return "" if self.cache is None else self.cache.share_columns(self.files.columns.path)

    def part(self, folder: str, name: str, large: Large, of_group: Mapping[str, Any]) -> SetUp:
        """Return the set-up of a nodal diameter in a folder of this one.  Local."""
        cache = None if self.cache is None else replace(self.cache, part=folder)
        whole = self.scene.cyclic is not None and self.scene.cyclic.whole
        return SetUp(
            self.comm, self.path / folder, cache, self.scene, self.log, self.disk, self.fresh, name, large, of_group, whole
        )


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
