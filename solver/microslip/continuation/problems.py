"""The problems of continuation: the harmonic-balance equation with one parameter or several.

A problem defines the operating point for its k parameters, its rates with them, the k - 1 constraints in addition to the row of
a step, and the curve in closed form that its solutions follow while no pair slips.  The first parameter is swept.
Homotopies lead to a first point of the forced response: at the end of their parameter they are that problem (docs/theory.md,
section 7).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from ..harmonic.balance import HarmonicBalance
from ..harmonic.operating_point import LawParameter, OperatingPoint, Rates
from ..harmonic.parameter_rates import rate_of_linear_motion
from .constraint_rows import Constraint, EnclosedRow
from .iterate import Iterate
from .linear_levels import sticks


class KnownCurve(Protocol):
    """A curve in closed form near the solutions of a problem, and equal to them where it is valid."""

    def at(self, parameter: float) -> Iterate:
        """Return the point of the curve at a value of the swept parameter; not to be written into.  Local.

        It is not finite on a resonance without damping.
        """

    def holds(self, parameters: tuple[float, ...]) -> bool:
        """Return whether the point of the curve at k parameters is a solution.  Collective."""

    def on(self, there: Iterate) -> Iterate:
        """Return the point of the curve at the parameters of an iterate.  Local."""

    def rate(self, parameters: tuple[float, ...]) -> np.ndarray:
        """Return the rate of the motion with the swept parameter, (n_owned, 3, N_H).  Local."""


class Problem(Protocol):
    """The equation along k parameters."""

    @property
    def equation(self) -> HarmonicBalance:
        """The harmonic balance equation."""

    @property
    def units(self) -> tuple[float, ...]:
        """Units of the k - 1 parameters other than the swept one, whose unit is the range; in the norm of steps and in SNES."""

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """The k - 1 constraints in addition to that of the step."""

    @property
    def maximum(self) -> EnclosedRow | None:
        """The constraint that replaces one of these rows: an amplitude is at its maximum."""

    @property
    def curve(self) -> KnownCurve:
        """The curve of first guesses, equal to the solutions where it is valid."""

    @property
    def law_parameters(self) -> tuple[LawParameter, ...]:
        """The parameters of the contact law that vary, in the order of those of the operating point."""

    def allows(self, parameters: tuple[float, ...]) -> bool:
        """Return whether k parameters have a meaning: a frequency is above zero, a damping need not be, a law has its values.

        Collective where the law varies.
        """

    @property
    def is_constant(self) -> bool:
        """Whether every value of the parameters has the same solution: one point represents all."""

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        """Return the operating point for k parameters.  Local."""

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rates, ...]:
        """Return how the operating point changes with each of k parameters.  Local."""

    def where(self, parameter: float) -> str:
        """Name a point in a message, by the parameter that is swept.  Local."""

    def without_solution(self, parameter: float, why: str) -> str:
        """Return the error of a branch without a first point; ``why`` is the failure of Newton's method.  Local."""

    def with_equation(self, equation: HarmonicBalance) -> Self:
        """Return the same problem with another resolution or hold of the equation.  Local."""


@dataclass(frozen=True, eq=False)
class ProblemBase:
    """The members of a problem that most problems share."""

    equation: HarmonicBalance

    @property
    def is_constant(self) -> bool:
        """Whether every value of the parameters has the same solution: not so."""
        return False

    @property
    def units(self) -> tuple[float, ...]:
        """No units: there is one parameter, the swept one."""
        return ()

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """No constraints in addition to that of the step."""
        return ()

    @property
    def maximum(self) -> EnclosedRow | None:
        """None: no row is that of a maximum."""
        return None

    @property
    def curve(self) -> KnownCurve:
        """The linear response."""
        return LinearResponse(self)

    @property
    def law_parameters(self) -> tuple[LawParameter, ...]:
        """No parameters: the contact law does not vary."""
        return ()

    def allows(self, parameters: tuple[float, ...]) -> bool:
        """Return whether all parameters are above zero and the law has its values.  Collective where the law varies."""
        has_sense = min(parameters) > 0.0
        return has_sense and (not self.law_parameters or self.equation.allows(self.at(parameters)))

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        """Return the operating point of k parameters: of each problem.  Local."""
        raise NotImplementedError

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rates, ...]:
        """Return the rates of the operating point with k parameters: of each problem.  Local."""
        raise NotImplementedError

    def with_equation(self, equation: HarmonicBalance) -> Self:
        """Return the same problem with another equation.  Local."""
        return replace(self, equation=equation)

    def where(self, parameter: float) -> str:
        """Return the operating point on the known curve, for messages.  Local."""
        return self.at(self.curve.at(parameter).parameters).text

    def without_solution(self, parameter: float, why: str) -> str:
        """Return the message for lack of a first point, and ``why`` Newton's method did not converge.  Local."""
        return (
            f"hb: no first point at {self.where(parameter)}: neither from the linear response ({why}) nor from rest, "
            "over the level or over further damping; begin at another frequency, or raise [solver] samples"
        )


