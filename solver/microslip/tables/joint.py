"""A table [[joints]]: its surfaces, and the parameters of its contact law."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from ..contact.keys import ELASTIC_COULOMB, KEYS, ROUGH
from ..messages.words import listed, quoted
from .table import Direction, Name, NotNegative, Positive, Table, TwoPositive, Vector, any_of

LAWS_OF_KEY = {key: tuple(law for law in KEYS if key in KEYS[law].all) for keys in KEYS.values() for key in keys.all}
OF_FILE = {key for keys in KEYS.values() for key in keys.of_file}  # keys whose place a CSV file of pairs takes
OWN = tuple(key for key, laws in LAWS_OF_KEY.items() if ELASTIC_COULOMB not in laws)  # in addition to the keys of every joint


def check_law(joint: Mapping[str, Any], stated: Set[str]) -> None:
    """Raise ValueError where a key of a joint belongs to another law, or its law does not take a value.  Local.

    ``joint`` has the values of all keys, ``stated`` are those that the scene states.
    """
    law = joint["law"]
    for key, laws in LAWS_OF_KEY.items():
        if key in stated and law not in laws:
            raise ValueError(f"{key} belongs to law = {' or '.join(map(quoted, laws))}; this joint has law = {quoted(law)}")
    for key in ("friction", "tangential_stiffness"):
        if isinstance(joint[key], tuple):
            _check_directions(joint, key)
    if law == ROUGH and joint["pairs"] is None:
        _check_rough(joint)


def _check_directions(joint: Mapping[str, Any], key: str) -> None:
    """Raise ValueError where a joint states two numbers of a key that its law takes for both directions alike."""
    if joint["law"] != ELASTIC_COULOMB:
        raise ValueError(f"{key}: law = {quoted(joint['law'])} takes one number for both directions")
    if joint["friction_limit"] != "separate":
        raise ValueError(f'{key} = [x, y] needs friction_limit = "separate": a friction circle has one number for both')
    if joint["parameters"] is not None or joint["fields"]:
        given = "parameters, a file" if joint["parameters"] is not None else "fields, a table"
        raise ValueError(f"{key} = [x, y] with {given} of values for each point: state one number")


def _check_rough(joint: Mapping[str, Any]) -> None:
    """Raise ValueError where rough surfaces have no pressure at rest, or their power law is incompletely stated."""
    if joint["preload"] == "static" and joint["exponent"] is None:
        raise ValueError(
            f'preload = "static": the exponential of law = {quoted(ROUGH)} has a pressure at every approach; state in Pa '
            "the pressure of the unloaded mesh, from which [statics] starts; or a power law, by exponent and roughness_pressure, "
            "which starts without pressure"
        )
    if joint["preload"] == 0.0:
        raise ValueError(f"preload = 0: rough surfaces that carry nothing have no stiffness, law = {quoted(ROUGH)} needs some")
    if (joint["exponent"] is None) != (joint["roughness_pressure"] is None):
        there, missing = ("exponent", "roughness_pressure")[:: 1 if joint["roughness_pressure"] is None else -1]
        raise ValueError(f"{there} without {missing}: a power takes both, the exponential neither")


OfPoints = Literal["friction", "tangential_stiffness", "normal_stiffness", "preload", "gap"]
if TYPE_CHECKING:
    Law = str
else:
    Law = Literal[tuple(KEYS)]
OF_SURFACES = tuple(
    "preload gap tolerance against next_sector plane_point plane_normal pairing tangent parameters fields".split()
)


class Joint(Table):
    """[[joints]]: two surfaces in contact, one on rigid ground, or pairs of DOFs."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {
        "tangential_stiffness": "contact_stiffness",
        "normal_stiffness": "contact_stiffness",
        "tolerance": "length",
    }

    name: Name = Field(description="a name for pictures and messages, without comma, quote or slash")
    surfaces: Annotated[tuple[str, ...], Field(min_length=1, max_length=2)] | None = Field(
        None, description="the names of two different groups of faces in the mesh, body 1 and body 2; with against, of one"
    )
    against: Literal["ground", "plane"] | None = Field(
        None, description='"ground", rigid and of the shape of the surface, or "plane", rigid and flat'
    )
    next_sector: bool = Field(False, description="true or false: with [cyclic], the second surface is that of the next sector")
    plane_point: Vector | None = Field(None, description="a point of the plane, three coordinates [x, y, z] in m")
    plane_normal: Direction | None = Field(
        None, description="the direction [x, y, z] from the plane into the body, three numbers, not all 0"
    )
    pairing: Literal["auto", "nodes", "points", "mortar", "projected"] = Field(
        "auto", description='"nodes" that match, "points", "mortar" or "projected" nodes of any meshes, or "auto"'
    )
    pairs: str | None = Field(None, min_length=1, description="the path of a CSV file of contact pairs")
    node_pairs: str | None = Field(
        None,
        min_length=1,
        description="the path of a CSV file of pairs of nodes with normals and areas, of a model given as matrices",
    )
    law: Law = Field(ELASTIC_COULOMB, description=f"the contact law, {any_of(tuple(KEYS))}")
    friction: NotNegative | TwoPositive | None = Field(None, description="the friction coefficient, a number of at least 0")
    tangential_stiffness: Positive | TwoPositive | None = Field(
        None, description="the stiffness per unit area in N/m3, a number above 0"
    )
    normal_stiffness: Positive | None = Field(None, description="the stiffness per unit area in N/m3, a number above 0")
    preload: NotNegative | Literal["static"] | None = Field(
        None, description='the contact pressure at rest in Pa, a number of at least 0 (open ones have a gap), or "static"'
    )
    gap: NotNegative | Literal["geometry"] = Field(
        0.0, description='the distance at rest in m, a number of at least 0, or "geometry": that of the mesh'
    )
    friction_limit: Literal["circle", "separate"] = Field("circle", description='"circle" or "separate"')
    tolerance: Positive | None = Field(
        None, description="the distance in m within which nodes, or parts of the two surfaces, meet, a number above 0"
    )
    tangent: Direction | None = Field(
        None, description="the direction [x, y, z] whose projection on the surface is x of the pairs, three numbers, not all 0"
    )
    parameters: str | None = Field(None, min_length=1, description="the path of a CSV file of values for each contact point")
    fields: dict[OfPoints, str] = Field(
        {},
        description='a table of names of fields of the mesh, as { friction = "mu" }, for friction, preload, gap or a stiffness',
    )
    roughness_height: Positive | None = Field(None, description="the length in m over which the pressure grows, a number above 0")
    roughness_pressure: Positive | None = Field(
        None, description="the pressure in Pa at an approach of roughness_height, a number above 0"
    )
    exponent: float | None = Field(None, gt=1, le=1000, description="the power of the approach, a number above 1, at most 1000")
    tangential_ratio: Positive | None = Field(None, description="the tangential over the normal stiffness, a number above 0")
    slip_force: Positive | None = Field(None, description="the force in N at which all of the joint slips, a number above 0")
    chi: float | None = Field(
        None, gt=-1, le=0, description="the exponent of the sliders' distribution, a number above -1 and at most 0"
    )
    beta: NotNegative | None = Field(
        None, description="the stiffness of the last slider over that of the others, a number of at least 0"
    )
    sliders: int | None = Field(None, ge=2, le=1000, description="the number of elements a pair, a whole number from 2 to 1000")

    start: float = Field(0.0, description="the phase of the cycle in rad at which its sliders start, a number")

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of its surfaces, none where a file lists the pairs."""
        return self.surfaces or ()

    @property
    def has_gap_of_mesh(self) -> bool:
        """Whether the distance at rest is that of the mesh."""
        return self.gap == "geometry" or self.against == "plane"

    @property
    def is_separate(self) -> bool:
        """Whether each tangential direction has a friction limit of its own."""
        return self.friction_limit == "separate"

    @property
    def stated_values(self) -> dict[str, float]:
        """The values of all its points, of two numbers that along x: 0 where the mesh, the statics or nothing has them."""
        values = {"preload": self.preload, "gap": 0.0 if self.has_gap_of_mesh else self.gap}
        values |= {key: getattr(self, key) for key in ("friction", "tangential_stiffness", "normal_stiffness")}
        return {key: _along_x(value) for key, value in values.items()}

    @property
    def values_of_law(self) -> dict[str, float | None]:
        """The parameters of its law in addition to those of every joint."""
        pairs = {key: getattr(self, key) for key in ("friction", "tangential_stiffness")}
        along_y = {f"{key}_y": value[1] for key, value in pairs.items() if isinstance(value, tuple)}
        return {**{key: getattr(self, key) for key in OWN}, **along_y, "start": self.start}

    @property
    def lacking(self) -> list[str]:
        """What a model file does not state of two surfaces in contact, and a joint needs."""
        return [key for key in ("friction", "tangential_stiffness", "normal_stiffness", "gap") if getattr(self, key) is None]

    @field_validator("surfaces")
    @classmethod
    def _two_surfaces(cls, surfaces):
        if surfaces is not None and (len(set(surfaces)) < len(surfaces) or not all(surfaces)):
            raise ValueError("one surface twice")
        return surfaces

    @model_validator(mode="after")
    def _complete(self):
        has_gap = self.gap != 0.0 or self.against == "plane"
        keys = KEYS[self.law]
        needed = [*keys.needed] + ["preload"] * (not has_gap and self.law in LAWS_OF_KEY["preload"])
        kind = self.exactly_one("surfaces", "pairs", *["node_pairs"] * (self.node_pairs is not None))
        has_pairs = kind == "pairs"
        if has_pairs:
            given = sorted({*OF_FILE, *OF_SURFACES} & self.model_fields_set)
            if given:
                raise ValueError(f"{given[0]} belongs to a joint of surfaces; a CSV file states it for each pair")
        missing = [key for key in (keys.needed_with_pairs if has_pairs else needed) if getattr(self, key) is None]
        if missing:
            more = f"; and {listed(missing[1:])}" if len(missing) > 1 else ""
            raise ValueError(f"{missing[0]} is missing: expected {type(self).model_fields[missing[0]].description}{more}")
        check_law(dict(self), self.model_fields_set)
        if has_pairs:
            return self
        if has_gap and self.preload and self.preload != "static":
            gap = f"gap = {self.gap:g}" if isinstance(self.gap, float) and self.gap else "a gap from the geometry"
            raise ValueError(f"{gap} with preload = {self.preload}: an open joint carries no preload; keep one")
        if kind == "node_pairs":
            self._of_nodes()
        else:
            self._grounded()
        return self

    def _of_nodes(self) -> None:
        """Raise ValueError for keys that find pairs, or that need a mesh: a file lists them."""
        for key in ("against", "next_sector", "plane_point", "plane_normal", "pairing", "tolerance", "fields"):
            if key in self.model_fields_set:
                raise ValueError(f"{key} belongs to a joint of surfaces; node_pairs lists the pairs")
        if self.gap == "geometry" or self.preload == "static":
            raise ValueError("a joint of node_pairs states gap and preload as numbers, or in a file, parameters")

    def _grounded(self) -> None:
        """Raise ValueError unless one surface comes with ground and two without, and a plane with its place."""
        assert self.surfaces is not None, "a joint of surfaces"
        if len(self.surfaces) == 1 and self.against is None:
            raise ValueError('surfaces names one group; name two, or state against = "ground" or "plane"')
        if self.against is not None and self.pairing == "mortar":
            raise ValueError(f'pairing = "mortar" takes two surfaces; with against = "{self.against}" take "nodes" or "points"')
        if self.against is not None and self.next_sector:
            raise ValueError(f'next_sector = true: the next sector is another body, and against = "{self.against}" is none')
        if len(self.surfaces) == 2 and self.against is not None:
            raise ValueError(f'against = "{self.against}" takes the place of the second surface; name one')
        for key in ("plane_point", "plane_normal"):
            if self.against == "plane" and getattr(self, key) is None:
                raise ValueError(f"{key} is missing: expected {type(self).model_fields[key].description}")
            if self.against != "plane" and getattr(self, key) is not None:
                raise ValueError(f'{key} belongs to against = "plane"')
        if self.against == "plane" and self.gap not in (0.0, "geometry"):
            raise ValueError(f"gap = {self.gap:g}: the distance from a plane is that of the mesh; leave it out")
        if self.against == "ground" and self.gap == "geometry":
            raise ValueError('gap = "geometry": ground has the shape of the surface; state a number, or against = "plane"')


def _along_x(value: float | str | tuple[float, float] | None) -> float:
    """Return a number, of two the first; 0 of a word or nothing."""
    if isinstance(value, tuple):
        return value[0]
    return 0.0 if value is None or isinstance(value, str) else value
