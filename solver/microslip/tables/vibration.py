"""The tables of loads, outputs and damping."""

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from .table import Direction, ModeNumber, Name, NotNegative, NotZero, Number, Ratio, Table, Vector, no_duplicates

Quantity = Literal["displacement", "velocity", "acceleration", "stress", "strain", "contact_force"]
Component = Literal["xx", "yy", "zz", "xy", "yz", "zx", "normal"]
UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s2", "stress": "Pa", "strain": "1", "contact_force": "N"}
_PLACES = ("position", "node", "group", "point", "dof")
_PLACES_OF_OUTPUTS = ("position", "node", "point", "dof")
_PHASES = ("travelling", "engine_order")


class Load(Table):
    """[[loads]]: level x direction, pressure or forces of a file, in one harmonic."""

    position: Vector | None = Field(None, description="three coordinates [x, y, z] in m; the nearest node is loaded")
    node: Number | None = Field(None, description="a node number of the mesh, a whole number of at least 0")
    group: str | None = Field(None, min_length=1, description="the name of a group in the mesh; its nodes share the load")
    point: str | None = Field(None, min_length=1, description="the name of one of the [[points]]")
    dof: Number | None = Field(None, description="a DOF number of the matrices, a whole number of at least 0")
    direction: Direction | None = Field(None, description="three numbers [x, y, z], not all 0; each level multiplies them")
    moment: Direction | None = Field(
        None, description="a moment [x, y, z] at a point in N m per N of the level, three numbers, not all 0"
    )
    scale: float = Field(1.0, description="a number that each level multiplies, for a load on a dof")
    pressure: NotZero | None = Field(
        None, description="the pressure in Pa on a group of faces, a number, not 0; above 0 it pushes into the body"
    )
    travelling: Direction | None = Field(
        None, description="how the phase of the pressure changes along x, y, z, three numbers in rad/m, not all 0"
    )
    engine_order: int | None = Field(
        None, ge=-10_000, le=10_000, description="how often the phase of the pressure turns about [model] axis, a whole number"
    )
    forces: str | None = Field(None, min_length=1, description="the path of a CSV file of forces, which each level multiplies")
    base_acceleration: Direction | None = Field(
        None,
        description="the acceleration of the supports, three numbers [x, y, z], not all 0; each level in m/s2 multiplies them",
    )
    harmonic: int = Field(1, ge=0, le=10_000, description="the harmonic of the load, a whole number of at least 0")
    phase: float = Field(0.0, description="the phase in rad, a number")

    @property
    def phases(self) -> tuple[float, ...]:
        """The phase of each of its real shapes [rad]: of the real part and, where there may be one, of the imaginary part.

        A load whose phase varies over the structure is two real shapes, a quarter of a cycle apart: docs/theory.md, section 13.
        """
        varies = self.travelling is not None or self.engine_order is not None or self.forces is not None
        return (self.phase, self.phase + 0.5 * math.pi) if varies else (self.phase,)

    @property
    def unit(self) -> str:
        """What a level of this load counts; "1" where the load itself has a unit."""
        if self.base_acceleration is not None:
            return "m/s2"
        return "1" if self.pressure is not None or self.forces is not None else "N"

    @model_validator(mode="after")
    def _place(self):
        if self.base_acceleration is not None:
            other_keys = (*_PLACES, "direction", "moment", "scale", "pressure", *_PHASES, "forces")
            _refuse_keys(self, "base_acceleration, which moves all supports", *other_keys)
        elif self.forces is not None:
            _refuse_keys(
                self, "forces: the file holds places and values", *_PLACES, "direction", "moment", "scale", "pressure", *_PHASES
            )
        elif self.pressure is not None:
            _refuse_keys(
                self,
                "a pressure: it acts on a group of faces",
                "position",
                "node",
                "point",
                "dof",
                "direction",
                "moment",
                "scale",
            )
            self.exactly_one("group")
            if all(getattr(self, key) is not None for key in _PHASES):
                raise ValueError("exactly one of travelling, engine_order may vary the phase, found both")
        else:
            _refuse_keys(self, "a force: it belongs to a pressure", *_PHASES)
            _check_place(self, self.exactly_one("position", "node", "group", "dof", *["point"] * (self.point is not None)))
        return self


