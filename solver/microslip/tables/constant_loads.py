"""The table [statics]: constant loads before the vibration."""

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field, PrivateAttr, model_validator

from .table import Direction, Name, NotNegative, Number, Positive, Table, Vector


class Force(Table):
    """[[statics.forces]]: a constant force, shared by its nodes, or a moment."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {"force": "force"}

    position: Vector | None = Field(None, description="three coordinates [x, y, z] in m; the nearest node is loaded")
    node: Number | None = Field(None, description="a node number of the mesh, a whole number of at least 0")
    group: str | None = Field(None, min_length=1, description="the name of a group in the mesh; its nodes share the force")
    point: str | None = Field(None, min_length=1, description="the name of one of the [[points]]")
    force: Direction | None = Field(None, description="the force [x, y, z] in N, three numbers, not all 0")
    moment: Direction | None = Field(None, description="the moment [x, y, z] in N m, three numbers, not all 0")

    @model_validator(mode="after")
    def _place(self):
        self.exactly_one("position", "node", "group", *["point"] * (self.point is not None))
        if self.moment is None and self.force is None:
            raise ValueError(f"force is missing: expected {Force.model_fields['force'].description}; or moment")
        self.exactly_one("force", *["moment"] * (self.moment is not None))
        if self.moment is not None and self.group is None and self.point is None:
            raise ValueError("moment acts on a group of nodes or on a point; a node alone bears none")
        return self


class Pressure(Table):
    """[[statics.pressures]]: a constant pressure on a surface."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {"pressure": "stress"}

    group: str = Field(min_length=1, description="the name of a group of faces in the mesh")
    pressure: float = Field(description="the pressure in Pa, a number; above 0 it pushes into the body")


class Temperature(Table):
    """[[statics.temperatures]]: a body that is warmer than where it is free of stress."""

    group: str = Field(min_length=1, description="the name of a group of volume elements in the mesh, of one of the bodies")
    temperature: float | None = Field(None, description="the temperature in K above that without stress, a number")
    field: str | None = Field(None, min_length=1, description="the name of a field of the mesh that has it at the nodes")
    file: str | None = Field(None, min_length=1, description="the path of a CSV file with the columns node and temperature")

    @model_validator(mode="after")
    def _check_exactly_one(self):
        self.exactly_one("temperature", "field", "file")
        return self


class MovedSupport(Table):
    """[[statics.displacements]]: nodes of a support, moved before the vibration and held there."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {"displacement": "length"}

    group: str = Field(min_length=1, description="the name of a group in the mesh, of nodes that [[supports]] hold")
    displacement: Direction = Field(
        description="the displacement [x, y, z] in m, three numbers, not all 0; directions other than 0 are those of a support"
    )


class Bolt(Table):
    """[[statics.bolts]]: a shank that is cut and pulled together."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {"force": "force"}

    group: str = Field(min_length=1, description="the name of a group of faces that cross the shank inside the mesh")
    force: Positive | None = Field(None, description="the clamping force in N to which the bolt is tightened, a number above 0")
    shortening: Positive | None = Field(None, description="the length in m that is taken out of the shank, a number above 0")
    name: Name | None = Field(None, description="a name for tables and messages, without comma, quote or slash")
    _number: int = PrivateAttr(default=1)  # of the bolts of a scene

    @property
    def label(self) -> str:
        """Its name, or its number among the bolts."""
        return self.name or f"bolt {self._number}"

    @model_validator(mode="after")
    def _check_exactly_one(self):
        self.exactly_one("force", "shortening")
        return self


class Statics(Table):
    """[statics]: what the joint carries before it vibrates."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {"rotation_speed": "rotation_speed"}

    rotation_speed: NotNegative = Field(0.0, description="the speed of rotation in rad/s, a number of at least 0")
    stress_stiffening: bool = Field(
        True, description="true or false: the vibration feels the stress at rest and, where it rotates, spin softening"
    )
    coriolis: bool = Field(False, description="true or false: microslip modes takes in the Coriolis forces of the rotation")
    deformed_shape: bool = Field(False, description="true or false: the vibration feels the change of shape at rest, too")
    large_displacements: bool = Field(
        False, description="true or false: equilibrium and vibration in the deformed shape, with strains of second order"
    )
    steps: int = Field(10, ge=1, le=100_000, description="the number of load steps, a whole number of at least 1")
    forces: tuple[Force, ...] = Field((), description="tables, each headed [[statics.forces]], with a place and force")
    pressures: tuple[Pressure, ...] = Field((), description="tables, each headed [[statics.pressures]], with group and pressure")
    temperatures: tuple[Temperature, ...] = Field(
        (), description="tables, each headed [[statics.temperatures]], with group and temperature"
    )
    bolts: tuple[Bolt, ...] = Field(
        (), description="tables, each headed [[statics.bolts]], with group and force, or with group and shortening"
    )
    displacements: tuple[MovedSupport, ...] = Field(
        (), description="tables, each headed [[statics.displacements]], with group and displacement"
    )

    @model_validator(mode="after")
    def _named(self):
        for i, bolt in enumerate(self.bolts, 1):
            bolt._number = i
        return self

    @model_validator(mode="after")
    def _large(self):
        if self.large_displacements and not self.stress_stiffening:
            raise ValueError("large_displacements = true needs stress_stiffening = true")
        if self.large_displacements and self.bolts:
            raise ValueError("large_displacements = true: bolts are tightened with small displacements; leave out one of them")
        return self

    @model_validator(mode="after")
    def _deformed(self):
        if self.deformed_shape and not self.stress_stiffening:
            raise ValueError("deformed_shape = true needs stress_stiffening = true")
        return self
