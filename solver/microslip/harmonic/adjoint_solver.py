"""Adjoints of a point: sensitivities of the requested outputs to the contact forces (docs/theory.md, section 11).

    (1 + G^T P^T) chi = B^T

The matrix is that of a Newton step with P transposed and G^T, which has the static part of G and conjugate modal factors.
Sticking pairs are eliminated as in Newton's method.  One solve has all quantities, the cosine and sine of each output.
"""

import numpy as np
from mpi4py import MPI

from ..receptance.columns import ActiveColumns
from .gmres import Gmres, reuse
from .linearisation import Gatherer, Linearisation
from .preconditioner import PairsPreconditioner, applied
from .subdomain_preconditioners import LARGE, of_wide_slip
from .whole_inverse import LARGEST_AT_LAST, WholeInverse

MANY_KRYLOV = 50  # GMRES iterations beyond which the next adjoints are preconditioned
MANY_IN_SMALL = 100  # the same for a joint of at most ``LARGE`` active pairs, where one costs about 70 iterations
DIRECT = 100  # rows of the active pairs, all harmonics, up to which a factor is cheaper than GMRES
RTOL = 1e-3  # of GMRES: error bars are much less accurate


class AdjointSolver:
    """Solves for the adjoints, eq. (11.1), of points of a branch; reuses preconditioner and GMRES.  Collective on ``comm``."""

    def __init__(self, comm: MPI.Comm, rtol: float = RTOL, precision: type = np.float32, many: int = MANY_KRYLOV):
        self.comm, self.rtol, self.precision, self.many = comm, rtol, precision, many
        self.preconditioner: PairsPreconditioner | None = None
        self._gmres: Gmres | None = None
        self._factor: WholeInverse | None = None
        self._of: Linearisation | None = None  # whose operands are those of the products

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        if self._gmres is not None:
            self._gmres.destroy()
            self._gmres = None

    def restore(self, preconditioner: PairsPreconditioner | None) -> None:
        """Take over the preconditioner of another solver.  Local."""
        self.preconditioner = preconditioner

    def solve(self, at: Linearisation, B: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
        """Return chi and tau = P^T chi of this rank's pairs, and whether the solve converged.  Collective.

        ``at`` is the transposed linearisation; see :meth:`Linearisation.solve_transposed` for shapes.
        """
        equation, owned, is_solved = at.equation, at.forces.active_owned, True
        chi = B[:, equation.model.owned_rows].reshape(len(B), *equation.shape).copy()
        tau = np.zeros_like(chi)
        if len(at.forces.active) > 0:
            units = np.abs(B).max(axis=(1, 2))[:, None, None, None]
            units[units == 0.0] = 1.0
            self._at, self._shape = at, (len(B), len(owned), *equation.shape[1:])
            self._gatherer = Gatherer(self.comm, int(np.prod(self._shape)), 0)
            of_active, is_solved = (self._directly if at.n_rows <= DIRECT else self._by_gmres)(chi[:, owned] / units)
            of_active *= units
            tau[:, owned] = self._times_P(at.P, of_active)
            for i, tau_all in enumerate(self._gathered(tau[:, owned])):
                chi[i] -= at.G.apply(tau_all)
            chi[:, owned] = of_active
        return chi.reshape(len(B), -1), tau.reshape(len(B), -1), is_solved

    def _times_P(self, P: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return P x of this rank's active pairs, (n_quantities, m, 3, N_H) both.  Local; ``P`` is transposed already."""
        columns = x.reshape(len(x), len(P), P.shape[2]).transpose(1, 2, 0).astype(P.dtype, copy=False)  # (m, 3 N_H, n)
        return np.matmul(P, columns).transpose(2, 0, 1).reshape(x.shape)

    def _gathered(self, x: np.ndarray) -> np.ndarray:
        """Return rows (n_quantities, m, 3, N_H) of all ranks' active pairs, (n_quantities, 3 n_active, N_H).  Collective."""
        N_H = x.shape[-1]
        if self.comm.size == 1:
            return x.reshape(len(x), -1, N_H)
        rows, _ = self._gatherer(np.moveaxis(x, 0, 2).ravel())  # the quantities of a row are contiguous
        return rows.reshape(-1, len(x), N_H).swapaxes(0, 1)

    def _directly(self, b: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return the adjoints of the active pairs by one factor, (n_quantities, m, 3, N_H), and convergence.  Collective."""
        if self._factor is None or self._factor.made_at is not self._at:  # the steps of an iteration share one linearisation
            self._factor = WholeInverse(self._at)
        return self._if_finite(self._factor.solve(b), True)

    def _if_finite(self, x: np.ndarray, has_converged: bool) -> tuple[np.ndarray, bool]:
        is_solved = bool(self.comm.allreduce(has_converged and bool(np.isfinite(x).all()), op=MPI.LAND))
        return (x if is_solved else np.zeros_like(x)), is_solved

    # -- GMRES on the active pairs of all quantities -----------------------------------------------------------

    def _by_gmres(self, b: np.ndarray) -> tuple[np.ndarray, bool]:
        """Return the adjoints as :meth:`_directly`, by one GMRES solve for all quantities.  Collective."""
        gmres, many = self._set_up(b.size), self.many if len(self._at.forces.active) > LARGE else MANY_IN_SMALL
        for _ in range(2):
            x, outcome = gmres.solve(b.ravel(), self.preconditioner is not None)
            if outcome.iterations > many or outcome.reason < 0:
                self.preconditioner = of_wide_slip(self._at)
            if outcome.reason >= 0:
                break
        if outcome.reason < 0 and self._at.n_rows <= LARGEST_AT_LAST:
            return self._directly(b)
        return self._if_finite(x.reshape(b.shape).copy(), outcome.reason >= 0)

    def _set_up(self, n: int) -> Gmres:
        """Copy the operands of the products in single precision; recreate PETSc's objects if their size changed.  Collective."""
        at = self._at
        self._gmres = reuse(self._gmres, self.comm, n, lambda: Gmres(self.comm, n, self._multiply, self._precondition, self.rtol))
        if self.preconditioner is not None and not self.preconditioner.fits(at):
            self.preconditioner = None
        if self._of is not at:  # the steps of an iteration share one linearisation
            self._of, self._columns = at, ActiveColumns(at.G, self.precision)
            self._P = self._columns.in_units(at.P)
        return self._gmres

    def _multiply(self, x: np.ndarray, out: np.ndarray) -> None:
        """Multiply by 1 + G^T P^T of the active pairs.  Collective: one gather."""
        tau = self._gathered(self._times_P(self._P, x.reshape(self._shape)))
        out[:] = x + self._columns.apply_to_several(tau).ravel()

    def _precondition(self, x: np.ndarray, out: np.ndarray) -> None:
        """Apply the preconditioner, which is not used in micro-slip.  Collective."""
        out[:] = np.concatenate([applied(self.preconditioner, x_i, self._at) for x_i in x.reshape(self._shape)])
