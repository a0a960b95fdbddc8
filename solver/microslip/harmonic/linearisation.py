"""The linearisation of harmonic balance at one motion, for solves with the Jacobian and its transpose.

docs/theory.md, sections 5 and 11.  For a sticking pair p and dp/dU are zero.  Its rows of the Jacobian I + G P give its motion
from the motion of the other pairs, so that an iteration needs only the rows and columns of active pairs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from mpi4py import MPI

from ..receptance.columns import ReceptanceColumns
from .balance import HarmonicBalance
from .operating_point import ContactForces, OperatingPoint, Rates, law_rates, stiffness_rates
from .parameter_rates import law_rate, moved_by_springs, rate_of_linear_motion, structure_rates


@dataclass(frozen=True, eq=False)
class Border:
    """k additional columns and rows of the Jacobian, for k parameters and k constraints; scaled."""

    r_nu: tuple[np.ndarray, ...]  # (n_owned, 3, N_H) each, d r / d nu
    n_U: tuple[np.ndarray, ...]  # (n_owned, 3, N_H) each, the rows of the constraints
    n_nu: np.ndarray  # (k, k)

    @property
    def k(self) -> int:
        """The number of parameters."""
        return len(self.r_nu)

    def rows_times(self, comm: MPI.Comm, d_xi: np.ndarray, d_nu_owned: np.ndarray) -> np.ndarray:
        """Return the rows of the constraints times (d_xi, d_nu), (k,).  Collective: one sum."""
        products = [float(np.vdot(n_U, d_xi)) for n_U in self.n_U] + self.n_nu @ d_nu_owned
        return products if comm.size == 1 else comm.allreduce(products)

    def columns_times(self, d_nu: np.ndarray) -> np.ndarray | float:
        """Return the columns times d_nu (k,), (n_owned, 3, N_H).  Local."""
        return sum(d * r_nu for d, r_nu in zip(d_nu, self.r_nu))


@dataclass(frozen=True, eq=False)
class Step:
    """The solution of a bordered system."""

    d_xi: np.ndarray  # (n_owned, 3, N_H)
    d_nu_owned: np.ndarray  # (k,) on the rank that owns the parameters, 0 elsewhere
    product: np.ndarray  # (n_owned, 3, N_H) this rank's rows of the matrix times the step
    iterations: int  # of GMRES
    reason: int  # PETSc's


class Gatherer:
    """Gathers the rows of all ranks in rank order and sums a few floats, in one call.  Sizes are exchanged once."""

    def __init__(self, comm: MPI.Comm, n_owned: int, n_extras: int):
        self.comm = comm
        if comm.size > 1:
            self.counts = np.array(comm.allgather(n_owned)) + n_extras
            self.starts = np.concatenate([[0], np.cumsum(self.counts)])
            self.buffer = np.empty(self.starts[-1])
            self.rows = np.concatenate([np.arange(a + n_extras, b) for a, b in zip(self.starts, self.starts[1:])])
            self.heads = self.starts[:-1, None] + np.arange(n_extras)

    def __call__(self, owned: np.ndarray, extras: Sequence[np.ndarray | float] = ()) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of all ranks and the sums of the extras.  Collective."""
        if self.comm.size == 1:
            return owned, np.array(extras)
        self.comm.Allgatherv(np.concatenate([extras, owned]), [self.buffer, self.counts])
        return self.buffer[self.rows], self.buffer[self.heads].sum(axis=0)


@dataclass(frozen=True)
class Exactness:
    """Required accuracy of a Newton step."""

    weight: float = 1.0  # largest weight of the rows of the residual, the same on all ranks; divides the tolerance of GMRES
    in_double: bool = False  # double precision for any size, where steps in single precision make no progress


class BorderedSolver(Protocol):
    """Solver of bordered systems that may reuse data of earlier solves: newton_solver.py."""

    def solve(self, at: Linearisation, b_U: np.ndarray, b_nu: np.ndarray, border: Border, exactness: Exactness) -> Step:
        """Return the Newton step.  Collective."""


