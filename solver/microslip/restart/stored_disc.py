"""The structures of a disc, one for each nodal diameter in use, in the folder of a run and in the cache.

    diameter-D/model, modes-NAME, columns    the structure of the sector index D, up to half of the sectors: stored_structure.py

Matrices and factor of the sector are computed once for all nodal diameters, when first needed.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

from ..library.build import Assembled, Structure, assembled, conjugate_of, factored_of, of_diameter, without_reference
from ..receptance.per_group import PerGroup
from ..reduction.stuck import Factored, ModesOf
from .set_up import SetUp


@dataclass(eq=False)
class StoredDisc:
    """The nodal diameters of a disc, stored in parts of a set-up.  All methods are collective."""

    whole: SetUp  # of which each nodal diameter is a part
    set_ups: list[SetUp] = field(default_factory=list)  # of the nodal diameters in use

    def structure(self) -> Structure:
        """Return the structure of harmonic 1, which gives access to all other harmonics."""
        return self._groups.of(1)

    @cached_property
    def _groups(self) -> PerGroup[Structure]:
        cyclic = self.whole.scene.cyclic
        assert cyclic is not None, "a disc"
        make: Callable = self._of_diameter
        return PerGroup(make, cyclic.diameter, cyclic.diameters)

    @cached_property
    def _parts(self) -> Assembled:
        """The matrices of the sector; collective if they are not assembled yet."""
        return without_reference(assembled(self.whole.scene, self.whole.comm, self.whole.log), False)

    def _of_diameter(self, d: int) -> Structure:
        """Return the structure of a sector index, and store it."""
        assert self.whole.scene.cyclic is not None, "a disc"
        n_sectors = self.whole.scene.cyclic.sectors
        if 2 * d > n_sectors:
            return self._groups.of_group(n_sectors - d).of_conjugate(d)
        of_group = {"groups": self._groups, "group": d, "conjugate": conjugate_of(d, n_sectors)}
        set_up = self.whole.part(f"diameter-{d}", f"nodal diameter {d}: the structure", partial(self._large, d), of_group)
        structure = set_up.structure(lambda: of_diameter(self._parts, d, self._groups, self.whole.log))
        set_up.store(structure)
        self.set_ups.append(set_up)
        return structure

    def _large(self, d: int, modes_of: ModesOf) -> Factored:
        """Return matrices, factor and modes of a nodal diameter."""
        parts = self._parts
        sectors = parts.rest.system.sectors
        assert sectors is not None, "a disc"
        system = parts.rest.system if d == 0 else sectors.system(d)
        return factored_of(replace(parts, rest=replace(parts.rest, system=system)), self.whole.log, None, modes_of)
