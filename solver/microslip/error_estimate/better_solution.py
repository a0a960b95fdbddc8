"""The better problem solved at a point, where what it changes is so far from linear that first order says little.

docs/theory.md, eq. (11.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..harmonic.adjoint_solver import AdjointSolver
from ..harmonic.balance import HarmonicBalance
from ..harmonic.linearisation import Linearisation
from ..harmonic.operating_point import OperatingPoint
from .outputs import output_amplitude

MOST_STEPS = 12  # of Newton's method
SHARES = (1.0, 0.5, 0.25, 0.1)  # of a step, in turn until the residual falls
CLOSE = 0.02  # change of the amplitudes by its last step, over that by all of them
ROUNDING = 1e-9  # of the amplitudes: no change


def better_amplitude(
    better: HarmonicBalance, at: OperatingPoint, U: np.ndarray, before: np.ndarray, solver: AdjointSolver
) -> np.ndarray | None:
    """Return cos 1, then sin 1, of the outputs (2 n_outputs,) [m] in the solution that Newton's method finds, or None.

    Collective.  ``U`` (n_owned, 3, N_H) [m] is the motion to begin with, ``before`` the amplitudes of the point.
    """
    last, here = before, _Motion.of(better, at, U)
    for _ in range(MOST_STEPS):
        d_U, _, is_found = here.linear.solve_for(-better.gather(here.residual).reshape(1, -1, better.model.N_H), solver)
        if not is_found:
            return None
        for share in SHARES:
            there = _Motion.of(better, at, here.U + share * d_U.reshape(U.shape))
            if there.miss < here.miss:
                break
        else:
            return None
        here = there
        now = better.comm.bcast(output_amplitude(better.model, at, better.full_force(here.linear.forces)))
        if np.linalg.norm(now - last) <= CLOSE * np.linalg.norm(now - before) + ROUNDING * np.linalg.norm(now):
            return now
        last = now
    return None


@dataclass(frozen=True, eq=False)
class _Motion:
    """A motion, the equation linearised there, and by how much it misses."""

    U: np.ndarray  # (n_owned, 3, N_H) m
    linear: Linearisation
    residual: np.ndarray  # (n_owned, 3, N_H) m
    miss: float  # norm of the residual of all ranks, m

    @classmethod
    def of(cls, better: HarmonicBalance, at: OperatingPoint, U: np.ndarray) -> _Motion:
        """Collective."""
        linear = Linearisation.of(better, at, better.contact_forces(U, better.every_pair, tangents=True))
        residual = better.residual(U, at, linear.forces, linear.G)
        return cls(U, linear, residual, float(np.sqrt(better.sum(np.array([np.vdot(residual, residual)]))[0])))
