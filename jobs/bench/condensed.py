"""The condensed full set with dense Newton: the natural implementation once the joint is reduced to relative DOFs.

The same residual r = U - U_lin + G p over all pairs as the program's methods, the same contact kernel and exact
tangents; but the Jacobian I + G P, of size 3 n_pairs N_H, is assembled and factored by LAPACK in every Newton step.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs

from microslip.continuation.corrector import Correction
from microslip.continuation.iterate import Iterate
from microslip.fourier.amplitudes import to_complex, to_real

MOST_ITERATIONS = 20
MOST_HALVINGS = 10


class CondensedFullSet:
    """Newton with a dense Jacobian at fixed frequencies.  One rank."""

    def __init__(self, problem, tolerance: float):
        self.problem, self.equation, self.tolerance = problem, problem.equation, tolerance

    @property
    def unknowns(self) -> int:
        return 3 * self.equation.model.n_pairs * self.equation.model.N_H

    def correct(self, guess: Iterate, size: float) -> Correction:
        """Solve at the frequency of ``guess`` to |r| <= tolerance x size.  Local; divergence is returned as ``failure``."""
        at = self.problem.at(guess.parameters)
        U_lin, G = self.equation.linear_motion(at), self.equation.receptance(at, np.arange(self.equation.model.n_pairs))
        G_n = np.stack(list(G.blocks()))
        U, forces, r = self._evaluate(guess.U, U_lin, G_n)
        for iteration in range(MOST_ITERATIONS + 1):
            if np.linalg.norm(r) <= self.tolerance * size:
                return Correction(replace(guess, U=U), iteration, 0, float(np.linalg.norm(r)) / size, None)
            if iteration < MOST_ITERATIONS:
                step = solve_dense(jacobian(G_n, forces.P, forces.active), -r.ravel()).reshape(r.shape)
                U, forces, r = self._descend(U, step, np.linalg.norm(r), U_lin, G_n)
        return Correction(replace(guess, U=U), iteration, 0, float(np.linalg.norm(r)) / size, f"{MOST_ITERATIONS} iterations")

    def _descend(self, U, step, norm, U_lin, G_n):
        """Return the evaluation after a step, halved until the residual falls."""
        for _ in range(MOST_HALVINGS):
            trial = self._evaluate(U + step, U_lin, G_n)
            if np.linalg.norm(trial[2]) < norm:
                break
            step = 0.5 * step
        return trial

    def _evaluate(self, U, U_lin, G_n):
        """Return U, the contact forces with tangents, and the residual (n_pairs, 3, N_H) [m]."""
        forces = self.equation.contact_forces(U, self.equation.every_pair, tangents=True)
        p_n = to_complex(self.equation.full_force(forces))
        G_p = to_real(np.matmul(G_n, p_n.T[:, :, None])[:, :, 0].T, self.equation.model.N_H)
        return U, forces, U - U_lin + G_p.reshape(U.shape)


def jacobian(G_n: np.ndarray, P: np.ndarray, active: np.ndarray) -> np.ndarray:
    """Return I + G P, (m, m) with m = 3 n_pairs N_H, rows and columns ordered as U (n_pairs, 3, N_H).

    ``G_n`` (H + 1, 3 n_pairs, 3 n_pairs) complex [m/N]; ``P`` (n_active, 3 N_H, 3 N_H) [N/m] of the ``active`` pairs.
    """
    n_rows, N_H = G_n.shape[1], 2 * len(G_n) - 1
    J = np.zeros((n_rows, N_H, n_rows // 3, 3 * N_H))
    P = P.reshape(-1, 3, N_H, 3 * N_H)
    columns = 3 * active[:, None] + np.arange(3)
    for n in range(len(G_n)):
        G = np.moveaxis(G_n[n][:, columns], 0, 1)  # (n_active, 3 n_pairs, 3)
        c = max(2 * n - 1, 0)
        # amplitude cos - i sin: the cosine of G p is Re G p_cos + Im G p_sin, its sine Re G p_sin - Im G p_cos
        J[:, c, active] = np.moveaxis(G.real @ P[:, :, c], 0, 1)
        if n > 0:
            J[:, c, active] += np.moveaxis(G.imag @ P[:, :, c + 1], 0, 1)
            J[:, c + 1, active] = np.moveaxis(G.real @ P[:, :, c + 1] - G.imag @ P[:, :, c], 0, 1)
    J = J.reshape(n_rows * N_H, n_rows * N_H)
    J[np.diag_indices_from(J)] += 1.0
    return J


def solve_dense(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return A^-1 b by LU with pivoting; A, row by row in memory, is overwritten."""
    lu, pivots, info = dgetrf(A.T, overwrite_a=True)  # of A^T, whose columns are A's rows
    if info != 0:
        raise np.linalg.LinAlgError(f"dense Jacobian: pivot {info} is zero")
    return dgetrs(lu, pivots, b, trans=1)[0]
