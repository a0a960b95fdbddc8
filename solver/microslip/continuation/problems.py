"""What is continued: the harmonic-balance equation along one parameter or several.

A problem says which frequency, level and further damping its parameters stand for, and how these change with them.  Homotopies
lead to a first point of the forced response: at the end of their parameter they are that problem (docs/theory.md, section 7).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self

from ..harmonic.balance import HarmonicBalance
from ..harmonic.operating_point import OperatingPoint, Rate


class Problem(Protocol):
    """The equation along k parameters."""

    @property
    def equation(self) -> HarmonicBalance: ...

    @property
    def is_constant(self) -> bool:
        """Whether every value of the parameters has the same solution: one point stands for all."""

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        """Return what k parameters stand for.  Local."""

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rate, ...]:
        """Return how the operating point changes with each of k parameters.  Local."""

    def where(self, parameter: float) -> str:
        """Name a point in a message, by the parameter that is swept.  Local."""

    def without_solution(self, parameter: float, why: str) -> str:
        """Say that no way led to a first point there, and ``why`` Newton's method did not.  Local."""

    def with_equation(self, equation: HarmonicBalance) -> Self:
        """Return the same problem with another resolution or hold of the equation.  Local."""


@dataclass(frozen=True, eq=False)
class _OfEquation:
    equation: HarmonicBalance

    @property
    def is_constant(self) -> bool:
        return False

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        raise NotImplementedError

    def with_equation(self, equation: HarmonicBalance) -> Self:
        return replace(self, equation=equation)

    def where(self, parameter: float) -> str:
        return self.at((parameter,)).text

    def without_solution(self, parameter: float, why: str) -> str:
        return (
            f"hb: no first point at {self.where(parameter)}: neither from the linear response ({why}) nor from rest, "
            "over the level or over further damping; begin at another frequency, or raise [solver] samples"
        )


@dataclass(frozen=True, eq=False)
class ForcedResponse(_OfEquation):
    """The response to loads of one level [N] over the frequency [rad/s]."""

    level: float

    @property
    def is_constant(self) -> bool:
        return self.equation.harmonics.is_constant

    def without_solution(self, parameter: float, why: str) -> str:
        if not self.is_constant:
            return super().without_solution(parameter, why)
        return (
            f"hb: no equilibrium under the static load of {self.level:.4g} N was found ({why}): is it more than friction and "
            "preload carry?"
        )

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        return OperatingPoint(parameters[0], self.level)

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rate, ...]:
        return (Rate(omega=1.0),)


@dataclass(frozen=True, eq=False)
class LevelHomotopy(_OfEquation):
    """The same equation at a fixed frequency [rad/s], over the level of the loads [N]."""

    omega: float

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        return OperatingPoint(self.omega, parameters[0])

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rate, ...]:
        return (Rate(level=1.0),)


@dataclass(frozen=True, eq=False)
class DampingHomotopy(_OfEquation):
    """The same equation at a fixed frequency and level, with further damping that falls to none as the parameter t rises to 1.

    docs/theory.md, eq. (7.3): D_n gets i n omega sigma with sigma = omega (1 - t) / t, alike for all
    modes, as of a damping matrix sigma M.
    """

    omega: float  # rad/s
    level: float  # N

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        (t,) = parameters
        return OperatingPoint(self.omega, self.level, self.omega * (1.0 - t) / t)

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rate, ...]:
        return (Rate(sigma=-self.omega / parameters[0] ** 2),)

    def where(self, parameter: float) -> str:
        return f"{super().where(parameter)}, damped further by {self.at((parameter,)).sigma:.3g} M"
