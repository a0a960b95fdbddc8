"""The adjoint of the outputs at a point, and its derivatives of the outputs by parameters of the contact law."""

from dataclasses import dataclass, replace

import numpy as np

from ..harmonic.linearisation import Linearisation
from ..harmonic.operating_point import LawParameter


@dataclass(frozen=True, eq=False)
class Adjoint:
    """The adjoint of the outputs: cos 1, then sin 1, change by tau d_r for a residual d_r, and by -chi d_p for a change d_p of p.

    This rank's parts of chi and tau, docs/theory.md, section 11; n = 2 n_outputs.
    """

    linear: Linearisation
    chi: np.ndarray  # (n, 3 n_owned N_H) m/N
    tau: np.ndarray  # (n, 3 n_owned N_H) P^T chi
    is_solved: bool

    def by_law(self, parameter: LawParameter) -> np.ndarray:
        """Return the derivative of the outputs by a parameter of the contact law along solutions, (n,).

        Collective: one gather and one sum.

        Raises
        ------
        ValueError : a stiffness, which also changes the structure: tau and :meth:`Linearisation.rate` give its derivative
        """
        if parameter.is_stiffness:
            raise ValueError(f"{parameter.name} changes the structure as well as the contact law")
        equation, forces = self.linear.equation, self.linear.forces
        d_p = equation.full_force(replace(forces, p=equation.law_rate(forces, parameter)))
        return equation.agreed_sum(-self.chi @ d_p[equation.model.owned_rows].ravel())
