"""Levels at which no pair slips: scaled from the linear response, not solved (docs/theory.md, section 7)."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from ..contact.law import Law
from ..fourier.amplitudes import to_complex
from ..harmonic.balance import HarmonicBalance
from ..harmonic.operating_point import OperatingPoint
from ..receptance.reduced_model import ReducedModel
from .steps import LinearCurve

FINER = 2  # times the samples of the scene, where the linear curve is tested for slip
MARGIN = 1.0 - 1e-9  # of the level up to which no pair leaves sticking, for roundoff


def sticks_up_to(model: ReducedModel, law: Law, motions: list[np.ndarray]) -> np.ndarray:
    """Return a level [N] at each of n points of the linear curve up to which no pair leaves sticking, (n,).

    Collective on ``model.comm``.  ``motions`` holds this rank's rows (3 n_owned, N_H) [m/N] at each of the points.  At higher
    levels they may stick, too: the law answers for the amplitudes of all harmonics peaking together.
    """
    most_moved = np.array([np.abs(to_complex(U)).sum(axis=1) for U in motions])  # m per newton
    most = law.take(np.arange(model.n_pairs)[model.owned]).slip_safety(most_moved.reshape(len(motions), -1, 3))  # N
    least = np.nan_to_num(most.min(axis=1, initial=np.inf), nan=0.0, posinf=np.inf)
    model.comm.Allreduce(MPI.IN_PLACE, least, op=MPI.MIN)
    return least


def is_linear(equation: HarmonicBalance, level: float, curve: LinearCurve) -> bool:
    """Return whether no pair leaves sticking anywhere on the sampled linear curve at a level [N].

    Collective: one evaluation of the pairs at each point where the bound alone does not decide, worst first.  A
    level that slips so costs one evaluation.
    """
    finer = equation.resolved(equation.harmonics, FINER * equation.n_samples)
    for i in np.argsort(curve.sticks_up_to, kind="stable"):
        if level <= MARGIN * curve.sticks_up_to[i]:
            return True
        if curve.sticks_up_to[i] == 0.0 or not sticks(finer, OperatingPoint(curve.omega[i], level)):
            return False
    return True


def sticks(equation: HarmonicBalance, at: OperatingPoint) -> bool:
    """Return whether every pair sticks, closed, at every sample of the linear response.  Collective."""
    return len(equation.contact_forces(equation.linear_motion(at), equation.every_pair, tangents=False).active) == 0
