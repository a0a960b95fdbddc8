"""The table [cyclic]: a disc of alike sectors, of which the model is one."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from .table import Direction, Positive, Table, Vector


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
                raise ValueError("wave belongs to nodal_diameter; the sign of engine_order says it already")
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