class SolverOfSeveral(Protocol):
    """Solver for several right-hand sides without a border: adjoint_solver.py."""

    def solve(self, at: Linearisation, B: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
        """Return the solutions for columns B, their residuals, and whether they converged.  Collective."""


@dataclass(frozen=True, eq=False)
class Linearisation:
    """I + G P at one motion and operating point, and derivatives of the residual by this point."""

    equation: HarmonicBalance
    at: OperatingPoint
    forces: ContactForces  # with tangents
    G: ReceptanceColumns

    @classmethod
    def of(cls, equation: HarmonicBalance, at: OperatingPoint, forces: ContactForces) -> Linearisation:
        """Return the linearisation under ``forces``, with tangents.  Collective where static columns are missing."""
        return cls(equation, at, forces, equation.receptance(at, forces.active))

    @property
    def P(self) -> np.ndarray:
        """dp/dU of this rank's active pairs, (m, 3 N_H, 3 N_H) [N/m]."""
        assert self.forces.P is not None, "made with tangents"
        return self.forces.P

    @property
    def n_rows(self) -> int:
        """Number of rows of the active pairs of all ranks."""
        return 3 * len(self.forces.active) * self.equation.model.N_H

    def rate(self, rates: Rates) -> np.ndarray:
        """Return d r / d parameter (n_owned, 3, N_H), eq. (5.2) and eq. (5.8), for given rates of the operating point.

        Local; collective of a whole disc, and where parameters of the law change: one gather per parameter, three for a
        stiffness.
        """
        dG_p = self.G.apply_rate(self.forces.p, *structure_rates(self.equation, rates))
        rate = dG_p - rate_of_linear_motion(self.equation, self.at, rates)
        for parameter, of_value in law_rates(rates):
            rate = rate + of_value * self.G.apply(law_rate(self.equation, self.forces, parameter))
        for parameter, of_value in stiffness_rates(rates):
            rate = rate - of_value * moved_by_springs(self.equation, self.at, parameter, self.G.apply(self.forces.p))
        return rate

    def pair_forces(self, d_xi: np.ndarray) -> np.ndarray:
        """Return P d_xi of this rank's active pairs, flat.  Local; ``d_xi`` has the rows of these pairs."""
        return np.matmul(self.P, d_xi.reshape(len(self.P), self.P.shape[2], 1)).ravel()

    def product(self, d_xi: np.ndarray, d_nu_owned: np.ndarray, border: Border) -> tuple[np.ndarray, np.ndarray]:
        """Return the bordered matrix, eq. (5.3), times (d_xi, d_nu): this rank's rows and the k constraint rows.  Collective.

        ``d_nu_owned`` (k,) is d_nu on the rank that owns it and 0 elsewhere.
        """
        dp = self.pair_forces(d_xi[self.forces.active_owned])
        products = [float(np.vdot(n_U, d_xi)) for n_U in border.n_U]
        dp_all, sums = Gatherer(self.equation.comm, len(dp), 2 * border.k)(dp, (*products, *d_nu_owned))
        of_rows, d_nu = sums[: border.k], sums[border.k :]
        rows = d_xi + self.G.apply(dp_all.reshape(-1, d_xi.shape[-1])) + border.columns_times(d_nu)
        return rows, of_rows + border.n_nu @ d_nu

    def solve(
        self,
        b_U: np.ndarray,
        b_nu: np.ndarray,
        border: Border,
        solver: BorderedSolver,
        exactness: Exactness = Exactness(),  # noqa: B008  frozen
    ) -> Step:
        """Return the solution of the bordered system (5.3).  Collective.

        ``b_U`` (n_owned, 3, N_H) are this rank's rows of the right-hand side, ``b_nu`` (k,) its last rows on the rank that owns
        the parameters and 0 elsewhere.  ``solver`` may reuse data of earlier solves.
        """
        return solver.solve(self, b_U, b_nu, border, exactness)

    def solve_transposed(self, B: np.ndarray, solver: SolverOfSeveral) -> tuple[np.ndarray, np.ndarray, bool]:
        """Return chi and tau = P^T chi with (1 + G^T P^T) chi = B^T, eq. (11.1), and whether the solve converged.  Collective.

        ``B`` (n_quantities, 3 n_pairs, N_H), the same on every rank; chi and tau (n_quantities, 3 n_owned N_H) of this rank.
        """
        return solver.solve(self.transposed(), B)

    def solve_several(self, B: np.ndarray, solver: SolverOfSeveral) -> tuple[np.ndarray, np.ndarray, bool]:
        """Return dU and P dU with (1 + G P) dU = B, and convergence; shapes as in :meth:`solve_transposed`.  Collective."""
        return solver.solve(self, B)

    def transposed(self) -> Linearisation:
        """Return the linearisation whose matrix is 1 + G^T P^T.  Local."""
        return replace(self, forces=replace(self.forces, P=self.P.transpose(0, 2, 1)), G=self.G.adjoint())
