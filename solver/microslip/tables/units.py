"""Consistent units of model files, and the values of their quantities in SI units."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Units:
    """A consistent set of units: force is mass times length over time squared."""

    length: float  # m
    mass: float  # kg
    time: float = 1.0  # s

    @property
    def stress(self) -> float:
        """Unit of stress [Pa]."""
        return self.mass / self.length / self.time**2

    @property
    def density(self) -> float:
        """Unit of density [kg/m3]."""
        return self.mass / self.length**3

    @property
    def force(self) -> float:
        """Unit of force [N]."""
        return self.mass * self.length / self.time**2

    @property
    def stiffness(self) -> float:
        """Unit of stiffness [N/m]."""
        return self.mass / self.time**2

    @property
    def damping(self) -> float:
        """Unit of damping [N s/m]."""
        return self.mass / self.time

    @property
    def contact_stiffness(self) -> float:
        """Unit of contact stiffness [N/m3]."""
        return self.stress / self.length

    @property
    def inertia(self) -> float:
        """Unit of inertia [kg m2]; times 1/s2 it is that of a rotational stiffness [N m/rad]."""
        return self.mass * self.length**2

    @property
    def rotation_speed(self) -> float:
        """Unit of rotation speed [rad/s]."""
        return 1.0 / self.time

    @property
    def rotational_stiffness(self) -> float:
        """Unit of rotational stiffness [N m/rad]."""
        return self.inertia / self.time**2


def times(value: Any, factor: float) -> Any:
    """Return a number, or numbers in tuples, times a factor.  Local."""
    return tuple(times(entry, factor) for entry in value) if isinstance(value, tuple) else factor * value


UNITS = {
    "m-kg-s": Units(1.0, 1.0),
    "mm-t-s": Units(1e-3, 1e3),
    "mm-kg-s": Units(1e-3, 1.0),
    "mm-kg-ms": Units(1e-3, 1.0, 1e-3),
    "in-lbf-s": Units(0.0254, 4.4482216152605 / 0.0254),  # lbf s2/in
}
