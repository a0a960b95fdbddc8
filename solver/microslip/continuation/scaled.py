"""Levels known to be linear are scaled from the linear response, not solved (docs/theory.md, section 7)."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from ..contact.law import ContactParameters
from ..fourier.amplitudes import to_complex
from ..harmonic.balance import HarmonicBalance, OperatingPoint
from ..receptance.model import ReducedModel
from .steps import LinearCurve

FINER = 2  # times the samples of the scene, where the linear curve is tested for slip
MARGIN = 1.0 - 1e-9  # of the level up to which no pair leaves sticking, for roundoff


def sticks_up_to(model: ReducedModel, parameters: ContactParameters, motions: list[np.ndarray]) -> np.ndarray:
    """Return a level [N] at each of n points of the linear curve up to which no pair leaves sticking, (n,).

    Collective on ``model.comm``.  ``motions`` holds this rank's rows (3 n_owned, N_H) [m/N] at each of the points.  A pair sticks
    where even all harmonics peaking together stay within the friction limit, k_t |du_t| <= mu (N0 - k_n du_z): at higher levels
    it may stick, too.  The level is 0 where a pair has no preload, a gap, or no friction.
    """
    own = parameters.take(np.arange(model.n_pairs)[model.owned])
    most_moved = np.array([np.abs(to_complex(U)).sum(axis=1) for U in motions])  # m per newton
    x, y, z = most_moved.reshape(len(motions), -1, 3).transpose(2, 0, 1)
    limit = np.broadcast_to(own.mu * np.maximum(own.N0, 0.0), x.shape)  # N
    taken = own.k_t * np.hypot(x, y) + own.mu * own.k_n * z  # N per newton
    most = np.divide(limit, taken, out=np.where(limit > 0.0, np.inf, 0.0), where=taken > 0.0)
    least = np.nan_to_num(most.min(axis=1, initial=np.inf), nan=0.0, posinf=np.inf)
    model.comm.Allreduce(MPI.IN_PLACE, least, op=MPI.MIN)
    return least


def is_linear(equation: HarmonicBalance, level: float, curve: LinearCurve) -> bool:
    """Tell whether no pair leaves sticking anywhere on the sampled linear curve at a level [N].

    Collective: one evaluation of the pairs at each point where the bound alone does not tell, worst first.  A
    level that slips so costs one evaluation.  A constant motion, of harmonic 0 alone, is left to the solver.
    """
    if equation.harmonics.highest == 0:
        return False
    finer = equation.resolved(equation.harmonics, FINER * equation.n_samples)
    for i in np.argsort(curve.sticks_up_to, kind="stable"):
        if level <= MARGIN * curve.sticks_up_to[i]:
            return True
        if curve.sticks_up_to[i] == 0.0 or not sticks(finer, OperatingPoint(curve.omega[i], level)):
            return False
    return True


def sticks(equation: HarmonicBalance, at: OperatingPoint) -> bool:
    """Tell whether every pair sticks, closed, at every sample of the linear response.  Collective."""
    return len(equation.contact_forces(equation.linear_motion(at), equation.every_pair, tangents=False).active) == 0
