"""Linear systems of Newton's method: sticking pairs are eliminated, GMRES solves for the others (docs/theory.md, section 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from ..receptance.columns import ActiveColumns
from .gmres import Gmres
from .linearisation import Border, Exactness, Gatherer, Linearisation, Step
from .preconditioner import PairsPreconditioner, applied
from .subdomain_preconditioners import LARGE, of_wide_slip
from .whole_inverse import LARGEST, LARGEST_AT_LAST, WholeInverse

if TYPE_CHECKING:
    from mpi4py import MPI

RTOL = 1e-3  # of GMRES: an inexact Newton method needs fewer products in total
FINEST = 1e-9  # smallest relative tolerance of GMRES, for any weight
SINGLE = 1e-5  # smallest relative tolerance of GMRES with products in single precision
SMALL = 2000  # rows of the active pairs up to which double precision costs no more
MANY_KRYLOV = 50  # GMRES iterations per Newton step beyond which the preconditioner of wide slip is built or rebuilt
MANY_IN_STIFF = 10  # the same with weighted rows
MANY_IN_LARGE = 25  # the same in a large joint and in a disc of several sectors, whose preconditioner costs little in relation


@dataclass(frozen=True, eq=False)
class Condensed:
    """The border (5.4) of the active pairs, after elimination of the sticking pairs."""

    r_nu: tuple[np.ndarray, ...]  # this rank's active rows, flat
    n_U: tuple[np.ndarray, ...]
    n_nu: np.ndarray  # (k, k)
    moved: np.ndarray  # (k,) contribution of the sticking pairs, moved to the right-hand side


class NewtonSolver:
    """Solves the Newton systems of one branch; reuses preconditioner and work arrays.  Collective on ``comm``."""

    def __init__(self, comm: MPI.Comm):
        self.comm = comm
        self.last = comm.rank == comm.size - 1  # owns the parameters and their rows
        self.preconditioner: PairsPreconditioner | WholeInverse | None = None
        self.needs_preconditioner = False
        self._active: np.ndarray | None = None
        self._columns: ActiveColumns | None = None
        self._springs: object = None  # updates to another contact stiffness that the columns have
        self._gmres: Gmres | None = None

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        if self._gmres is not None:
            self._gmres.destroy()
            self._gmres = None

    @property
    def is_single(self) -> bool:
        """Whether the last system was solved in single precision."""
        return self._columns is not None and self._columns.precision is np.float32

    def restore(self, preconditioner: PairsPreconditioner | WholeInverse | None, needs_one: bool) -> None:
        """Take over the preconditioner of another solver, and its request for a new one.  Local."""
        self.preconditioner, self.needs_preconditioner = preconditioner, needs_one

    def request_preconditioner(self) -> None:
        """Request a (new) preconditioner at the next linearisation.  Local."""
        self.needs_preconditioner = True

    def weigh(self, newton: int, krylov: int, weight: float) -> None:
        """Request a (new) preconditioner if GMRES needed many iterations per Newton step, for rows of this weight.  Local."""
        is_large = self._active is not None and (len(self._active) > LARGE or self._at.equation.model.n_sectors > 1)
        many = MANY_IN_STIFF if weight != 1.0 else MANY_IN_LARGE if is_large else MANY_KRYLOV
        if newton > 0 and krylov > many * newton:
            self.request_preconditioner()

    def solve(
        self,
        at: Linearisation,
        b_U: np.ndarray,
        b_nu: np.ndarray,
        border: Border,
        exactness: Exactness = Exactness(),  # noqa: B008  frozen
    ) -> Step:
        """Return the solution of the bordered system, eq. (5.3); see :meth:`Linearisation.solve`.  Collective."""
        self._build_preconditioner(at)
        gmres, rtol = self._set_up(at, border.k, exactness)
        self._border = self._condensed(at, border, b_U)
        active, shape = at.forces.active_owned, b_U.shape
        of_active = b_U[active].ravel()
        b = np.concatenate([of_active, b_nu - self._border.moved]) if self.last else of_active
        x, outcome = gmres.solve(b, self.preconditioner is not None, rtol)
        is_exact = isinstance(self.preconditioner, WholeInverse) and self.preconditioner.made_at is at
        if outcome.reason < 0 and 0 < at.n_rows <= LARGEST_AT_LAST and not is_exact and not gmres.reached(self._rtol):
            self.preconditioner = WholeInverse(at)
            x, outcome = gmres.solve(b, True, rtol)
        n = len(of_active)
        d_nu_owned = x[n:].copy() if self.last else np.zeros(border.k)
        dp_all, d_nu = self._gatherer(at.pair_forces(x[:n]), (*np.zeros(border.k), *d_nu_owned))
        other_columns = at.G.apply(dp_all.reshape(-1, shape[-1])) + border.columns_times(d_nu[border.k :])
        d_xi = b_U - other_columns
        d_xi[active] = x[:n].reshape(len(active), *shape[1:])
        reason = outcome.reason
        if reason < 0 and gmres.reached(self._rtol):
            reason = PETSc.KSP.ConvergedReason.CONVERGED_RTOL  # weighted tolerance below roundoff; Newton's method corrects
        return Step(d_xi, d_nu_owned, d_xi + other_columns, outcome.iterations, reason)

    # -- the condensed system ----------------------------------------------------------------------------------

    def _build_preconditioner(self, at: Linearisation) -> None:
        """Factor a preconditioner if requested; for a small system at every linearisation.  Collective."""
        is_small, is_whole = at.n_rows <= LARGEST, isinstance(self.preconditioner, WholeInverse)
        wanted = self.needs_preconditioner or (is_small and is_whole)
        if wanted and at.n_rows > 0:
            stays = is_whole and at.n_rows <= LARGEST_AT_LAST
            self.preconditioner = None  # its memory before that of the new one
            self.preconditioner = (WholeInverse if is_small or stays else of_wide_slip)(at)
            self.needs_preconditioner = False

    def _set_up(self, at: Linearisation, k: int, exactness: Exactness) -> tuple[Gmres, float]:
        """Copy the operands of the products, in single precision if faster and exact enough for GMRES.  Collective."""
        self._at, self._N_H = at, at.equation.model.N_H
        if self._gmres is None or self._active is None or not np.array_equal(self._active, at.forces.active):
            self.destroy()
            self._active, n = at.forces.active, 3 * len(at.forces.active_owned) * at.equation.model.N_H
            self._gatherer = Gatherer(self.comm, n, 2 * k)
            self._gmres = Gmres(self.comm, n + k * int(self.last), self._multiply, self._precondition, RTOL)
            self._rtol, self._columns = self._gmres.rtol, None
        rtol = max(self._rtol / exactness.weight, min(self._rtol, FINEST))
        is_single = at.n_rows > SMALL and rtol >= SINGLE and not exactness.in_double
        precision, springs = np.float32 if is_single else np.float64, at.G.model.spring_updates
        if self._columns is None or self._columns.precision is not precision or self._springs is not springs:
            self._columns, self._springs = ActiveColumns(at.G, precision), springs
        self._columns.move_to(at.G)  # update of all frequency-dependent data
        self._P: np.ndarray = self._columns.in_units(at.P)
        return self._gmres, rtol

    def _condensed(self, at: Linearisation, border: Border, b_U: np.ndarray) -> Condensed:
        """Eliminate the sticking pairs from the border, eq. (5.4).  Collective: a sum, and a product if the border has any."""
        active, equation = at.forces.active_owned, at.equation
        of_stuck = np.array(border.n_U)
        of_stuck[:, active] = 0.0
        mine = np.array([[np.vdot(n, b_U), *(np.vdot(n, r_nu) for r_nu in border.r_nu), np.vdot(n, n)] for n in of_stuck])
        sums = equation.sum(mine)
        rows, n_nu = [n_U[active].ravel() for n_U in border.n_U], border.n_nu.copy()
        for i in np.flatnonzero(sums[:, -1] > 0.0):
            n_nu[i] -= sums[i, 1:-1]
            G_n = equation.sum(at.G.apply_transposed(of_stuck[i])).reshape(-1, 3 * b_U.shape[-1])
            mine_of_all = slice(*np.searchsorted(at.forces.active, [equation.model.owned.start, equation.model.owned.stop]))
            rows[i] = rows[i] - np.einsum("mij,mi->mj", at.P, G_n[mine_of_all]).ravel()
        return Condensed(tuple(r_nu[active].ravel() for r_nu in border.r_nu), tuple(rows), n_nu, sums[:, 0])

    def _multiply(self, x: np.ndarray, out: np.ndarray) -> None:
        """Multiply by the condensed matrix of eq. (5.4).  Collective: one gather."""
        border, N_H = self._border, self._N_H
        k, n = len(border.r_nu), len(border.r_nu[0])
        d_xi = x[:n]
        dp = np.matmul(self._P, d_xi.astype(self._P.dtype, copy=False).reshape(len(self._P), 3 * N_H, 1)).ravel()
        d_nu_owned = x[n:] if self.last else np.zeros(k)
        rows = [float(np.vdot(n_U, d_xi)) for n_U in border.n_U]
        dp_all, sums = self._gatherer(dp, (*rows, *d_nu_owned))
        out[:n] = d_xi + self._columns.apply(dp_all.reshape(-1, N_H)).ravel()
        for d_nu, r_nu in zip(sums[k:], border.r_nu):
            out[:n] += d_nu * r_nu
        if self.last:
            out[n:] = sums[:k] + border.n_nu @ sums[k:]

    def _precondition(self, x: np.ndarray, out: np.ndarray) -> None:
        """Apply the preconditioner, which is not used in micro-slip.  Collective."""
        assert self.preconditioner is not None
        out[:], n = x, len(self._border.r_nu[0])
        out[:n] = applied(self.preconditioner, x[:n], self._at)
