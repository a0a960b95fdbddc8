"""A Newton step: pairs that stick are eliminated, GMRES solves for the others (docs/theory.md, eq. 5.3, 5.4).

A pair that sticks neither carries p nor changes it.  Its rows of the Jacobian I + G P give its motion once that of the other
pairs is known, so that the iteration needs only the rows and columns of G between pairs that do not stick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from ..receptance.columns import ActiveColumns, ReceptanceColumns
from .direct import WholeInverse
from .petsc_contexts import ShellMatrix, ShellPreconditioner
from .preconditioner import HarmonicPreconditioner
from .residual import ContactForces, HarmonicBalance

FINEST = 1e-9  # relative tolerance of GMRES that no weight asks more than
SINGLE = 1e-5  # relative tolerance of GMRES down to which products in single precision are exact enough
SMALL = 2000  # rows of the pairs that do not stick, up to which double precision costs no more


class Gatherer:
    """Gathers the rows of all ranks in rank order and sums a few floats, in one call.  Sizes are agreed on once."""

    def __init__(self, comm, n_owned: int, n_extras: int):
        self.comm, self.n_extras = comm, n_extras
        if comm.size > 1:
            self.counts = np.array(comm.allgather(n_owned)) + n_extras
            self.starts = np.concatenate([[0], np.cumsum(self.counts)])
            self.buffer = np.empty(self.starts[-1])
            self.rows = np.concatenate([np.arange(a + n_extras, b) for a, b in zip(self.starts, self.starts[1:])])
            self.heads = self.starts[:-1, None] + np.arange(n_extras)

    def __call__(self, owned: np.ndarray, extras: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of all ranks and the sums of the extras.  Collective."""
        if self.comm.size == 1:
            return owned, np.array(extras)
        self.comm.Allgatherv(np.concatenate([extras, owned]), [self.buffer, self.counts])
        return self.buffer[self.rows], self.buffer[self.heads].sum(axis=0)


@dataclass(frozen=True)
class Linearisation:
    """What one Newton step holds fixed: the bordered Jacobian [I + G P, dr/dnu; n_U, n_nu] in scaled unknowns."""

    forces: ContactForces
    G: ReceptanceColumns
    r_nu: np.ndarray  # (n_owned, 3, N_H) d r / d nu
    n_U: np.ndarray  # (n_owned, 3, N_H) the row of the constraint
    n_nu: float
    gatherer: Gatherer  # of 3 N_H rows an active pair, and two extras

    def pair_forces(self, d_xi: np.ndarray) -> np.ndarray:
        """Return P d_xi of this rank's active pairs, flat.  Local; ``d_xi`` has their rows."""
        assert self.forces.P is not None, "made of a linearisation"
        return np.matmul(self.forces.P, d_xi.reshape(len(self.forces.P), self.forces.P.shape[2], 1)).ravel()

    def product(self, d_xi: np.ndarray, d_nu_owned: float) -> tuple[np.ndarray, float]:
        """Return the Jacobian times (d_xi, d_nu): this rank's rows and the constraint's.  Collective: one gather.

        ``d_nu_owned`` is d_nu on the rank that owns it and 0 elsewhere.
        """
        dp = self.pair_forces(d_xi[self.forces.active_owned])
        dp_all, (plane, d_nu) = self.gatherer(dp, (float(np.vdot(self.n_U, d_xi)), d_nu_owned))
        return d_xi + self.G.apply(dp_all.reshape(-1, d_xi.shape[-1])) + d_nu * self.r_nu, plane + self.n_nu * d_nu

    def constraint(self, comm, d_xi: np.ndarray, d_nu_owned: float) -> float:
        """Return the constraint's row of the same product alone.  Collective: one sum."""
        return float(comm.allreduce(float(np.vdot(self.n_U, d_xi)) + self.n_nu * d_nu_owned))


