"""A preconditioner for wide slip: the Jacobian without the coupling between harmonics.

docs/theory.md, section 5.  In micro-slip I + G P is close to the identity and GMRES needs no preconditioner.  When most pairs
slip, P cancels most of the joint's stiffness, and I + G P is as ill-conditioned as the structure without its joint.  The matrix
of one harmonic,

    B_n = I + G_n(omega) P_n,

with P_n the complex-linear part of dp_n / dU_n, has the same ill-conditioning and is small: 3 rows per active pair.
"""

import warnings
from typing import Any

import numpy as np
import scipy.linalg
from mpi4py import MPI

from ..fourier.amplitudes import to_complex, to_real
from .linearisation import Linearisation

SINGLE_ERROR = 0.01  # relative error of B B^-1 in single precision, beyond which the inverse is in double precision
REGULAR = 1.0 - 1e-3  # factor of P in B_n, which is singular for a body supported only by its joint


class PairsPreconditioner:
    """A preconditioner of the rows of the active pairs of a linearisation, reused for nearby ones.  Collective."""

    def __init__(self, at: Linearisation):
        self.made_at, self.active_owned, self.local_rows = at, at.forces.active_owned, rows_of_rank(at)

    def fits(self, at: Linearisation) -> bool:
        """Return whether another linearisation has the same harmonics, and as many active pairs on every rank.  Collective."""
        is_same = len(self.active_owned) == len(at.forces.active_owned)
        same_size = self.made_at.equation.comm.allreduce(is_same, op=MPI.LAND)
        return same_size and self.made_at.equation.harmonics == at.equation.harmonics

    def apply(self, b: np.ndarray) -> np.ndarray:
        """Return B^-1 b, exact or approximate, for this rank's pairs ``active_owned``, (m, 3, N_H).  Collective: one gather."""
        N_H = b.shape[-1]
        amplitudes = self.solve_all(to_complex(self.made_at.equation.gather(b.reshape(-1, N_H))))
        return to_real(amplitudes[self.local_rows], N_H).reshape(b.shape)

    def solve_all(self, b: np.ndarray) -> np.ndarray:
        """Return B_n^-1 b_n, exact or approximate, for all harmonics of the set, complex (n_rows, n_harmonics).  Local."""
        return np.stack([self.solve(n, b[:, n]) for n in range(b.shape[1])], axis=1)

    def solve(self, n: int, b: np.ndarray) -> np.ndarray:
        """Return B_n^-1 b, exact or approximate, for the n-th harmonic of the set, complex (n_rows,).  Local."""
        raise NotImplementedError


class HarmonicPreconditioner(PairsPreconditioner):
    """Factors of B_n, eq. (5.5), for the active pairs of a linearisation; reused for nearby ones.  Collective."""

    def __init__(self, at: Linearisation):
        super().__init__(at)
        P = at.equation.gather(complex_linear(at.P, at.equation.model.N_H))  # (n_active, n_harmonics, 3, 3)
        self.inverses = []
        for i, G_n in enumerate(at.G.blocks()):
            columns = G_n.reshape(len(G_n), -1, 3)
            G_P = REGULAR * np.einsum("rmi,mij->rmj", columns, P[:, i]).reshape(G_n.shape)
            self.inverses.append(Inverse(np.eye(len(G_n)) + G_P))

    def solve(self, n: int, b: np.ndarray) -> np.ndarray:
        """Return the solution for the right-hand side b of harmonic n."""
        return self.inverses[n].times(b)


class Inverse:
    """The inverse of a matrix, in single precision where that suffices for a preconditioner.  Local.

    A product with it takes a quarter of the time of a solution with factors: half the digits, and one pass over the memory.
    """

    def __init__(self, B: np.ndarray):
        v = np.ones(len(B), dtype=np.complex64 if np.iscomplexobj(B) else np.float32)
        with np.errstate(over="ignore", invalid="ignore"):  # numbers beyond single precision
            self.of_B = _inverse(B.astype(v.dtype))
            error = np.linalg.norm(B @ (self.of_B @ v) - v)
        if not error <= SINGLE_ERROR * np.sqrt(len(B)):
            self.of_B = _inverse(B)

    def times(self, b: np.ndarray) -> np.ndarray:
        """Return B^-1 b for one column."""
        return self.of_B @ b.astype(self.of_B.dtype)


def _inverse(B: np.ndarray) -> np.ndarray:
    """Return the inverse; 1 in place of that of a singular matrix, which then has no preconditioner."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)  # a preconditioner may be inaccurate
        try:
            return scipy.linalg.inv(B, check_finite=False)
        except scipy.linalg.LinAlgError:
            return np.eye(len(B), dtype=B.dtype)


def rows_of_rank(at: Linearisation) -> slice:
    """Return the slice of this rank's active pairs in the rows of all ranks, 3 per pair.  Collective: one gather."""
    comm, n = at.equation.comm, len(at.forces.active_owned)
    first = 3 * sum(comm.allgather(n)[: comm.rank])
    return slice(first, first + 3 * n)


def applied(preconditioner: Any, x: np.ndarray, at: Linearisation) -> np.ndarray:
    """Return the preconditioned rows ``x`` of this rank's active pairs at another linearisation, flat.

    The preconditioner is the identity for pairs that were not active where it was built.  Collective.
    """
    active, made_of = at.forces.active_owned, preconditioner.active_owned
    rows = x.reshape(len(active), *at.equation.shape[1:])
    if np.array_equal(active, made_of):
        return preconditioner.apply(rows).ravel()
    complete = np.zeros(at.equation.shape)
    complete[active] = rows
    complete[made_of] = preconditioner.apply(complete[made_of])
    return complete[active].ravel()


def complex_linear(P: np.ndarray, N_H: int) -> np.ndarray:
    """Return the complex-linear, harmonic-diagonal part (m, n_harmonics, 3, 3) of blocks dp/dU (m, 3 N_H, 3 N_H).

    Local.

    With amplitudes cos - i sin, the real map (cos, sin) -> (a cos + b sin, c cos + d sin) has the part
    (a + d) / 2 + i (b - c) / 2.
    """
    blocks = P.reshape(-1, 3, N_H, 3, N_H)
    first = N_H % 2  # column of the first cosine
    parts = np.empty((len(P), (N_H + 1) // 2, 3, 3), dtype=complex)
    if first:
        parts[:, 0] = blocks[:, :, 0, :, 0]
    for i in range(first, parts.shape[1]):
        c = 2 * i - first
        s = c + 1
        parts[:, i] = 0.5 * (blocks[:, :, c, :, c] + blocks[:, :, s, :, s])
        parts[:, i] += 0.5j * (blocks[:, :, c, :, s] - blocks[:, :, s, :, c])
    return parts
