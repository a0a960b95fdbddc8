"""The table [wear]: wear law, number of cycles, and the response that wears the joint."""

from typing import Literal

from pydantic import Field, model_validator

from ..tables.table import Frequency, Name, NotNegative, Positive, Table

ENERGY, ARCHARD = "energy", "archard"
UNITS = {ENERGY: "m3/J", ARCHARD: "m3/(N m)"}  # of the coefficient


class Wear(Table):
    """[wear]: the law, its coefficients, the number of cycles and the jumps, for ``microslip wear``."""

    law: Literal["energy", "archard"] = Field(
        "energy", description='"energy": volume per friction energy, or "archard": volume per normal force and slip distance'
    )
    coefficient: NotNegative | dict[Name, NotNegative] = Field(
        description="the wear coefficient of all joints, or a table of those of each, as { NAME = 1e-14 }, numbers of at least 0 "
        "in m3/J or m3/(N m)"
    )
    cycles: Positive = Field(description="the number of cycles, a number above 0")
    level: Positive | None = Field(None, description="the level in N; the highest of levels if left out")
    output: str | None = Field(None, description="the name of an output, whose peak is followed; the first one if left out")
    frequency: Frequency | None = Field(
        None, description="a frequency in Hz, above 0 and at most 1e9, that stays; if left out, that of the peak"
    )
    jump: Positive | None = Field(None, description="the largest depth in m that a jump of cycles may add, a number above 0")
    tolerance: float = Field(
        1e-2, gt=0, lt=1, description="the error of a jump over the depth, by halves of the jump, a number above 0 and below 1"
    )
    area: Positive | dict[Name, Positive] | None = Field(
        None, description="the area in m2 of each pair of matrices, or a table of joints, as { NAME = 1e-6 }, numbers above 0"
    )

    @model_validator(mode="after")
    def _one_place(self):
        if self.frequency is not None and self.output is not None:
            raise ValueError("output names the peak that is followed; with frequency it means nothing")
        return self

    def coefficient_of(self, joint: str) -> float | None:
        """Return the coefficient of a joint; None where it has none."""
        return self.coefficient.get(joint) if isinstance(self.coefficient, dict) else self.coefficient

    def area_of(self, joint: str) -> float | None:
        """Return the stated area of each pair of a joint; None where none is stated."""
        return self.area.get(joint) if isinstance(self.area, dict) else self.area
