"""The base class of all tables: no unknown keys, the kinds of numbers of keys, their units in model files."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, cast

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PrivateAttr

from ..messages.words import listed
from .units import Units, times

HIGHEST_FREQUENCY = 1e9  # Hz: beyond it a frequency is a slip of the pen
LARGEST_NUMBER = 2**62  # of nodes and DOFs


def any_of(words: tuple[str, ...], last: str = "or") -> str:
    """Return '"a", "b" or "c"'."""
    return listed([f'"{word}"' for word in words], last)


def not_zero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a vector that is not zero; ValueError otherwise.  Local."""
    if not any(vector):
        raise ValueError("zero vector")
    return vector


def number_not_zero(value: float) -> float:
    """Return a number that is not 0; ValueError otherwise.  Local."""
    if value == 0.0:
        raise ValueError("zero")
    return value


def no_duplicates(values: tuple) -> tuple:
    """Return values that are all different; ValueError otherwise.  Local."""
    if len(set(values)) < len(values):
        raise ValueError("an entry twice")
    return values


def rising(limits: tuple[float, float]) -> tuple[float, float]:
    """Return two rising limits; ValueError otherwise.  Local."""
    if not limits[0] < limits[1]:
        raise ValueError("not rising")
    return limits


def each_above_the_one_before(values: tuple[int, ...]) -> tuple[int, ...]:
    """Return values, at least one, that rise; ValueError otherwise.  Local."""
    if not values or any(b <= a for a, b in pairwise(values)):
        raise ValueError("not rising")
    return values


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
    """A table of a scene or of a model file: no other keys, no conversions, no NaN, not to be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True)
    QUANTITIES: ClassVar[Mapping[str, str]] = {}  # of keys with a unit: which of ``Units`` it is in a model file
    _folder: Path = PrivateAttr(default=Path())

    def model_post_init(self, context: Any, /) -> None:
        """Take the folder that paths are relative to from the context of the validation."""
        if context:
            self._folder = context["path"].parent

    def file_of(self, key: str) -> Path | None:
        """Return the file that a key names, relative to the folder of the scene; None where it names none.  Local."""
        stated = getattr(self, key)
        return None if stated is None else self._folder / stated

    @classmethod
    def of_file(cls, **keys: Any) -> Self:
        """Return a table as a model file states it: in the file's units and maybe in part; None: not stated.  Local.

        Nothing is checked before a scene takes it over (``in_si``), so that messages are those of the scene.
        """
        unknown = keys.keys() - cls.model_fields.keys()
        if unknown:
            raise TypeError(f"{cls.__name__} has no key {', '.join(sorted(unknown))}")
        needed = {key: None for key, field in cls.model_fields.items() if field.is_required()}
        stated = {key for key, value in keys.items() if value is not None}
        return cast(Self, cls.model_construct(stated, **{**needed, **keys}))

    def with_keys(self, **keys: Any) -> Self:
        """Return the table with some keys changed, unchecked as those of a model file.  Local."""
        made = self.model_copy(update=keys)
        for name in made.__dict__.keys() - type(self).model_fields.keys():
            del made.__dict__[name]  # derived from the earlier keys
        return made

    def in_si(self, units: Units) -> dict[str, Any]:
        """Return the stated keys of a table of a model file in ``units``, as a scene states them.  Local."""
        stated = {key: value for key, value in self if key in self.model_fields_set and value is not None}
        return {key: _in_si(value, units, self.QUANTITIES.get(key)) for key, value in stated.items()}

    def exactly_one(self, *keys: str) -> str:
        """Return the one key of ``keys`` that is given; ValueError if it is none or several."""
        given = [key for key in keys if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"exactly one of {', '.join(keys)} is needed, found {' and '.join(given) or 'none'}")
        return given[0]


def _in_si(value: Any, units: Units, quantity: str | None) -> Any:
    """Return the value of a key in SI units; tables in a tuple as dictionaries."""
    if isinstance(value, tuple) and value and isinstance(value[0], Table):
        return tuple(table.in_si(units) for table in value)
    return value if quantity is None else times(value, getattr(units, quantity))
