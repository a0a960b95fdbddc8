"""The proof that no mode is missing: as many negative pivots of K_L - sigma M as modes lie below sigma."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from ..linear.dense import column_norms, multiply
from ..linear.mumps import SINGULAR, factorise, solve_block
from ..parallel.errors import ConvergenceError

_GAP = 1e-6  # (next - last) / last of omega_n^2 that parts two modes; closer ones count as equal
_RESIDUAL = 1e-6  # of a solve with the factor: beyond, small pivots may have spoiled the count


def find_gap(eigenvalues: np.ndarray, n_wanted: int) -> tuple[int, float]:
    """Return (n_below, sigma): a count of n_below modes below sigma proves that the first ``n_wanted`` are the lowest.  Local.

    Sigma lies in the first gap above them.  If they end in a cluster without an end in sight, it lies just below the
    cluster: any of its modes are as good as others.  ``eigenvalues`` (n,) omega_n^2 rising, [rad2/s2].
    """
    is_gap = np.append(np.diff(eigenvalues) > _GAP * eigenvalues[1:], False)
    above = np.flatnonzero(is_gap[n_wanted - 1 :])
    if len(above):
        last = n_wanted - 1 + int(above[0])
        return last + 1, float(0.5 * (eigenvalues[last] + eigenvalues[last + 1]))
    below = np.flatnonzero(is_gap)
    first = int(below[-1]) + 1 if len(below) else 0
    return first, float((1.0 - 0.5 * _GAP) * eigenvalues[first])


def count_below(K_L: PETSc.Mat, M: PETSc.Mat, sigma: float) -> int:
    """Return how many eigenvalues omega_n^2 of (K_L, M) lie below ``sigma`` [rad2/s2]: Sylvester's law of inertia.

    Collective: one factorisation, freed at once.  L D L^T without pivoting is tried first, half as expensive; if a solve
    with it is inaccurate, the factorisation with pivoting counts.

    Raises
    ------
    ConvergenceError : sigma is an eigenvalue to working precision; on every rank
    ResourceError : not enough memory
    """
    shifted = K_L.duplicate(copy=True)
    shifted.axpy(-sigma, M, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    shifted.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    try:
        for unpivoted in (True, False):
            shifted.setOption(PETSc.Mat.Option.SPD, unpivoted)  # to MUMPS this only means: do not pivot
            count = _negative_pivots(shifted)
            if count is not None:
                return count
    finally:
        shifted.destroy()
    raise ConvergenceError(
        f"modes: K_L - sigma M is singular at sigma = {sigma:.6e} rad2/s2, so that its negative pivots prove "
        "nothing; ask for one [solver] mode more or less"
    )


def _negative_pivots(shifted: PETSc.Mat) -> int | None:
    """Return the number of negative pivots, None if the factor is too inaccurate to trust it.  Collective."""
    ksp, info = factorise(shifted, "modes_inertia_", "K_L - sigma M", exact_inertia=True)
    try:
        if info["code"] in SINGULAR:
            return None
        b_owned = np.ones((shifted.getLocalSize()[0], 1))
        residual = multiply(shifted, solve_block(ksp, b_owned)) - b_owned
        comm = shifted.comm.tompi4py()
        error = column_norms(comm, residual)[0] / column_norms(comm, b_owned)[0]
        return info["negative"] if error <= _RESIDUAL else None
    finally:
        ksp.destroy()