@dataclass(frozen=True, eq=False)
class LinearResponse:
    """The forced response while all pairs stick, closed, at fixed values of the parameters other than the swept one."""

    problem: Problem
    fixed_parameters: tuple[float, ...] = ()

    def at(self, parameter: float) -> Iterate:
        """Return the linear response at a value of the swept parameter; not finite on a resonance without damping.  Local."""
        return self._of((parameter, *self.fixed_parameters))

    def holds(self, parameters: tuple[float, ...]) -> bool:
        """Return whether all pairs stick in the linear response.  Collective."""
        at = self.problem.at(parameters)
        return sticks(self.problem.equation.under(at), at)

    def on(self, there: Iterate) -> Iterate:
        """Return the linear response at the parameters of an iterate.  Local."""
        return self._of(there.parameters)

    def _of(self, parameters: tuple[float, ...]) -> Iterate:
        with np.errstate(divide="ignore", invalid="ignore"):
            at = self.problem.at(parameters)
            U = self.problem.equation.under(at).linear_motion(at)
        return Iterate(U, parameters, self.problem.equation.harmonics)

    def rate(self, parameters: tuple[float, ...]) -> np.ndarray:
        """Return the rate of the linear response with the swept parameter, (n_owned, 3, N_H).  Local."""
        at = self.problem.at(parameters)
        return rate_of_linear_motion(self.problem.equation.under(at), at, self.problem.rates(parameters)[0])


@dataclass(frozen=True, eq=False)
class ForcedResponse(ProblemBase):
    """The response to loads of one level [N] over the frequency [rad/s]."""

    level: float

    @property
    def is_constant(self) -> bool:
        """Whether the motion is constant: harmonic 0 alone."""
        return self.equation.harmonics.is_constant

    def without_solution(self, parameter: float, why: str) -> str:
        """Return the message for lack of a first point, or of an equilibrium under static loads.  Local."""
        if not self.is_constant:
            return super().without_solution(parameter, why)
        return (
            f"hb: no equilibrium under the static load of {self.level:.4g} N was found ({why}): is it more than friction and "
            "preload carry?"
        )

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        """Return the operating point at a frequency [rad/s].  Local."""
        return OperatingPoint(parameters[0], self.level)

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rates, ...]:
        """Return the rate of the operating point with the frequency.  Local."""
        return ({"omega": 1.0},)


@dataclass(frozen=True, eq=False)
class LevelHomotopy(ProblemBase):
    """The same equation at a fixed frequency [rad/s], over the level of the loads [N]."""

    omega: float

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        """Return the operating point at a level [N].  Local."""
        return OperatingPoint(self.omega, parameters[0])

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rates, ...]:
        """Return the rate of the operating point with the level.  Local."""
        return ({"level": 1.0},)


@dataclass(frozen=True, eq=False)
class DampingHomotopy(ProblemBase):
    """The same equation at a fixed frequency and level, with further damping that falls to none as the parameter t rises to 1.

    docs/theory.md, eq. (7.3): D_n gets i n omega sigma with sigma = omega (1 - t) / t, alike for all
    modes, as of a damping matrix sigma M.
    """

    omega: float  # rad/s
    level: float  # N

    def at(self, parameters: tuple[float, ...]) -> OperatingPoint:
        """Return the operating point at t, eq. (7.3).  Local."""
        (t,) = parameters
        return OperatingPoint(self.omega, self.level, self.omega * (1.0 - t) / t)

    def rates(self, parameters: tuple[float, ...]) -> tuple[Rates, ...]:
        """Return the rate of the operating point with t.  Local."""
        return ({"sigma": -self.omega / parameters[0] ** 2},)

    def where(self, parameter: float) -> str:
        """Return the operating point on the known curve and its further damping, for messages.  Local."""
        return f"{super().where(parameter)}, damped further by {self.at((parameter,)).sigma:.3g} M"
