"""Rotation about the axis of the model: accelerations of points that turn with it (docs/theory.md, section 12)."""

import numpy as np

from ..tables.constant_loads import Statics
from ..tables.structure_tables import StructureTables

_NO_AXIS = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)  # where nothing turns


def stated_statics(tables: StructureTables) -> Statics:
    """Return [statics] of a structure that has it.  Local."""
    if tables.statics is None:
        raise ValueError("a structure without [statics] has no loads at rest")
    return tables.statics


def angular_velocity(tables: StructureTables) -> np.ndarray:
    """Return the angular velocity vector Omega a, (3,) [rad/s]; 0 where nothing turns.  Local."""
    speed = 0.0 if tables.statics is None else tables.statics.rotation_speed
    a = np.array((tables.axis_of_rotation or _NO_AXIS)[0], dtype=float)
    return speed * a / np.linalg.norm(a)


def spin_of(tables: StructureTables, share: float = 1.0) -> np.ndarray:
    """Return a share of Omega^2 (1 - a a^T), (3, 3) [1/s2]: acceleration per distance from the axis.  Local."""
    Omega = angular_velocity(tables)
    return share * (Omega @ Omega * np.eye(3) - np.outer(Omega, Omega))


def outward(tables: StructureTables, points: np.ndarray) -> np.ndarray:
    """Return the acceleration of points (..., 3) [m] away from the axis, (..., 3) [m/s2].  Local."""
    return (points - np.array((tables.axis_of_rotation or _NO_AXIS)[1])) @ spin_of(tables)
