"""The structures of a disc, one for each nodal diameter in use, in the folder of a run and in the cache.

    diameter-D/model, modes-NAME, columns    the structure of the sector index D, up to half of the sectors: stored_structure.py

Each structure is written when it is computed, and again at the end of the run if it has more data.  Matrices and factor of the
sector are computed once for all nodal diameters, when first needed.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

from mpi4py import MPI

from ..library.build import Assembled, Structure, assembled, conjugate_of, factored_of, of_diameter, without_reference
from ..library.settings import reduction_settings
from ..observe.log import RunLog
from ..parallel.agree import on_root
from ..receptance.per_group import PerGroup, only_group
from ..reduction.choose_modes import choose_modes
from ..reduction.stuck import Factored, ModesOf
from ..scene.schema import Scene
from .cache import Cache, joints_of, pairs_for
from .records import Disk
from .stored_structure import StoredStructure, extent_of


@dataclass(eq=False)
class StoredDisc:
    """The nodal diameters of a disc in a folder.  All methods are collective on ``comm``."""

    comm: MPI.Comm
    path: Path
    scene: Scene
    log: RunLog
    disk: Disk
    cache: Cache | None = None
    renews: bool = False  # whether entries of the cache are replaced
    _written: dict[int, list[int]] = field(default_factory=dict)  # extent of the written data, by diameter

    def structure(self) -> Structure:
        """Return the structure of harmonic 1, which gives access to all other harmonics."""
        return self._groups.of(1)

    @cached_property
    def _groups(self) -> PerGroup[Structure]:
        cyclic = self.scene.cyclic
        assert cyclic is not None, "a disc"
        make: Callable = self._of_diameter
        return PerGroup(make, cyclic.diameter, cyclic.diameters)

    @cached_property
    def _parts(self) -> Assembled:
        """The matrices of the sector; collective if they are not assembled yet."""
        return without_reference(assembled(self.scene, self.comm, self.log), False)

    def _of_diameter(self, d: int) -> Structure:
        """Return the structure of a sector index, from this folder, the cache or computed; in the latter cases it is stored."""
        assert self.scene.cyclic is not None, "a disc"
        n_sectors = self.scene.cyclic.sectors
        if 2 * d > n_sectors:
            return self._groups.of_group(n_sectors - d).of_conjugate(d)
        stored, structure, modes = self._stored(d), self._restored(d), None
        is_new = structure is None
        if structure is None:
            structure, modes = self._cached(d) or (of_diameter(self._parts, d, self._groups, self.log), None)
        structure = self._of_disc(structure, d)
        if is_new:
            self._write(d, structure, modes)
        self._written[d] = extent_of(structure)
        stored.columns.follow(structure.statics.G_static)
        return structure

    def _of_disc(self, structure: Structure, d: int) -> Structure:
        """Return a structure as that of a sector index of the disc.  Local."""
        assert self.scene.cyclic is not None, "a disc"
        conjugate = conjugate_of(d, self.scene.cyclic.sectors)
        return replace(structure, group=d, groups=self._groups, conjugate=conjugate)  # type: ignore[arg-type]  # of structures

    def _stored(self, d: int) -> StoredStructure:
        return StoredStructure(self.comm, self.path / f"diameter-{d}", disk=self.disk)

    def _in_cache(self, d: int) -> StoredStructure | None:
        return None if self.cache is None else StoredStructure(self.comm, self.cache.entry / f"diameter-{d}")

    def _restored(self, d: int) -> Structure | None:
        """Return the structure in this folder; None if there is none."""
        files, cached = self._stored(d), self._in_cache(d)
        record = on_root(self.comm, files.read)
        if record is None:
            return None
        self.log.note(f"nodal diameter {d}: the structure is that of this folder")
        structure = files.structure(record, self.scene, self.log, partial(self._large, d))
        if cached is not None:
            cached.columns.restore(structure.statics.G_static, is_known=False)
        files.columns.restore(structure.statics.G_static, is_known=True)
        return structure

    def _cached(self, d: int) -> tuple[Structure, Path] | None:
        """Return the structure in the cache for the pairs of the scene, and the file of its modes; None if there is none."""
        files = None if self.renews else self._in_cache(d)
        record = None if files is None else on_root(self.comm, files.read)
        if files is None or record is None:
            return None
        structure = files.structure(record, self.scene, self.log, partial(self._large, d))
        is_at_rest, joints = record[1]["is_at_rest"], record[1]["joints"]
        pairs = structure.pairs if is_at_rest else pairs_for(self.scene, structure.pairs, joints, self.comm)
        if pairs is None:
            return None
        self.log.note(f"nodal diameter {d}: the structure is that of an earlier run, in {files.path}")
        files.columns.restore(structure.statics.G_static, is_known=False)
        structure = self._of_disc(replace(structure, pairs=pairs), d)
        structure, why = choose_modes(structure, reduction_settings(self.scene))
        self.log.note(why)
        return structure, files.path / record[1]["modes"]

    def _large(self, d: int, modes_of: ModesOf) -> Factored:
        """Return matrices, factor and modes of a nodal diameter."""
        parts = self._parts
        sectors = parts.rest.system.sectors
        assert sectors is not None, "a disc"
        system = parts.rest.system if d == 0 else sectors.system(d)
        return factored_of(replace(parts, rest=replace(parts.rest, system=system)), self.log, None, modes_of)

    def _write(self, d: int, structure: Structure, modes: Path | None = None) -> None:
        """Store the structure of a nodal diameter in this folder and in the cache; ``modes`` is a file that has its modes."""
        modes = modes if structure.factored.value is None else None
        alone, stored = replace(structure, groups=None, group=only_group(0), conjugate=None), self._stored(d)
        stored.write(
            alone, None, modes, {"joints": joints_of(self.scene), "notes": [], "is_at_rest": self.scene.statics is not None}
        )
        cached = self._in_cache(d)
        if self.cache is not None and cached is not None and (problem := self.cache.share(alone, stored, self.renews, cached)):
            self.log.note(problem)

    def finish(self) -> None:
        """Store nodal diameters with more data than before again, and their static columns in the cache."""
        for d in sorted(self._written):
            structure = self._groups.of_group(d)
            if structure.factored.value is not None and extent_of(structure) != self._written[d]:
                self._write(d, structure)
            cached = self._in_cache(d)
            if self.cache is not None and cached is not None:
                self.cache.share_columns(self._stored(d).columns.path, cached)
