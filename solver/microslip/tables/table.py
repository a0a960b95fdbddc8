"""What every table of a scene is made of: no key that it does not know, and the kinds of numbers that keys take."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ..parallel.words import listed

HIGHEST_FREQUENCY = 1e9  # Hz: beyond it a frequency is a slip of the pen
LARGEST_NUMBER = 2**62  # of nodes and DOFs


def any_of(words: tuple[str, ...], last: str = "or") -> str:
    """Return '"a", "b" or "c"'."""
    return listed([f'"{word}"' for word in words], last)


def not_zero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(vector):
        raise ValueError("zero vector")
    return vector


def number_not_zero(value: float) -> float:
    if value == 0.0:
        raise ValueError("zero")
    return value


def no_duplicates(values: tuple) -> tuple:
    if len(set(values)) < len(values):
        raise ValueError("an entry twice")
    return values


def rising(limits: tuple[float, float]) -> tuple[float, float]:
    if not limits[0] < limits[1]:
        raise ValueError("not rising")
    return limits


Name = Annotated[str, Field(pattern=r'^[^\s,"/\\\x00-\x1f](?:[^,"/\\\x00-\x1f]*[^\s,"/\\\x00-\x1f])?$')]
Positive = Annotated[float, Field(gt=0)]
TwoPositive = tuple[Positive, Positive]
ThreePositive = tuple[Positive, Positive, Positive]
Six = tuple[float, float, float, float, float, float]
NotNegative = Annotated[float, Field(ge=0)]
Ratio = Annotated[float, Field(ge=0, lt=1)]
ModeNumber = Annotated[int, Field(ge=1, le=LARGEST_NUMBER)]
NotZero = Annotated[float, AfterValidator(number_not_zero)]
Frequency = Annotated[float, Field(gt=0, le=HIGHEST_FREQUENCY)]
Number = Annotated[int, Field(ge=0, le=LARGEST_NUMBER)]
Vector = tuple[float, float, float]
Direction = Annotated[Vector, AfterValidator(not_zero)]


class Table(BaseModel):
    """A table of the scene: no other keys, no conversions, no NaN, not to be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def exactly_one(self, *keys: str) -> str:
        """Return the one key of ``keys`` that is given; ValueError if it is none or several."""
        given = [key for key in keys if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"exactly one of {', '.join(keys)} is needed, found {' and '.join(given) or 'none'}")
        return given[0]
