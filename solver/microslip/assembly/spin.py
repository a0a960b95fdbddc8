"""Rotation about the axis of the model: accelerations of points that turn with it (docs/theory.md, section 12)."""

from __future__ import annotations

import numpy as np

from ..tables.constant_loads import Statics
from ..tables.structure_tables import StructureTables

_NO_AXIS = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)  # where nothing turns


def stated_statics(tables: StructureTables) -> Statics:
    """Return [statics] of a structure that has it.  Local."""
    if tables.statics is None:
        raise ValueError("a structure without [statics] has no loads at rest")
    return tables.statics


def spin_of(tables: StructureTables, share: float = 1.0) -> np.ndarray:
    """Return a share of Omega^2 (1 - a a^T), (3, 3) [1/s2]: acceleration per distance from the axis.  Local."""
    speed = 0.0 if tables.statics is None else tables.statics.rotation_speed
    a = np.array((tables.axis_of_rotation or _NO_AXIS)[0], dtype=float)
    a /= np.linalg.norm(a)
    return share * speed**2 * (np.eye(3) - np.outer(a, a))


def outward(tables: StructureTables, points: np.ndarray) -> np.ndarray:
    """Return the acceleration of points (..., 3) [m] away from the axis, (..., 3) [m/s2].  Local."""
    return (points - np.array((tables.axis_of_rotation or _NO_AXIS)[1])) @ spin_of(tables)
