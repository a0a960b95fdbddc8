"""Test for scenes with half-wave symmetry, solved with odd harmonics only (docs/theory.md, section 5)."""

import numpy as np
from mpi4py import MPI

from ..receptance.reduced_model import ReducedModel
from .balance import HarmonicBalance

_TOGETHER = 64  # pairs per block of static columns


def symmetric(equation: HarmonicBalance) -> bool:
    """Return whether odd harmonics alone give a solution of the full set, exact up to roundoff.  Collective.

    They do if motion and p change their sign after half a period, u(t + T/2) = -u(t).  This function tests the conditions:

    - loads in odd harmonics only, and an even number of samples, so that a sample lies half a period after each sample;
    - constant normal forces: no load and no friction force moves any pair in its z direction (the z rows of R phi, of the static
      motion and of the static receptance are zero, for example because a pair has no DOF in z);
    - a law with the same symmetry, including its initial state, on which friction does not depend after the first period.

    Notes
    -----
    The full set may have further solutions without the symmetry; from a symmetric guess Newton's method converges to the
    symmetric solution.
    """
    model = equation.model
    even = [n for n in model.harmonics.chosen if n % 2 == 0]
    if equation.n_samples % 2 or any(model.f[:, model.harmonics.columns(n)].any() for n in even):
        return False
    moves = _moving_rows(model).reshape(-1, 3)
    if equation.comm.bcast(bool(moves[:, 2].any())):  # before any static columns are computed
        return False
    statically = _statically_moving_rows(model).reshape(-1, 3)
    is_odd = bool(np.all(equation.law.keeps_half_wave_symmetry(moves[model.owned] | statically)))
    return equation.comm.allreduce(is_odd, op=MPI.LAND)


def _moving_rows(model: ReducedModel) -> np.ndarray:
    """Return which relative motions have a participation in modes or in the static response, (3 n_pairs,) bool.  Local."""
    receptances = [group.receptance for group in model.groups]
    return np.hstack([each for of in receptances for each in (of.static.du_static, of.modes.R_phi)]).any(axis=1)


def _statically_moving_rows(model: ReducedModel) -> np.ndarray:
    """Return which relative motions of this rank's pairs are caused by tangential forces, (3 n_owned,) bool.

    Collective where static columns are missing.
    """
    every, moves = np.arange(model.n_pairs), np.zeros(3 * (model.owned.stop - model.owned.start), dtype=bool)
    for group in model.groups:
        G_static = group.receptance.static.G_static
        G_static.require(every)
        for pairs in np.array_split(every, len(every) // _TOGETHER + 1):
            columns = G_static.transposed(pairs).reshape(len(pairs), 3, len(moves))
            moves |= (columns[:, :2] != 0.0).any((0, 1))
    return moves
