"""The table [cyclic]: a disc of alike sectors, of which the model is one, or one whose sectors differ by factors."""

import math
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from .table import Direction, NotNegative, Number, Positive, Ratio, Table, Vector

QUANTITIES = ("friction", "preload", "gap", "contact_stiffness", "stiffness", "density", "load")  # quantities with a factor


class SectorFactors(Table):
    """[[cyclic.sector]]: factors of the values of one sector relative to those of the model."""

    number: Number = Field(description="the number of the sector, from 0, that of the model")
    friction: NotNegative = Field(1.0, description="a factor of the friction coefficients, a number of at least 0")
    preload: NotNegative = Field(1.0, description="a factor of the preloads, a number of at least 0")
    gap: NotNegative = Field(1.0, description="a factor of the gaps, a number of at least 0")
    contact_stiffness: Positive = Field(1.0, description="a factor of the contact stiffnesses, a number above 0")
    stiffness: Positive = Field(1.0, description="a factor of Young's modulus of the blade, a number above 0")
    density: Positive = Field(1.0, description="a factor of the density of the blade, a number above 0")
    load: float = Field(1.0, description="a factor of the loads, a number")


class Scatter(Table):
    """[cyclic] scatter: standard deviations of the factors of the sectors, which are drawn from normal distributions about 1."""

    friction: Ratio = Field(0.0, description="the standard deviation of the factors of friction, a number from 0 to below 1")
    preload: Ratio = Field(0.0, description="the standard deviation of the factors of preload, a number from 0 to below 1")
    gap: Ratio = Field(0.0, description="the standard deviation of the factors of gaps, a number from 0 to below 1")
    contact_stiffness: Ratio = Field(
        0.0, description="the standard deviation of the factors of contact stiffness, a number from 0 to below 1"
    )
    stiffness: Ratio = Field(
        0.0, description="the standard deviation of the factors of Young's modulus, a number from 0 to below 1"
    )
    density: Ratio = Field(0.0, description="the standard deviation of the factors of density, a number from 0 to below 1")
    load: Ratio = Field(0.0, description="the standard deviation of the factors of the loads, a number from 0 to below 1")
    seed: Number = Field(description="the seed of the random numbers, a whole number of at least 0")


class Cyclic(Table):
    """[cyclic]: the sectors of a disc, its axis, the faces at which they meet, and the wave that excites it.

    Sectors are numbered in the positive sense about the axis; sector 0 is that of the model, sector 1 lies beyond its high face.
    """

    sectors: Annotated[int, Field(ge=2, le=10_000)] = Field(description="the number of sectors, a whole number of at least 2")
    axis: Direction = Field(description="the direction of the axis, three numbers [x, y, z], not all 0")
    axis_point: Vector = Field((0.0, 0.0, 0.0), description="a point of the axis, three coordinates [x, y, z] in m")
    faces: tuple[str, str] | None = Field(
        None,
        description="two groups of the mesh, [low, high]: the high face is the low one turned by one sector about the axis; "
        "without it the sectors meet in joints alone",
    )
    tolerance: Positive | None = Field(
        None, description="how far in m a node of the turned low face may lie from that of the high face, a number above 0"
    )
    engine_order: int | None = Field(
        None, ge=-10_000, le=10_000, description="how often the excitation repeats in one revolution, a whole number"
    )
    nodal_diameter: int | None = Field(None, ge=0, description="the nodal diameter of the excitation, 0 to half of the sectors")
    wave: Literal["backward", "forward"] | None = Field(
        None, description='"backward": sector 1 leads sector 0, as under a field at rest; or "forward": it lags'
    )
    whole: bool = Field(
        False, description="true or false: whether the pairs of all sectors are unknowns; sectors may then differ"
    )
    sector: tuple[SectorFactors, ...] = Field((), description="tables, each headed [[cyclic.sector]], with number and factors")
    table: str | None = Field(
        None, min_length=1, description="the path of a CSV file with factors of each sector, relative to the scene's folder"
    )
    scatter: Scatter | None = Field(
        None, description="standard deviations of factors drawn at random, as { stiffness = 0.02, friction = 0.3, seed = 1 }"
    )
    blades: tuple[str, ...] | None = Field(
        None, description="the bodies that factors of stiffness and density change, a list of names; all bodies without it"
    )

    @property
    def angle(self) -> float:
        """The angle of a sector [rad]."""
        return 2.0 * math.pi / self.sectors

    @property
    def wave_number(self) -> int:
        """h: sector s + 1 leads sector s by h times the angle of a sector, in harmonic 1."""
        if self.engine_order is not None:
            return self.engine_order
        assert self.nodal_diameter is not None, "one of them is stated"
        return -self.nodal_diameter if self.wave == "forward" else self.nodal_diameter

    def diameter(self, n: int) -> int:
        """Return the sector index of harmonic n, 0 to ``sectors`` - 1; d and ``sectors`` - d are conjugate.  Local.

        docs/theory.md, eq. (14.1).
        """
        return n * self.wave_number % self.sectors

    @property
    def diameters(self) -> tuple[int, ...]:
        """The sector indices that harmonics may have, rising."""
        return tuple(sorted({self.diameter(n) for n in range(self.sectors)}))

    @property
    def differs(self) -> bool:
        """Whether sectors may differ."""
        return bool(self.sector or self.table or self.scatter)

    @field_validator("faces")
    @classmethod
    def _two_faces(cls, faces):
        if faces is not None and (faces[0] == faces[1] or not all(faces)):
            raise ValueError("one face twice")
        return faces

    @model_validator(mode="after")
    def _one_wave(self):
        self.exactly_one("engine_order", "nodal_diameter")
        N, d = self.sectors, self.nodal_diameter
        if d is None:
            if self.wave is not None:
                raise ValueError("wave belongs to nodal_diameter; the sign of engine_order already determines it")
            return self
        if 2 * d > N:
            alias, turned = min(d % N, -d % N), d % N > -d % N
            way = "the wave in the other direction" if turned else "the same wave"
            raise ValueError(
                f"nodal_diameter = {d} is above half of {N} sectors; at the sectors it is that of {alias}, {way}: state that"
            )
        if self.wave is None and 0 < 2 * d < N:
            raise ValueError(f"wave is missing: expected {Cyclic.model_fields['wave'].description}")
        return self

    @model_validator(mode="after")
    def _sectors_that_differ(self):
        stated = [key for key in ("sector", "table", "scatter") if getattr(self, key)]
        if stated and not self.whole:
            raise ValueError(f"{stated[0]} states how sectors differ, and [cyclic] computes one for all: state whole = true")
        if len(stated) > 1:
            raise ValueError(f"exactly one of sector, table, scatter states how sectors differ, found {' and '.join(stated)}")
        numbers = [each.number for each in self.sector]
        if len(set(numbers)) < len(numbers):
            twice = next(number for number in numbers if numbers.count(number) > 1)
            raise ValueError(f"sector {twice} is stated twice")
        if numbers and max(numbers) >= self.sectors:
            raise ValueError(f"sector {max(numbers)} is stated; {self.sectors} sectors have the numbers 0 to {self.sectors - 1}")
        if self.blades is not None and not self.whole:
            raise ValueError("blades belongs to whole = true")
        return self
