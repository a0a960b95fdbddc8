"""Nonlinear elimination: the rows of a few pairs are solved at given forces of all others (docs/theory.md, section 5).

p is piecewise smooth.  Where a pair is close to a kink, as where another sample is the one at which its slider rests, the Newton
steps of its two pieces lead from one to the other, and a line search shortens the step of all pairs for this one alone.  For
these pairs, S, the equation with the forces of all others as they are, from the residual r at a motion U,

    V - U_S + G_SS (p(V) - p(U_S)) + r_S = 0,                                                                       (5.9)

is small and solved by many cheap Newton steps.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import scipy.linalg

from ..contact.law import Law
from ..fourier.harmonics import Harmonics
from ..parallel.agree import on_root
from ..receptance.columns import ReceptanceColumns
from .balance import HarmonicBalance
from .operating_point import OperatingPoint
from .whole_inverse import LARGEST

MOST = 0.95  # of the residual's square, carried by the eliminated pairs
FEW = 16  # active pairs for each eliminated one at least
STEPS, HALVINGS = 40, 10  # Newton steps, and halvings of each
SOLVED = 1e-2  # of the residual at the start


def with_most_of(equation: HarmonicBalance, r: np.ndarray, others: np.ndarray, n_active: int) -> np.ndarray | None:
    """Return the pairs that carry most of a residual r (n_owned, 3, N_H), and ``others``, ascending; None if these are many.

    Collective: one gather.  ``n_active`` is the number of active pairs.
    """
    squares = equation.gather(np.einsum("pij,pij->p", r, r))
    order = np.argsort(-squares, kind="stable")
    n = int(np.searchsorted(np.cumsum(squares[order]), MOST * squares.sum())) + 1
    pairs = np.union1d(order[:n], others)
    return pairs if len(pairs) * FEW <= n_active and 3 * len(pairs) * r.shape[-1] <= LARGEST else None


def eliminated(
    equation: HarmonicBalance, at: OperatingPoint, pairs: np.ndarray, U: np.ndarray, r: np.ndarray
) -> np.ndarray | None:
    """Return the motion ``U`` (n_owned, 3, N_H) with the rows r of some ``pairs`` solved for, eq. (5.9); None without success.

    Collective: gathers of the pairs' data and a broadcast.
    """
    G = ReceptanceColumns(equation.model_at(at), at.omega, pairs, for_blocks=True).matrix()
    model = equation.model
    mine = pairs[(pairs >= model.owned.start) & (pairs < model.owned.stop)] - model.owned.start
    laws = equation.comm.allgather(equation.law.take(mine))
    data = equation.gather(U[mine]), equation.gather(r[mine])
    V = on_root(equation.comm, _solved, laws, G, *data, equation.n_samples, equation.harmonics)
    if V is None:
        return None
    motion = U.copy()
    motion[mine] = V[np.searchsorted(pairs, mine + model.owned.start)]
    return motion


def _solved(
    laws: Sequence[Law], G: np.ndarray, U: np.ndarray, r: np.ndarray, n_samples: int, harmonics: Harmonics
) -> np.ndarray | None:
    """Return V of eq. (5.9), (m, 3, N_H); None if Newton's method does not reduce its residual to ``SOLVED``.  Local."""
    p, P = _forces(laws, U, n_samples, harmonics)
    V, rest, others = U, r.ravel(), r.ravel() - U.ravel() - G @ p
    start = size = np.linalg.norm(rest)
    for _ in range(STEPS):
        if size <= SOLVED * start:
            return V
        J = np.eye(len(G)) + (G.reshape(len(G), len(V), 1, -1) @ P)[:, :, 0].reshape(G.shape)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)
            try:
                step = scipy.linalg.solve(J, rest, check_finite=False).reshape(V.shape)
            except np.linalg.LinAlgError:
                return None
        for halving in range(HALVINGS):
            there = V - 0.5**halving * step
            p, P = _forces(laws, there, n_samples, harmonics)
            of_there = there.ravel() + G @ p + others
            if np.linalg.norm(of_there) < size:
                break
        else:
            return None
        V, rest, size = there, of_there, np.linalg.norm(of_there)
    return None


def _forces(laws: Sequence[Law], V: np.ndarray, n_samples: int, harmonics: Harmonics) -> tuple[np.ndarray, np.ndarray]:
    """Return p of the pairs, flat, and dp/dU, (m, 3 N_H, 3 N_H).  Local."""
    p, P, first = np.zeros_like(V), np.zeros((len(V), V[0].size, V[0].size)), 0
    for law in laws:
        here = slice(first, first + law.n_pairs)
        if law.n_pairs:
            cycle = law.cycle(V[here], n_samples, tangents=True, harmonics=harmonics)
            p[here] = cycle.p
            if cycle.P is not None:
                P[first + cycle.active] = cycle.P
        first = here.stop
    return p.ravel(), P
