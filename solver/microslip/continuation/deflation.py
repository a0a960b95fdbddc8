"""Newton's method away from known solutions: the residual is multiplied by a factor that grows without bound near them.

docs/theory.md, eq. (7.11) and eq. (7.12).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from ..harmonic.linearisation import Exactness
from .corrector import BorderedSystem, Corrector
from .iterate import Iterate


class DeflatedCorrector(Corrector):
    """A corrector that does not return to ``known`` solutions.  Collective on ``comm``.

    SNES solves M F = 0 in place of F = 0.  Its step is that of F times a number, eq. (7.12): no further linear system.  Distances
    are those of the harmonics above the mean, like lengths of steps.
    """

    known: Sequence[Iterate] = ()

    def _factor(self, values: np.ndarray, system: BorderedSystem, direction: np.ndarray | None = None) -> tuple[float, float]:
        """Return M at scaled unknowns, eq. (7.11), and the rate of ln M along a direction of them.  Collective: one sum."""
        if not self.known:
            return 1.0, 0.0
        vibration = self.known[0].harmonics.vibration

        def above_mean(of: np.ndarray) -> np.ndarray:
            return self._motion(of, system.scaling)[..., vibration]

        away = [above_mean(values) - there.U[..., vibration] for there in self.known]
        along = np.zeros_like(away[0]) if direction is None else above_mean(direction)
        parts = [
            [np.vdot(d, d), np.vdot(d, along), np.vdot(u, u)] for d, u in zip(away, (k.U[..., vibration] for k in self.known))
        ]
        squares, rates, sizes = self.comm.allreduce(np.array(parts)).T
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            near = sizes / squares  # 1 / d^2
            return float(np.prod(1.0 + near)), float(np.sum(-2.0 * rates / squares * near / (1.0 + near)))

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, r: PETSc.Vec, system: BorderedSystem) -> None:
        super()._residual(snes, x, r, system)
        r.scale(self._factor(x.getArray(readonly=True), system)[0])

    def _linearise(
        self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, B: PETSc.Mat, system: BorderedSystem, exactness: Exactness
    ) -> None:
        super()._linearise(snes, x, J, B, system, exactness)
        self._at, self._system = x.getArray(readonly=True).copy(), system

    def _solve_step(self, b: PETSc.Vec, x: PETSc.Vec) -> tuple[int, int]:
        """Solve for the step of F and scale it, eq. (7.12).  Collective."""
        self._b = b.getArray(readonly=True).copy()
        factor = self._factor(self._at, self._system)[0]
        plain = b.copy()
        plain.scale(1.0 / factor)
        iterations, reason = super()._solve_step(plain, x)
        plain.destroy()
        rate = self._factor(self._at, self._system, x.getArray(readonly=True))[1]  # SNES subtracts the step
        x.scale(1.0 / (1.0 + rate) if rate != -1.0 else 1.0)
        return iterations, reason

    def _multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Apply the Jacobian of M F to the last computed step: the line search needs no other product."""
        y.getArray()[:] = self._b