class Output(Table):
    """[[outputs]]: the displacement of one node along one direction, or what follows from displacements and contact forces."""

    name: Name = Field(description="a name for tables and pictures, without comma, quote or slash")
    position: Vector | None = Field(None, description="three coordinates [x, y, z] in m; the nearest node is meant")
    node: Number | None = Field(None, description="a node number of the mesh, a whole number of at least 0")
    point: str | None = Field(None, min_length=1, description="the name of one of the [[points]]")
    dof: Number | None = Field(None, description="a DOF number of the matrices, a whole number of at least 0")
    direction: Direction | None = Field(None, description="three numbers [x, y, z], not all 0")
    rotation: Direction | None = Field(None, description="the axis [x, y, z] of a point's rotation in rad, not all 0")
    quantity: Quantity = Field(
        "displacement", description='"displacement", "velocity", "acceleration", "stress", "strain" or "contact_force"'
    )
    component: Component | None = Field(
        None, description='"xx", "yy", "zz", "xy", "yz" or "zx" of stress and strain; "normal" of a contact force'
    )
    body: str | None = Field(None, min_length=1, description="the NAME of a table [bodies.NAME], whose stress or strain is meant")
    joint: str | None = Field(None, min_length=1, description="the name of one of [[joints]], whose contact force is meant")
    absolute: bool = Field(False, description="true or false: with the motion of the base, under base_acceleration")

    @property
    def unit(self) -> str:
        """What the output is measured in."""
        return UNITS[self.quantity] if self.rotation is None else UNITS[self.quantity].replace("m", "rad")

    @property
    def order(self) -> int:
        """How often it is the derivative of a displacement by time."""
        return ("velocity", "acceleration").index(self.quantity) + 1 if self.quantity in ("velocity", "acceleration") else 0

    @model_validator(mode="after")
    def _place(self):
        if self.quantity == "contact_force":
            _refuse_keys(
                self, 'quantity = "contact_force": it belongs to a joint', *_PLACES_OF_OUTPUTS, "rotation", "body", "absolute"
            )
            if self.joint is None:
                raise ValueError(f"joint is missing: expected {Output.model_fields['joint'].description}")
            self.exactly_one("direction", "component")
            if self.component not in (None, "normal"):
                raise ValueError(
                    f'component = "{self.component}" belongs to stress and strain; of a contact force expected "normal"'
                )
        elif self.quantity in ("stress", "strain"):
            _refuse_keys(self, f'quantity = "{self.quantity}"', "dof", "point", "direction", "rotation", "joint", "absolute")
            self.exactly_one("position", "node")
            if self.component in (None, "normal"):
                raise ValueError(f'component is missing: expected "xx", "yy", "zz", "xy", "yz" or "zx" of {self.quantity}')
        else:
            _refuse_keys(self, f'quantity = "{self.quantity}"', "component", "body", "joint")
            _check_place(self, self.exactly_one("position", "node", "dof", *["point"] * (self.point is not None)))
        return self


def _refuse_keys(entry: Load | Output, why: str, *keys: str) -> None:
    """Raise ValueError if one of the keys is given."""
    for key in keys:
        if key in entry.model_fields_set:
            raise ValueError(f"{key} does not go with {why}")


def _check_place(entry: Load | Output, key: str) -> None:
    """Raise ValueError unless a node comes with a direction, a dof without one, and a point with that or its rotation."""
    turn = "moment" if isinstance(entry, Load) else "rotation"
    if getattr(entry, turn) is not None:
        if key != "point":
            raise ValueError(f"{turn} belongs to a point; nodes do not turn")
        entry.exactly_one("direction", turn)
        if "scale" in entry.model_fields_set:
            raise ValueError("scale belongs to a load on a dof; with a moment, state it there")
        return
    if key == "dof":
        if entry.direction is not None:
            raise ValueError("direction belongs to a node; a dof has its own")
    elif entry.direction is None:
        raise ValueError(f"direction is missing: expected {type(entry).model_fields['direction'].description}")
    elif "scale" in entry.model_fields_set:
        raise ValueError("scale belongs to a load on a dof; with a direction, state it there")


def _each_mode_once(pairs: tuple[tuple[int, float], ...]) -> tuple[tuple[int, float], ...]:
    no_duplicates(tuple(mode for mode, _ in pairs))
    return pairs


class Damping(Table):
    """[damping]: of every mode, of some by number, or Rayleigh's; structural damping in addition."""

    ratio: float | None = Field(None, ge=0, lt=1, description="the ratio to critical damping, a number of at least 0 and below 1")
    rayleigh: tuple[NotNegative, NotNegative] | None = Field(
        None, description="[alpha, beta] of C = alpha M + beta K in 1/s and s, two numbers of at least 0"
    )
    ratios: Annotated[tuple[Ratio, ...], Field(min_length=1)] | None = Field(
        None, description="the ratios of modes 1, 2, ..., a list of numbers of at least 0 and below 1"
    )
    modes: Annotated[tuple[tuple[ModeNumber, Ratio], ...], AfterValidator(_each_mode_once), Field(min_length=1)] | None = Field(
        None, description="a list of [number of a mode, its ratio], each mode once, ratios of at least 0 and below 1"
    )
    structural: float | None = Field(
        None, ge=0, le=1, description="the loss factor of the bodies, a number of at least 0 and at most 1"
    )

    @model_validator(mode="after")
    def _check_exactly_one(self):
        if self.rayleigh is not None:
            for key in ("ratios", "modes"):
                if getattr(self, key) is not None:
                    raise ValueError(f"{key} goes with ratio, which all other modes have; rayleigh damps every mode already")
        if self.ratios is not None and self.modes is not None:
            raise ValueError("exactly one of ratios, modes is needed, found both")
        if self.modes is not None and self.ratio is None:
            raise ValueError(
                f"ratio is missing, which the modes that are not named have: expected {Damping.model_fields['ratio'].description}"
            )
        if self.rayleigh is not None or (self.ratios is None and self.structural is None):
            self.exactly_one("ratio", "rayleigh")
        return self
