"""Declarations of the quantities of a converged point, from which arrays, files, their reader and the guide's tables follow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, get_type_hints

import numpy as np

from .error_parts import PARTS
from .multipliers import N_MULTIPLIERS
from .sensitivities import COMMON, NUMBERS, OF_PEAK

QUADRATURES = ("cos", "sin")
LABELS = {
    "parts": PARTS,
    "quadratures": QUADRATURES,
    "complex": ("real", "imaginary"),
    "numbers": NUMBERS,
    "of_peak": OF_PEAK,
    "common": COMMON,
}  # names of the entries along axes
TEXT = "O"  # NumPy's kind of texts


def unchanged(value: Any) -> Any:
    """Return the value itself.  Local."""
    return value


def hertz(omega: float) -> float:
    """Return the frequency [Hz] of an angular frequency [rad/s].  Local."""
    return omega / (2.0 * np.pi)


@dataclass(frozen=True)
class Column:
    """A column of frf.csv: one number of a quantity, for each output where the quantity has an axis of outputs."""

    name: str
    meaning: str
    of: Callable[[Any], Any] = unchanged  # of the stored value of a point and output
    digits: int = 13  # significant ones


@dataclass(frozen=True)
class Quantity:
    """The meaning of a field of a dataclass, such as :class:`~microslip.points.branch.Point`, and its form in files.

    A quantity is ``optional`` if its field may be None, or if files of earlier versions lack it.  A level has the array of an
    optional quantity only if all its points have a value; otherwise the array is None, and cells of tables are empty.
    """

    dataset: str  # its name in results.h5; the array of a level has the same name without the unit at its end
    over: str  # its axes at a point, names of `axis_lengths` separated by spaces; "" for a single number or text
    unit: str
    meaning: str
    kind: str = "f8"  # NumPy's name of its type, or TEXT
    columns: tuple[Column, ...] = ()
    stored: Callable[[Any], Any] = unchanged  # the stored form of the field's value
    field: str = ""
    optional: bool = False
    earlier: str = ""  # the name of the dataset in files of earlier versions

    @property
    def name(self) -> str:
        """The name of the dataset without its unit."""
        return self.dataset.removesuffix(f"_{self.unit}")

    @property
    def axes(self) -> tuple[str, ...]:
        """The names of the axes at a point."""
        return tuple(self.over.split())

    @property
    def is_motion(self) -> bool:
        """Whether it is a motion or force of all pairs: large, and not needed for pictures."""
        return "pairs" in self.axes and "coefficients" in self.axes

    def of(self, point: Any) -> Any:
        """Return the stored value of a point; None if it was not computed."""
        value = getattr(point, self.field)
        return None if value is None else self.stored(value)

    def shape(self, lengths: dict[str, int]) -> tuple[int, ...]:
        """Return the shape of a point's value, from the lengths of all axes."""
        return tuple(lengths[axis] for axis in self.axes)

    def array(self, points: list, lengths: dict[str, int]) -> np.ndarray | None:
        """Return the stored values of all points, (n, ...), zeros for missing harmonics; None where the class allows it."""
        values, shape = [self.of(point) for point in points], self.shape(lengths)
        if self.optional and (not values or any(value is None for value in values)):
            return None
        return np.array([_padded(value, shape) for value in values], dtype=self.kind).reshape(len(points), *shape)

    def cells(self, point: Any, output: int) -> list[str]:
        """Return the cells of its columns, in the row of a point and output."""
        value = self.of(point) if self.columns else None
        if value is None:
            return [""] * len(self.columns)
        of_output = value[output] if "outputs" in self.axes else value
        return [f"{column.of(of_output):.{column.digits}g}" for column in self.columns]


def number(
    name: str, unit: str, meaning: str, kind: str = "f8", digits: int = 13, stored: Callable[[Any], Any] = unchanged
) -> Quantity:
    """Return a single number that is a dataset of results.h5 and a column of frf.csv of the same name."""
    return Quantity(name, "", unit, meaning, kind, (Column(name, meaning, digits=digits),), stored)


def axis_lengths(n_outputs: int, n_pairs: int, N_H: int) -> dict[str, int]:
    """Return the length of every axis that a quantity may have, by name."""
    return {
        "outputs": n_outputs,
        "pairs": n_pairs,
        "directions": 3,
        "tangents": 2,
        "corners": 4,
        "quadratures": len(QUADRATURES),
        "coefficients": N_H,
        "parts": len(PARTS),
        "multipliers": N_MULTIPLIERS,
        "complex": 2,
        "of_peak": len(OF_PEAK),
        "numbers": len(NUMBERS),
        "common": len(COMMON),
    }


def declared(kind: type) -> tuple[Quantity, ...]:
    """Return the quantities with which the fields of a dataclass are annotated, in the order of the fields."""
    hints = get_type_hints(kind, include_extras=True)
    given = [(field, *getattr(hints[field.name], "__metadata__", ())) for field in fields(kind)]
    return tuple(
        replace(quantity, field=field.name, optional=quantity.optional or field.default is None)
        for field, *of in given
        for quantity in of
    )


def _padded(values: Any, shape: tuple[int, ...]) -> Any:
    """Return the values of a point, padded with zeros for harmonics that it does not have."""
    if not shape or np.shape(values)[-1] == shape[-1]:
        return values
    return np.pad(values, [(0, 0)] * (len(shape) - 1) + [(0, shape[-1] - np.shape(values)[-1])])
