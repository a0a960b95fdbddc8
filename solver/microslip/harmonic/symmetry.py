"""Which scenes odd harmonics alone solve (docs/theory.md, section 5)."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from ..receptance.reduced_model import ReducedModel
from .balance import HarmonicBalance

_TOGETHER = 64  # pairs whose static columns are looked at together


def symmetric(equation: HarmonicBalance) -> bool:
    """Tell whether odd harmonics alone give a solution of the full set, exact but for roundoff.  Collective.

    They do where the motion may repeat itself with the opposite sign after half a period, u(t + T/2) = -u(t), and p with it.
    That takes, and this function tests,

    - loads in odd harmonics only, and an even number of samples, so that a sample lies half a period after each;
    - normal forces that stay what they are at rest: no load and no friction force moves any pair in its z direction (whole rows
      of r, the static motion and the static receptance are zero, as where a pair has no DOF in z);
    - a law that answers such motions likewise, from its start on: friction forgets its start within the first period.

    Notes
    -----
    The full set may have further solutions without the symmetry; from a symmetric guess Newton finds the symmetric one.
    """
    model = equation.model
    even = [n for n in model.harmonics.chosen if n % 2 == 0]
    if equation.n_samples % 2 or any(model.f[:, model.harmonics.columns(n)].any() for n in even):
        return False
    moves = _moving_rows(model).reshape(-1, 3)
    if equation.comm.bcast(bool(moves[:, 2].any())):  # the static columns need not be known
        return False
    statically = _statically_moving_rows(model).reshape(-1, 3)
    is_odd = bool(np.all(equation.law.keeps_half_wave_symmetry(moves[model.owned] | statically)))
    return equation.comm.allreduce(is_odd, op=MPI.LAND)


def _moving_rows(model: ReducedModel) -> np.ndarray:
    """Return which relative motions modes or loads move, (3 n_pairs,) bool.  Local."""
    receptances = [group.receptance for group in model.groups]
    return np.hstack([each for of in receptances for each in (of.static.du_static, of.modes.R_phi)]).any(axis=1)


def _statically_moving_rows(model: ReducedModel) -> np.ndarray:
    """Return which relative motions of this rank's pairs tangential forces move, (3 n_owned,) bool.

    Collective where static columns are not known yet.
    """
    every, moves = np.arange(model.n_pairs), np.zeros(3 * (model.owned.stop - model.owned.start), dtype=bool)
    for group in model.groups:
        G_static = group.receptance.static.G_static
        G_static.require(every)
        for pairs in np.array_split(every, len(every) // _TOGETHER + 1):
            columns = G_static.transposed(pairs).reshape(len(pairs), 3, len(moves))
            moves |= (columns[:, :2] != 0.0).any((0, 1))
    return moves
