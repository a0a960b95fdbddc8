"""The adjoint of the outputs at a point, and derivatives by numbers of the contact law that it gives."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..harmonic.linearisation import Linearisation
from ..harmonic.operating_point import LawParameter


@dataclass(frozen=True, eq=False)
class Adjoint:
    """The adjoint of cos 1, then sin 1, of the outputs, which a change d_r of the residual changes by tau d_r, d_p by -chi d_p.

    This rank's part of both, docs/theory.md, section 11; n = 2 n_outputs.
    """

    linear: Linearisation
    chi: np.ndarray  # (n, 3 n_owned N_H) m/N
    tau: np.ndarray  # (n, 3 n_owned N_H) P^T chi
    is_found: bool

    def by_law(self, parameter: LawParameter) -> np.ndarray:
        """Return the derivative of the outputs by a number of the contact law along solutions, (n,).

        Collective: one gather and one sum.

        Raises
        ------
        ValueError : a stiffness, by which the structure changes, too: tau and :meth:`Linearisation.rate` give its part
        """
        if parameter.is_stiffness:
            raise ValueError(f"{parameter.name} changes the structure as well as the contact law")
        equation, forces = self.linear.equation, self.linear.forces
        d_p = equation.full_force(replace(forces, p=equation.law_rate(forces, parameter)))
        return equation.comm.bcast(equation.sum(-self.chi @ d_p[equation.model.owned_rows].ravel()))
