"""The structures of a disc, one for each nodal diameter in use, in the folder of a run and in the cache.

    diameter-D/model, modes-NAME, columns    the structure of the sector index D, up to half of the sectors: stored_structure.py

Matrices and factor of the sector are computed once for all nodal diameters, when first needed.  Of a disc whose sectors may
differ, all nodal diameters of identical sectors are stored: runs with other differences share them.
"""

import uuid
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

from ..library.build import (
    Assembled,
    Structure,
    all_diameters,
    assembled,
    at_diameter,
    conjugate_of,
    correct_soft_modes,
    factored_of,
    factors_of_diameters,
    factors_of_sectors,
    of_diameter,
    tuned_disc,
    whole_disc,
    without_reference,
)
from ..library.complete import completed_scene
from ..linear.joint_springs import Linearised
from ..receptance.per_group import PerGroup
from ..reduction.stuck import Factored, ModesOf
from ..tables.cyclic import Cyclic
from .set_up import SetUp


@dataclass(eq=False)
class StoredDisc:
    """The nodal diameters of a disc, stored in parts of a set-up.  All methods are collective."""

    whole: SetUp  # of which each nodal diameter is a part
    set_ups: list[SetUp] = field(default_factory=list)  # of the nodal diameters in use

    @property
    def _cyclic(self) -> Cyclic:
        cyclic = self.whole.scene.cyclic
        assert cyclic is not None, "a disc"
        return cyclic

    def structure(self) -> Structure:
        """Return that of harmonic 1, which gives access to all other harmonics, or that of all sectors if they may differ."""
        return self._of_all_sectors() if self._cyclic.whole else self._groups.of(1)

    def _of_all_sectors(self) -> Structure:
        """Return the structure of a disc whose sectors may differ, and store those of identical sectors."""
        whole, scene = self.whole, completed_scene(self.whole.scene, self.whole.comm)
        factors = factors_of_sectors(scene, whole.comm)
        new, tuned = whole.comm.bcast(uuid.uuid4().hex), list[Structure]()

        def computed(d: int) -> Structure:
            if not tuned:
                tuned.extend(tuned_disc(self._parts, factors.changes_blades, whole.log))
            return tuned[d]

        name = "shaped-diameter" if factors.changes_blades else "diameter"
        with whole.log.stage("disc of identical sectors"):
            for d in range(self._cyclic.sectors // 2 + 1):
                of_group = {"group": d, "conjugate": conjugate_of(d, self._cyclic.sectors)}
                part = whole.part(f"{name}-{d}", "the disc of identical sectors", partial(self._large, d), of_group)
                self.set_ups.append(replace(part, computation=new))
            of_diameters = [set_up.structure(partial(computed, d)) for d, set_up in enumerate(self.set_ups)]
            if len({set_up.computation for set_up in self.set_ups}) > 1:  # their shapes may differ in sign, and by rotations
                of_diameters = [computed(d) for d in range(len(self.set_ups))]
                for set_up in self.set_ups:
                    set_up.forget(new)
            for set_up, structure in zip(self.set_ups, of_diameters):
                set_up.store(structure)
        return whole_disc(of_diameters, scene, factors, whole.log)

    @cached_property
    def _groups(self) -> PerGroup[Structure]:
        make: Callable = self._of_diameter
        return PerGroup(make, self._cyclic.diameter, self._cyclic.diameters)

    @cached_property
    def _parts(self) -> Assembled:
        """The matrices of the sector; collective if they are not assembled yet."""
        explicit = not self._cyclic.whole
        return without_reference(assembled(self.whole.scene, self.whole.comm, self.whole.log, explicit), False)

    def _of_diameter(self, d: int) -> Structure:
        """Return the structure of a sector index, and store it."""
        n_sectors = self._cyclic.sectors
        if 2 * d > n_sectors:
            return self._groups.of_group(n_sectors - d).of_conjugate(d)
        of_group = {"groups": self._groups, "group": d, "conjugate": conjugate_of(d, n_sectors)}
        set_up = self.whole.part(f"diameter-{d}", f"nodal diameter {d}: the structure", partial(self._large, d), of_group)
        return self._stored(set_up, lambda: of_diameter(self._parts, d, self._groups, self.whole.log))

    def _stored(self, set_up: SetUp, build: Callable[[], Structure]) -> Structure:
        """Return the structure of a nodal diameter, stored or by ``build``, and store it."""
        structure = set_up.structure(build)
        set_up.store(structure)
        self.set_ups.append(set_up)
        return structure

    def _large(self, d: int, modes_of: ModesOf) -> Factored:
        """Return matrices, factor and modes of a nodal diameter."""
        if not self._cyclic.whole:
            return factored_of(at_diameter(self._parts, d), self.whole.log, None, modes_of)
        linearised = self._of_diameters[d]
        modes = modes_of(linearised)
        correct_soft_modes(linearised, modes, self.whole.scene)
        return Factored(linearised, modes, self._parts.mesh)

    @cached_property
    def _of_diameters(self) -> list[Linearised]:
        """The stuck structures of all nodal diameters; collective if they are not factored yet."""
        return factors_of_diameters(all_diameters(self._parts), self.whole.log)
