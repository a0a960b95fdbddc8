"""The adjoint of the outputs at a point."""

from dataclasses import dataclass

import numpy as np

from ..harmonic.linearisation import Linearisation


@dataclass(frozen=True, eq=False)
class Adjoint:
    """The adjoint of the outputs: cos 1, then sin 1, change by tau d_r for a residual d_r, and by -chi d_p for a change d_p of p.

    This rank's parts of chi and tau, docs/theory.md, section 11; n = 2 n_outputs.
    """

    linear: Linearisation
    chi: np.ndarray  # (n, 3 n_owned N_H) m/N
    tau: np.ndarray  # (n, 3 n_owned N_H) P^T chi
    is_solved: bool
