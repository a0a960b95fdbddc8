"""Rows of the system that state harmonic 1 of an output (docs/theory.md, section 7, eq. (7.14))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..error_estimate.estimate import output_amplitude, sensitivity
from .constraint_rows import Place, Scaling

DIFFERENCE = 1e-5  # of the unit of a parameter, over which its rates, where the motion stays, are central differences


@dataclass(frozen=True, eq=False)
class _OutputRow:
    """A row of cosine and sine (2,) [m] of harmonic 1 of an output, which follow from the contact forces."""

    output: int
    size: float  # m
    takes_linearisation: ClassVar[bool] = True

    def of(self, a: np.ndarray) -> float:
        """Return the row.  Local."""
        raise NotImplementedError

    def rate(self, a: np.ndarray) -> np.ndarray:
        """Return its derivatives by the output, (2,) [1/m].  Local."""
        raise NotImplementedError

    def of_motion(self, U: np.ndarray, scaling: Scaling) -> float:
        """Return 0: the output follows from the contact forces.  Local."""
        return 0.0

    def value(self, of_motion: float, place: Place) -> float:
        """Return the row.  Collective."""
        return place.linear.equation.comm.bcast(self.of(self._output(place, place.nu)))

    def gradient(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Return its derivatives.  Collective: a broadcast, and the communication of :meth:`_output`."""
        linear, scaling = place.linear, place.scaling
        equation, forces = linear.equation, linear.forces
        model, rate = equation.model_at(linear.at), self.rate(self._output(place, place.nu))
        by_forces = -np.tensordot(rate, sensitivity(model, linear.at.omega)[self._rows(model.n_outputs)], 1)
        owned = by_forces[model.owned_rows].reshape(equation.shape)[forces.active_owned]
        by_motion = np.zeros(equation.shape)
        columns = np.matmul(owned.reshape(len(owned), 1, linear.P.shape[1]), linear.P)
        by_motion[forces.active_owned] = scaling.U * columns.reshape(owned.shape)
        steps = DIFFERENCE * np.eye(len(place.nu))
        by_nu = [rate @ (self._output(place, place.nu + h) - self._output(place, place.nu - h)) for h in steps]
        return by_motion, equation.comm.bcast(np.array(by_nu) / (2.0 * DIFFERENCE))

    def _output(self, place: Place, nu: np.ndarray) -> np.ndarray:
        """Return cosine and sine of the output under the motion of a place, at scaled parameters.

        Local; collective as :meth:`.HarmonicBalance.under` and for the forces where the contact law has other parameters.
        """
        at, linear = place.operating_point(tuple(map(float, nu * place.scaling.parameters))), place.linear
        equation, forces = linear.equation, linear.forces
        if at.law != linear.at.law:
            equation = equation.under(at)
            forces = equation.contact_forces(place.U, forces.selected, tangents=False)
        model = equation.model_at(at)
        return output_amplitude(model, at, equation.full_force(forces))[self._rows(model.n_outputs)]

    def _rows(self, n_outputs: int) -> list[int]:
        return [self.output, n_outputs + self.output]


class AmplitudeRow(_OutputRow):
    """|a| / ``size`` - 1 = 0, eq. (7.14); singular where the amplitude has a maximum."""

    def of(self, a: np.ndarray) -> float:
        """Return the row for cosine and sine of the output, ``a`` (2,).  Local."""
        return float(np.hypot(*a)) / self.size - 1.0

    def rate(self, a: np.ndarray) -> np.ndarray:
        """Return its derivative by ``a``, (2,).  Local."""
        return a / (np.hypot(*a) * self.size)


@dataclass(frozen=True, eq=False)
class PhaseRow(_OutputRow):
    """Im(a exp(-i phase)) / ``size`` = 0 in place of eq. (7.9), with a = cosine - i sine."""

    phase: float  # rad

    def of(self, a: np.ndarray) -> float:
        """Return the row for cosine and sine of the output, ``a`` (2,).  Local."""
        return float(self.rate(a) @ a)

    def rate(self, a: np.ndarray) -> np.ndarray:
        """Return its derivative by ``a``, (2,).  Local."""
        return -np.array([np.sin(self.phase), np.cos(self.phase)]) / self.size
