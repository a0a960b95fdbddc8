"""Which scenes odd harmonics alone solve (docs/theory.md, section 5)."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from .balance import HarmonicBalance


def symmetric(equation: HarmonicBalance) -> bool:
    """Tell whether odd harmonics alone give a solution of the full set, exact but for roundoff.  Collective.

    They do where the motion may repeat itself with the opposite sign after half a period, u(t + T/2) = -u(t), and p with it.
    That takes, and this function tests,

    - loads in odd harmonics only, and an even number of samples, so that a sample lies half a period after each;
    - normal forces that stay what they are at rest: no load and no friction force moves any pair in its z direction (whole rows
      of r, the static motion and the static receptance are zero, as where a pair has no DOF in z);
    - friction that forgets its start T = k_t du_t within the first period, so that no constant p is left.  Along a line, or with
      a limit for each direction, the slider stands at du_max - mu N / k_t once du_max is passed, and at the opposite place after
      -du_max, wherever it was before: both are passed in the first period, and what follows is odd.  With du_max within the
      limit mu N / k_t the slider stays at 0 and p vanishes.  Free sliding (mu N = 0) and k_t = 0 are linear.

    A friction circle on a motion in both directions is left out: there the slider tends to its cycle without ever reaching it,
    and the period that is kept still holds some of the start, even harmonics among them.

    Notes
    -----
    The full set may have further solutions without the symmetry; from a symmetric guess Newton finds the symmetric one.
    """
    model, parameters = equation.model, equation.law
    even = [n for n in model.harmonics.chosen if n % 2 == 0]
    if equation.n_samples % 2 or any(model.f[:, model.harmonics.columns(n)].any() for n in even):
        return False
    moves = _moving_rows(model).reshape(-1, 3)
    if equation.comm.bcast(bool(moves[:, 2].any())):  # the static columns need not be known
        return False
    statically = _statically_moving_rows(model).reshape(-1, 3)
    moves = moves[model.owned] | statically
    normal_force = np.maximum(parameters.N0, 0.0)
    is_linear = (parameters.mu * normal_force == 0.0) | (parameters.k_t == 0.0)
    one_at_a_time = parameters.separate | (moves[:, :2].sum(axis=1) <= 1)
    is_odd = bool(np.all(~moves[:, 2] & (is_linear | one_at_a_time)))
    return equation.comm.allreduce(is_odd, op=MPI.LAND)


def _moving_rows(model) -> np.ndarray:
    """Return which relative motions modes or loads move, (3 n_pairs,) bool.  Local."""
    return np.hstack([model.du_static, *(family.R_phi for family in model.families)]).any(axis=1)


def _statically_moving_rows(model) -> np.ndarray:
    """Return which relative motions of this rank's pairs tangential forces move, (3 n_owned,) bool.

    Collective where static columns are not known yet.
    """
    tangential = (3 * np.arange(model.n_pairs)[:, None] + np.arange(2)).ravel()
    return (model.G_static.transposed(np.arange(model.n_pairs))[tangential] != 0.0).any(axis=0)