class NewtonStep:
    """Solves Newton's systems of one branch by GMRES on the pairs that do not stick.  Collective on ``problem.comm``."""

    def __init__(self, problem: HarmonicBalance):
        self.problem, self.comm = problem, problem.comm
        self.last = self.comm.rank == self.comm.size - 1  # owns the row of the parameter
        self.preconditioner: HarmonicPreconditioner | WholeInverse | None = None
        self.product = np.empty(0)
        self.weight = 1.0  # the largest of the residual's rows, the same on all ranks: GMRES is as much more exact
        self.in_double = False  # whatever the size: where steps in single precision lead nowhere
        self._active: np.ndarray | None = None
        self._columns: ActiveColumns | None = None
        self._ksp: PETSc.KSP | None = None

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        if self._ksp is not None:
            for thing in (self._ksp, self._A, self._b, self._x):
                thing.destroy()
            self._ksp = None

    def solve(self, at: Linearisation, b_U: np.ndarray, b_nu: float) -> tuple[np.ndarray, float, int, int]:
        """Return d_xi (n_owned, 3, N_H), d_nu (0 but on the rank that owns it), GMRES iterations and PETSc's reason.

        Collective.  ``b_U`` (n_owned, 3, N_H) are this rank's rows of the right-hand side, ``b_nu`` is its last row on the rank
        that owns it.  ``product`` keeps this rank's rows of the Jacobian times the step.
        """
        self._set_up(at)
        active = at.forces.active_owned
        b = self._b.getArray()
        b[: self.n] = b_U[active].ravel()
        b_of_row = self._condense_row(at, b_U)
        if self.last:
            b[self.n] = b_nu - b_of_row
        self._ksp.solve(self._b, self._x)
        x = self._x.getArray(readonly=True)
        d_nu_owned = float(x[self.n]) if self.last else 0.0
        dp_all, (_, d_nu) = at.gatherer(at.pair_forces(x[: self.n]), (0.0, d_nu_owned))
        others = at.G.apply(dp_all.reshape(-1, b_U.shape[-1])) + d_nu * at.r_nu
        d_xi = b_U - others
        d_xi[active] = x[: self.n].reshape(len(active), *b_U.shape[1:])
        self.product = d_xi + others
        reason = self._ksp.getConvergedReason()
        if reason < 0 and self._ksp.getResidualNorm() <= self._rtol * self._b.norm():
            reason = PETSc.KSP.ConvergedReason.CONVERGED_RTOL  # rounding kept it from the weight's; Newton makes up
        return d_xi, d_nu_owned, self._ksp.getIterationNumber(), reason

    @property
    def is_single(self) -> bool:
        """Whether the last system was solved in single precision."""
        return self._columns is not None and self._columns.precision is np.float32

    # -- the condensed system ----------------------------------------------------------------------------------

    def _set_up(self, at: Linearisation) -> None:
        """Copy what the products need, in single precision where that pays and GMRES asks for no more."""
        self.at, model = at, self.problem.model
        if self._active is None or not np.array_equal(self._active, at.forces.active):
            self._active = at.forces.active
            self._create(3 * len(at.forces.active_owned) * model.N_H)
            self._rtol, self._columns = self._ksp.getTolerances()[0], None
        rtol = max(self._rtol / self.weight, min(self._rtol, FINEST))
        self._ksp.setTolerances(rtol=rtol)
        is_large = 3 * len(at.forces.active) * model.N_H > SMALL
        precision = np.float32 if is_large and rtol >= SINGLE and not self.in_double else np.float64
        if self._columns is None or self._columns.precision is not precision:
            self._columns = ActiveColumns(at.G, precision)
        self._columns.move_to(at.G)  # all that the frequency changes
        assert at.forces.P is not None, "made of a linearisation"
        self._P: np.ndarray = self._columns.scaled(at.forces.P)
        self._r_nu = at.r_nu[at.forces.active_owned].ravel()

    def _condense_row(self, at: Linearisation, b_U: np.ndarray) -> float:
        """Eliminate the pairs that stick from the constraint's row; return what moves to its right-hand side.  Collective."""
        active = at.forces.active_owned
        self._w, self._n_nu = at.n_U[active].ravel(), at.n_nu
        of_stuck = at.n_U.copy()
        of_stuck[active] = 0.0
        mine = np.array([np.vdot(of_stuck, b_U), np.vdot(of_stuck, at.r_nu), np.vdot(of_stuck, of_stuck)])
        moved, slope, size = self.problem.gather_sum(mine)
        if size > 0.0:
            self._n_nu = at.n_nu - slope
            G_n = self.problem.gather_sum(at.G.apply_transposed(of_stuck)).reshape(-1, 3 * at.n_U.shape[-1])
            mine_of_all = np.isin(at.forces.active, active + self.problem.model.owned.start)
            assert at.forces.P is not None, "made of a linearisation"
            self._w = self._w - np.einsum("mij,mi->mj", at.forces.P, G_n[mine_of_all]).ravel()
        return float(moved)

    def _create(self, n: int) -> None:
        self.destroy()
        self.n = n
        self._gatherer = Gatherer(self.comm, n, 2)
        sizes = (n + int(self.last), PETSc.DETERMINE)
        self._A = PETSc.Mat().createPython((sizes, sizes), context=ShellMatrix(self.multiply), comm=self.comm)
        self._A.setUp()
        self._x, self._b = self._A.createVecs()
        self._ksp = PETSc.KSP().create(self.comm)
        self._ksp.setOptionsPrefix("hb_")
        self._ksp.setOperators(self._A)
        self._ksp.setType(PETSc.KSP.Type.GMRES)
        self._ksp.setGMRESRestart(100)
        self._ksp.setPCSide(PETSc.PC.Side.RIGHT)  # the residual that counts is the true one
        self._ksp.setTolerances(rtol=1e-3, atol=0.0, max_it=300)  # Newton makes up for it; fewer products in all
        pc = self._ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(ShellPreconditioner(self.precondition))
        self._ksp.setFromOptions()

    def multiply(self, x, y) -> None:
        """Multiply by the condensed matrix.  Collective: one gather."""
        values, out, N_H = x.getArray(readonly=True), y.getArray(), self.problem.model.N_H
        d_xi = values[: self.n]
        dp = np.matmul(self._P, d_xi.astype(self._P.dtype).reshape(len(self._P), 3 * N_H, 1)).ravel()
        d_nu_owned = float(values[self.n]) if self.last else 0.0
        dp_all, (plane, d_nu) = self._gatherer(dp, (float(np.vdot(self._w, d_xi)), d_nu_owned))
        out[: self.n] = d_xi + self._columns.apply(dp_all.reshape(-1, N_H)).ravel() + d_nu * self._r_nu
        if self.last:
            out[self.n] = plane + self._n_nu * d_nu

    def precondition(self, x, y) -> None:
        """Apply the preconditioner, the identity in micro-slip.  Collective."""
        values, out = x.getArray(readonly=True), y.getArray()
        out[:] = values
        if self.preconditioner is not None:
            whole = np.zeros(self.problem.shape)
            active = self.at.forces.active_owned
            whole[active] = values[: self.n].reshape(len(active), *self.problem.shape[1:])
            out[: self.n] = self.preconditioner.apply(whole)[active].ravel()
