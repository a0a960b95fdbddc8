"""A converged point as arrays and texts, bitwise.  Local."""

from __future__ import annotations

from operator import attrgetter
from typing import Any, get_type_hints

import numpy as np

from ..points.branch import Point
from .records import Arrays

_KINDS = get_type_hints(Point)
_NUMBERS = {name: kind for name, kind in _KINDS.items() if kind in (float, int, bool)}  # all exact as doubles: counts are small
_ARRAYS = tuple(name for name in _KINDS if name not in _NUMBERS and name != "notes")
_numbers = attrgetter(*_NUMBERS)


def of_point(point: Point) -> tuple[Arrays, dict[str, Any]]:
    """Return the arrays and texts of a point."""
    arrays = {name: value for name in _ARRAYS if (value := getattr(point, name)) is not None}
    arrays["numbers"] = np.array(_numbers(point), dtype=float)
    return arrays, {"notes": list(point.notes)} if point.notes else {}


def to_point(arrays: Arrays, texts: dict[str, Any]) -> Point:
    """Return the point that arrays and texts describe."""
    doubles = arrays["numbers"].astype(float, casting="safe")  # refuses complex numbers
    numbers = {name: kind(value) for (name, kind), value in zip(_NUMBERS.items(), doubles, strict=True)}
    values: dict[str, Any] = {name: value for name, value in arrays.items() if name != "numbers"}
    return Point(**numbers, **values, notes=tuple(texts.get("notes", ())))
