"""The keys of a joint for each contact law.  No NumPy, so that a scene can be read without it."""

from __future__ import annotations

from dataclasses import dataclass

ELASTIC_COULOMB, ROUGH, IWAN = "elastic-coulomb", "rough", "iwan"


@dataclass(frozen=True, kw_only=True)
class Keys:
    """The keys of a law, by their names in a scene."""

    needed: tuple[str, ...]  # required for a joint of surfaces, in addition to the preload
    of_file: tuple[str, ...]  # replaced by columns where pairs come from a CSV file
    needed_with_pairs: tuple[str, ...] = ()  # required in addition to these columns
    further: tuple[str, ...] = ()  # optional

    @property
    def all(self) -> tuple[str, ...]:
        """All keys of the law."""
        return (*self.of_file, *self.needed_with_pairs, *self.further)


KEYS = {
    ELASTIC_COULOMB: Keys(
        needed=("friction", "tangential_stiffness", "normal_stiffness"),
        of_file=("friction", "tangential_stiffness", "normal_stiffness"),
        further=("preload", "gap", "plane_point", "friction_limit"),
    ),
    ROUGH: Keys(
        needed=("friction", "roughness_height"),
        of_file=("friction", "roughness_height", "roughness_pressure", "tangential_ratio"),
        further=("preload", "friction_limit", "exponent", "sliders"),
    ),
    IWAN: Keys(
        needed=("slip_force", "tangential_stiffness", "normal_stiffness", "chi", "beta"),
        of_file=("slip_force", "tangential_stiffness", "normal_stiffness"),
        needed_with_pairs=("chi", "beta"),
        further=("sliders",),
    ),
}
