"""A corrector that shows its Jacobian and its Newton step."""

from __future__ import annotations

import numpy as np

from microslip.continuation.corrector import ConstraintRow, Corrector, Iterate, Scaling


class Probe(Corrector):
    """What tests ask of a corrector."""

    def jacobian_times(
        self, iterate: Iterate, row: ConstraintRow, scaling: Scaling, selected: np.ndarray, d_xi: np.ndarray, d_nu: float
    ) -> np.ndarray:
        """Return this rank's rows of the scaled Jacobian at ``iterate`` times (d_xi, d_nu).  Collective."""
        self._row, self._scaling, self._selected = row, scaling, selected
        self._pack(iterate, self._x)
        self._linearise(self._snes, self._x, self._J, self._J)
        self._pack(Iterate(d_xi * scaling.U, d_nu * scaling.parameter), self._x)
        self._J.mult(self._x, self._r)
        return self._r.getArray().copy()

    def newton_step(self, iterate: Iterate, row: ConstraintRow, scaling: Scaling, selected: np.ndarray) -> np.ndarray:
        """Return this rank's rows of J^-1 r at ``iterate``, scaled.  Collective."""
        r = self.residual_at(iterate, row, scaling, selected)
        self._linearise(self._snes, self._x, self._J, self._J)
        d_xi, d_nu, _, _ = self._step.solve(self._linear, r[: self.n_U].reshape(self.problem.shape) / scaling.rows, self._nu(r))
        return np.append(d_xi, d_nu) if self.last else d_xi.ravel()
