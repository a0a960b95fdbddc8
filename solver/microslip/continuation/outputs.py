"""Harmonic 1 of the outputs at a solution."""

from __future__ import annotations

import numpy as np

from ..error_estimate.estimate import output_amplitude
from ..harmonic.balance import HarmonicBalance
from ..harmonic.operating_point import ContactForces, OperatingPoint


def outputs_at(equation: HarmonicBalance, at: OperatingPoint, forces: ContactForces) -> np.ndarray:
    """Return a = cosine - i sine of the outputs under some contact forces, (n_outputs,) complex [m], the same on all ranks.

    Collective: one broadcast, and as :meth:`.HarmonicBalance.under`.
    """
    equation = equation.under(at)
    cos, sin = output_amplitude(equation.model_at(at), at, equation.full_force(forces)).reshape(2, -1)
    return equation.comm.bcast(cos - 1j * sin)


def output_at(equation: HarmonicBalance, at: OperatingPoint, U: np.ndarray, selected: np.ndarray, output: int) -> complex:
    """Return that of one output under the motion ``U`` (n_owned, 3, N_H) [m] of this rank's pairs.  Collective."""
    forces = equation.under(at).contact_forces(U, selected, tangents=False)
    return complex(outputs_at(equation, at, forces)[output])
