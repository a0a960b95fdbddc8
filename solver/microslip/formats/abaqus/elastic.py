"""Elastic constants and thermal expansions, and their axes: *ORIENTATION."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...messages.errors import MeshError
from ...tables.structure import Orientation
from ...tables.table import Vector
from ..draft import vector
from .cards import Card, number
from .scopes import Scope, rotation_about

# numbers of a material card, by the distinguishing part of its TYPE
VALUES = {
    ("DENSITY", "ISO"): 1,
    ("ELASTIC", "ISO"): 2,
    ("ELASTIC", "ORTHO"): 9,
    ("ELASTIC", "ENGINEERING"): 9,
    ("ELASTIC", "ANISO"): 21,
    ("EXPANSION", "ISO"): 1,
    ("EXPANSION", "ORTHO"): 3,
}
_ORTHO = (0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2), (3, 3), (4, 4), (5, 5)  # entries of the (6, 6), in the card's order
_ANISO = tuple((row, column) for column in range(6) for row in range(column + 1))


def kind_of_material(card: Card) -> str | None:
    """Return the key in VALUES of a material card, or None.  Local."""
    stated = "".join(card.parameter("TYPE", "ISO").split()) if card.keyword != "DENSITY" else "ISO"
    return next((kind for keyword, kind in VALUES if keyword == card.keyword and stated.startswith(kind)), None)


def keys_of(keyword: str, kind: str, values: Sequence[float]) -> dict[str, Any]:
    """Return the numbers of a material card as keys of a ``Material``.  Local."""
    if keyword == "DENSITY":
        return {"density": values[0]}
    if keyword == "EXPANSION":
        return {"expansion": values[0] if len(set(values)) == 1 else tuple(values)}
    if kind == "ISO":
        return {"young": values[0], "poisson": values[1]}
    if kind == "ENGINEERING":
        return {"young": tuple(values[:3]), "poisson": tuple(values[3:6]), "shear": tuple(values[6:])}
    six = np.zeros((6, 6))
    for (i, j), value in zip(_ORTHO if kind == "ORTHO" else _ANISO, values, strict=True):
        six[i, j] = six[j, i] = value
    return {"elasticity": tuple(map(tuple, six.tolist()))}


def orientation_of(scope: Scope, card: Card) -> Orientation | None:
    """Return the axes that an *ORIENTATION states by coordinates, in axes of the model; None for other definitions.  Local.

    Raises
    ------
    MeshError : data lines that do not define axes
    """
    system, definition = card.parameter("SYSTEM", "RECTANGULAR"), card.parameter("DEFINITION", "COORDINATES")
    if system not in ("RECTANGULAR", "CYLINDRICAL") or definition != "COORDINATES":
        return None
    lines = [[number(word) if word else 0.0 for word in words] for words, _ in card.lines()]
    if not lines or len(lines) > 2 or len(lines[0]) < 6 or any(value is None for line in lines for value in line):
        return None
    points = np.array([*lines[0], 0.0, 0.0, 0.0][:9], dtype=float).reshape(3, 3)
    turn, angle = _further_turn(lines[1] if len(lines) > 1 else [], card)
    if system == "CYLINDRICAL":
        points = scope.placed(points)
        axis = points[1] - points[0]
        if not axis.any():
            raise MeshError(f"{card.where}: *ORIENTATION: the two points of its axis coincide")
        return Orientation.of_file(axis=vector(axis), axis_point=vector(points[0])) if angle == 0.0 else None
    x, y = points[0] - points[2], points[1] - points[2]
    if not np.cross(x, y).any():
        raise MeshError(f"{card.where}: *ORIENTATION: its points lie on one line and span no plane")
    return Orientation.of_file(directions=_turned(x, y, turn, np.deg2rad(angle), scope, card))


def _further_turn(words: list, card: Card) -> tuple[int, float]:
    """Return the axis, from 0, and the angle [degrees] of the second data line."""
    axis, angle = (*words, *(0.0, 0.0)[len(words) :])[:2]
    if axis not in (0.0, 1.0, 2.0, 3.0):
        raise MeshError(f"{card.where}: *ORIENTATION turns about axis {axis:g}; expected 1, 2 or 3")
    return max(int(axis) - 1, 0), angle


def _turned(x: np.ndarray, y: np.ndarray, k: int, angle: float, scope: Scope, card: Card) -> tuple[Vector, Vector]:
    """Return the first two axes from x and y in their plane, turned about axis ``k`` and with the instance."""
    third = np.cross(x, y)
    axes = np.stack([x, np.cross(third, x), third])
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    axes = axes @ (scope.rotation @ rotation_about(axes[k], angle, card.where)).T
    return vector(axes[0]), vector(axes[1])
