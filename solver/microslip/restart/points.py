"""A converged point as arrays and texts, to the last bit.  Local."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from ..continuation.branch import Point
from .records import Arrays

_NUMBERS = tuple(field.name for field in fields(Point) if field.name != "notes")


def of_point(point: Point) -> tuple[Arrays, dict[str, Any]]:
    """Return the arrays and texts of a point."""
    arrays = {name: np.asarray(value) for name in _NUMBERS if (value := getattr(point, name)) is not None}
    return arrays, {"notes": list(point.notes)}


def to_point(arrays: Arrays, texts: dict[str, Any]) -> Point:
    """Return the point of arrays and texts."""
    values: dict[str, Any] = {name: value.item() if value.ndim == 0 else value for name, value in arrays.items()}
    return Point(**values, notes=tuple(texts["notes"]))
