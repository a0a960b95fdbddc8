"""The proof that no mode is missing: K_L - sigma M has as many negative pivots as there are modes below sigma."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from ..linear.direct import factorise
from ..linear.mumps import SINGULAR
from ..linear.ordering import Elimination, Order
from ..messages.errors import ConvergenceError

_GAP = 1e-6  # (next - last) / last of omega_n^2 that separates two modes; closer modes count as equal


def find_gap(eigenvalues: np.ndarray, n_wanted: int, shifts: Sequence[float] = ()) -> tuple[int, float]:
    """Return (n_below, sigma): a count of n_below modes below sigma proves that the first ``n_wanted`` are the lowest.  Local.

    Sigma lies in the first gap above them.  If they end within a multiple eigenvalue that continues to the last of the
    ``eigenvalues``, sigma lies just below it: any of its modes are equally valid.  ``eigenvalues`` (n,) are omega_n^2 ascending
    [rad2/s2].  A value of ``shifts`` is preferred if it lies in a gap above the wanted modes.
    """
    for sigma in shifts:
        n_below = int(np.searchsorted(eigenvalues, sigma))
        if n_wanted <= n_below < len(eigenvalues) and np.abs(eigenvalues - sigma).min() > _GAP * sigma:
            return n_below, sigma
    is_gap = np.append(np.diff(eigenvalues) > _GAP * eigenvalues[1:], False)
    above = np.flatnonzero(is_gap[n_wanted - 1 :])
    if len(above):
        last = n_wanted - 1 + int(above[0])
        return last + 1, float(0.5 * (eigenvalues[last] + eigenvalues[last + 1]))
    below = np.flatnonzero(is_gap)
    first = int(below[-1]) + 1 if len(below) else 0
    return first, float((1.0 - 0.5 * _GAP) * eigenvalues[first])


def count_below(K_L: PETSc.Mat, M: PETSc.Mat, sigma: float, order: Order | None = None) -> int:
    """Return how many eigenvalues omega_n^2 of (K_L, M) lie below ``sigma`` [rad2/s2], by Sylvester's law of inertia.

    Collective: one factorisation L D L^T with pivoting, of which only the pivots are stored, with a quarter of the memory of a
    factor or less.  The count is exact for a matrix that differs from K_L - sigma M by rounding.

    Raises
    ------
    ConvergenceError : sigma is an eigenvalue to working precision; on every rank
    ResourceError : not enough memory
    """
    solver, info = factorise(K_L, "modes_inertia_", "K_L - sigma M", elimination=Elimination(order=order), shift=(sigma, M))
    solver.destroy()
    if info["code"] in SINGULAR or info["null"] > 0:
        raise ConvergenceError(
            f"modes: K_L - sigma M is singular at sigma = {sigma:.6e} rad2/s2, so that its negative pivots prove "
            "nothing; state one [solver] mode more or less"
        )
    return info["negative"]
