"""The row of the system that states the amplitude of an output (docs/theory.md, section 7, eq. (7.14))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..error_estimate.estimate import output_amplitude, sensitivity
from .constraint_rows import Place, Scaling

DIFFERENCE = 1e-4  # of the unit of a parameter, over which rates under given forces are central differences


@dataclass(frozen=True, eq=False)
class AmplitudeRow:
    """|a| / ``size`` - 1 = 0 for harmonic 1 of an output, eq. (7.14); singular where the amplitude has a maximum."""

    output: int
    size: float
    takes_linearisation: ClassVar[bool] = True

    def of_motion(self, U: np.ndarray, scaling: Scaling) -> float:
        """Return 0: the amplitude follows from the contact forces.  Local."""
        return 0.0

    def value(self, of_motion: float, place: Place) -> float:
        """Return the row.  Collective."""
        return place.linear.equation.comm.bcast(float(np.hypot(*self._amplitude(place, place.nu))) / self.size - 1.0)

    def gradient(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Return its derivatives.  Collective: a broadcast."""
        linear, scaling = place.linear, place.scaling
        equation, forces = linear.equation, linear.forces
        model, a = equation.model_at(linear.at), self._amplitude(place, place.nu)
        unit = a / (np.hypot(*a) * self.size)
        by_forces = -np.tensordot(unit, sensitivity(model, linear.at.omega)[self._rows(model.n_outputs)], 1)
        owned = by_forces[model.owned_rows].reshape(equation.shape)[forces.active_owned]
        by_motion = np.zeros(equation.shape)
        columns = np.matmul(owned.reshape(len(owned), 1, linear.P.shape[1]), linear.P)
        by_motion[forces.active_owned] = scaling.U * columns.reshape(owned.shape)
        steps = DIFFERENCE * np.eye(len(place.nu))
        by_nu = [unit @ (self._amplitude(place, place.nu + h) - self._amplitude(place, place.nu - h)) for h in steps]
        return by_motion, equation.comm.bcast(np.array(by_nu) / (2.0 * DIFFERENCE))

    def _amplitude(self, place: Place, nu: np.ndarray) -> np.ndarray:
        """Return cosine and sine of the output under the forces of a place, at scaled parameters.  Local."""
        linear = place.linear
        at = place.operating_point(tuple(map(float, nu * place.scaling.parameters)))
        model = linear.equation.model_at(at)
        return output_amplitude(model, at, linear.equation.full_force(linear.forces))[self._rows(model.n_outputs)]

    def _rows(self, n_outputs: int) -> list[int]:
        return [self.output, n_outputs + self.output]
