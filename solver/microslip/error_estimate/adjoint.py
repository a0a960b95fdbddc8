"""Adjoints of a point: what the requested outputs feel of the contact forces (docs/theory.md, eq. 11.1).

    (1 + G^T P^T) chi = B^T

The matrix is that of a Newton step with P transposed and G^T, which has the static part of G and conjugate modal factors.  As
there, pairs that stick are eliminated.  All quantities, the cosine and the sine of each output, are solved for together.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..harmonic.direct import WholeInverse
from ..harmonic.newton import Gatherer
from ..harmonic.petsc_contexts import ShellMatrix, ShellPreconditioner
from ..harmonic.preconditioner import HarmonicPreconditioner
from ..harmonic.residual import ContactForces, HarmonicBalance
from ..receptance.columns import ActiveColumns, ReceptanceColumns

MANY_KRYLOV = 50  # GMRES iterations beyond which the next adjoints are preconditioned
DIRECT = 100  # rows of the active pairs, all harmonics, up to which a factor is cheaper than GMRES
RTOL = 1e-3  # of GMRES: bars are far from that exact


class Adjoints:
    """Solves for the adjoints of points of a branch.  Collective on the communicator of the problem."""

    def __init__(self):
        self.found = True  # whether those of the last point were
        self._ksp: PETSc.KSP | None = None
        self._n = -1  # length of this rank's vectors, of which PETSc's objects are made
        self._preconditioner: HarmonicPreconditioner | None = None
        self._harmonics: tuple[int, ...] = ()

    def destroy(self) -> None:
        """Free the PETSc objects.  Collective."""
        if self._ksp is not None:
            for thing in (self._ksp, self._A, self._b, self._x):
                thing.destroy()
            self._ksp, self._preconditioner = None, None

    def solve(
        self, problem: HarmonicBalance, forces: ContactForces, G: ReceptanceColumns, B: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return chi and tau = P^T chi of this rank's pairs, each (n_quantities, 3 n_owned N_H).  Collective.

        Parameters
        ----------
        forces : at the point, with tangents
        G : the receptance there, columns of the active pairs
        B : (n_quantities, 3 n_pairs, N_H), the same on every rank
        """
        self.found, owned = True, forces.active_owned
        chi, tau = B[:, problem.model.owned_rows].reshape(len(B), *problem.shape).copy(), np.zeros((len(B), *problem.shape))
        if len(forces.active) > 0:
            assert forces.P is not None, "asked for with tangents"
            self.problem, self.G = problem, G.adjoint()
            self._P_transposed = forces.P.transpose(0, 2, 1)
            self.forces = replace(forces, P=self._P_transposed)
            units = np.abs(B).max(axis=(1, 2))
            units[units == 0.0] = 1.0
            self._gatherer = Gatherer(problem.comm, 3 * len(owned) * problem.model.N_H * len(B), 0)
            is_small = 3 * len(forces.active) * problem.model.N_H <= DIRECT
            of_active = (self._directly if is_small else self._by_gmres)(chi[:, owned] / units[:, None, None, None])
            of_active *= units[:, None, None, None]
            tau[:, owned] = self._transposed(self._P_transposed, of_active)
            for i, tau_all in enumerate(self._gathered(tau[:, owned])):
                chi[i] -= self.G.apply(tau_all)
            chi[:, owned] = of_active
        return chi.reshape(len(B), -1), tau.reshape(len(B), -1)

    def _transposed(self, P: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return P^T x of this rank's active pairs, (n_quantities, m, 3, N_H) both.  Local; ``P`` is transposed already."""
        columns = x.reshape(len(x), len(P), P.shape[2]).transpose(1, 2, 0).astype(P.dtype, copy=False)  # (m, 3 N_H, n)
        return np.matmul(P, columns).transpose(2, 0, 1).reshape(x.shape)

    def _gathered(self, x: np.ndarray) -> np.ndarray:
        """Return rows (n_quantities, m, 3, N_H) of all ranks' active pairs, (n_quantities, 3 n_active, N_H).  Collective."""
        N_H = x.shape[-1]
        if self.problem.comm.size == 1:
            return x.reshape(len(x), -1, N_H)
        rows, _ = self._gatherer(np.moveaxis(x, 0, 2).ravel(), ())  # quantities of a row lie together
        return rows.reshape(-1, len(x), N_H).swapaxes(0, 1)

    def _directly(self, b: np.ndarray) -> np.ndarray:
        """Return the adjoints of the active pairs by one factor, (n_quantities, m, 3, N_H).  Collective."""
        x = WholeInverse(self.problem, self.forces, self.G).solve(b)
        self.found = bool(self.problem.comm.allreduce(bool(np.isfinite(x).all()), op=MPI.LAND))
        return x if self.found else np.zeros_like(x)

    # -- GMRES on the active pairs of all quantities -----------------------------------------------------------

    def _by_gmres(self, b: np.ndarray) -> np.ndarray:
        """Return the adjoints of the active pairs by one solve for all, (n_quantities, m, 3, N_H).  Collective."""
        self._shape = b.shape
        self._set_up()
        self._b.getArray()[:] = b.ravel()
        for _ in range(2):
            self._ksp.solve(self._b, self._x)
            reason = self._ksp.getConvergedReason()
            if self._ksp.getIterationNumber() > MANY_KRYLOV or reason < 0:
                self._preconditioner = HarmonicPreconditioner(self.problem, self.forces, self.G)
            if reason >= 0:
                break
        x = self._x.getArray(readonly=True).reshape(b.shape).copy()
        self.found = bool(self.problem.comm.allreduce(reason >= 0 and bool(np.isfinite(x).all()), op=MPI.LAND))
        return x if self.found else np.zeros_like(x)

    def _set_up(self) -> None:
        """Copy what the products need in single precision; make PETSc's objects where their size is another.  Collective."""
        comm, n = self.problem.comm, int(np.prod(self._shape))
        if comm.allreduce(n != self._n or self._ksp is None, op=MPI.LOR):
            self._create(n)
        if self._harmonics != self.problem.model.harmonics.chosen:
            self._harmonics, self._preconditioner = self.problem.model.harmonics.chosen, None
        self._columns = ActiveColumns(self.G, np.float32)
        self._P = self._columns.scaled(self._P_transposed)

    def _create(self, n: int) -> None:
        self.destroy()
        comm, self._n = self.problem.comm, n
        self._A = PETSc.Mat().createPython(((n, PETSc.DETERMINE),) * 2, context=ShellMatrix(self.multiply), comm=comm)
        self._A.setUp()
        self._x, self._b = self._A.createVecs()
        self._ksp = PETSc.KSP().create(comm)
        self._ksp.setOptionsPrefix("hb_")
        self._ksp.setOperators(self._A)
        self._ksp.setType(PETSc.KSP.Type.GMRES)
        self._ksp.setGMRESRestart(100)
        self._ksp.setPCSide(PETSc.PC.Side.RIGHT)  # the residual that counts is the true one
        self._ksp.setTolerances(rtol=RTOL, atol=0.0, max_it=300)
        pc = self._ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(ShellPreconditioner(self.precondition))
        self._ksp.setFromOptions()

    def multiply(self, x, y) -> None:
        """Multiply by 1 + G^T P^T of the active pairs.  Collective: one gather."""
        values = x.getArray(readonly=True)
        tau = self._gathered(self._transposed(self._P, values.reshape(self._shape)))
        G_tau = self._columns.apply_to_several(tau)
        y.getArray()[:] = values + G_tau.ravel()

    def precondition(self, x, y) -> None:
        """Apply the preconditioner, the identity in micro-slip.  Collective."""
        values, out = x.getArray(readonly=True), y.getArray()
        out[:] = values
        if self._preconditioner is not None:
            owned, of_active = self.forces.active_owned, out.reshape(self._shape)
            for i, x_i in enumerate(values.reshape(self._shape)):
                whole = np.zeros(self.problem.shape)
                whole[owned] = x_i
                of_active[i] = self._preconditioner.apply(whole)[owned]
