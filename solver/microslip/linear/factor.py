"""The factor of K_L for static solves, modes and expansions; every solve is checked by its true residual."""

from __future__ import annotations

from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..messages.errors import CaseError, ConvergenceError, ResourceError
from ..parallel.ownership import summed
from ..system.watchdog import moved
from .dense import column_norms, diagonal_owned, explicit, multiply
from .direct import DirectSolver, factorise
from .free_motion import explain_singular, free_as_a_whole, is_singular
from .mumps import SINGULAR
from .ordering import Elimination
from .random_signs import random_signs
from .rigid_modes import InertiaRelief, rigid_modes
from .sector_factor import DiameterFactor
from .soft_modes import SoftModes

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..assembly.system import System
    from .analysis import FactorMemory

RESIDUAL_LIMIT = 1e-6  # |A x - b| / |b| of an answer
ROUNDING_LIMIT = 1e-3  # the same where rounding of A x explains it: a soft joint under a stiff structure
_REFINE_ABOVE = 1e-9  # one step of iterative refinement beyond this, unless rounding of A x explains it
PREFIX = "static_"  # of the PETSc options
_N_PROBES = 4  # columns of the randomised residual


class FactorCache(Protocol):
    """A factor of K_L stored by an earlier run.  All methods are collective, with the same result on every rank."""

    def restore(self, A: PETSc.Mat, prefix: str) -> tuple[DirectSolver, dict[str, Any]] | None:
        """Return the factor and its report; None if there is none."""

    def drop(self, why: str) -> None:
        """Remove it: it is at fault."""

    @property
    def messages(self) -> tuple[str, ...]:
        """Lines on why it was not used."""


class _NotDefiniteError(Exception):
    """A matrix has no Cholesky factor."""


class Factor:
    """Cholesky factor of a symmetric positive definite matrix; docs/theory.md, section 4.

    Of a structure without supports, solutions are those of inertia relief, :class:`.rigid_modes.InertiaRelief`.

    Attributes
    ----------
    A : PETSc.Mat (n_dof, n_dof), owned by the caller
    rigid : rigid-body modes of a structure without supports; None: none
    info : ordering, entries, memory [MB], seconds of the factorisation, notes on measures for lack of memory; solves,
        seconds and worst residual since
    soft_modes : modes by which solutions of softly held structures are corrected; None: no correction
    """

    def __init__(
        self,
        A: PETSc.Mat,
        system: System | None = None,
        what: str = "K_L",
        last: np.ndarray | None = None,
        later: Callable[[FactorMemory], float] | None = None,
        cache: FactorCache | None = None,
        M: PETSc.Mat | None = None,
        direct: Callable[[], tuple[DirectSolver, dict[str, Any]]] | None = None,
    ):
        """Factor A.

        Collective on A's communicator.

        Parameters
        ----------
        A : flagged as symmetric positive definite
        system : names the parts of the structure: ``comm``, ``parts``, ``part_names``, ``dof``; or None
        what : name of A in messages
        last : (m,) rows that are eliminated last, for fast entries of A^-1 between them
        later : returns the bytes that this rank needs in addition to the factor, from the size of the factor
        cache : a factor stored by an earlier run, which passed all tests
        M : mass matrix, with which the whole structure may be free; None: it may not
        direct : returns factor and report if these are not of A alone: of a nodal diameter

        Raises
        ------
        CaseError : A is singular: the message names the part that moves freely, and its motion; on every rank
        ResourceError : not enough memory, in memory and on disk; on every rank
        """
        self.A, self.what = A, what
        self.comm = A.comm.tompi4py()
        self._solver: DirectSolver | None = None
        self.soft_modes: SoftModes | None = None
        self.diagonal_owned = diagonal_owned(A)
        motions_owned = getattr(system, "rigid_owned", None)
        self.rigid = None if M is None or motions_owned is None else rigid_modes(A, M, motions_owned)
        if self.rigid is None and cache is not None and self._takes(cache):
            return
        self._direct = direct
        is_definite = self._factorise(last, later)
        if not is_definite and M is not None and motions_owned is None:  # matrices, of which no supports are known
            self.destroy()
            self.rigid = rigid_modes(A, M, free_as_a_whole(A, system, what))
            is_definite = self._factorise(last, later)
        if not is_definite:
            self.destroy()
            explain_singular(explicit(A), system, what)
        self.info["messages"] = (*(cache.messages if cache is not None else ()), *self.info["messages"])

    def _factorise(self, last: np.ndarray | None, later: Callable[[FactorMemory], float] | None) -> bool:
        """Factor A, with springs where it has rigid-body modes; return whether it has a factor.  Collective."""

        def factorised(A: PETSc.Mat) -> DirectSolver:
            made = self._direct or partial(factorise, A, PREFIX, self.what, elimination=Elimination(last), later=later)
            solver, self.info = made()
            if self.info["code"] in SINGULAR or self.info["negative"] > 0:
                solver.destroy()
                raise _NotDefiniteError
            return solver

        try:
            self._solver = factorised(self.A) if self.rigid is None else InertiaRelief(self.rigid, self.A, factorised)
        except _NotDefiniteError:
            return False
        self._begin_to_count()
        return not is_singular(self.A, self.diagonal_owned, self.solver)

    def _takes(self, cache: FactorCache) -> bool:
        """Restore the factor of an earlier run, if it is that of A by a solve with random forces.  Collective."""
        restored = cache.restore(self.A, PREFIX)
        if restored is None:
            return False
        self._solver, self.info = restored
        self._begin_to_count()
        first = self.A.getOwnershipRange()[0]
        forces_owned = self.diagonal_owned[:, None] * random_signs(first, len(self.diagonal_owned), 1, key=1)
        try:
            self.solve(forces_owned)
        except (ConvergenceError, CaseError, ResourceError):
            self.destroy()
            cache.drop(f"it is not that of {self.what}")
            return False
        self._begin_to_count()
        return True

    def _begin_to_count(self) -> None:
        """Count solves from here.  Local."""
        self.info.update(solves=0, refined=0, solve_seconds=0.0, residual=0.0)

    def destroy(self) -> None:
        """Free the factor; a second call does nothing.  Collective."""
        if self._solver is not None:
            self._solver.destroy()
            self._solver = None

    @property
    def solver(self) -> DirectSolver:
        """The solver that holds the factor.  Local; CaseError once it is freed, where MUMPS would end the process."""
        if self._solver is None:
            raise CaseError("the structure is closed, and its factor is freed; build it again, or close it after all responses")
        return self._solver

    def solve(self, B: np.ndarray | sp.csc_matrix) -> np.ndarray:
        """Return this rank's rows of A^-1 B.

        Collective on A's communicator.  Of sparse B, MUMPS skips the branches of its elimination tree that B does not touch: a
        third less time for the columns of R^T.

        Parameters
        ----------
        B : (n_owned, m) this rank's rows of the right-hand sides, m the same on every rank; or (n_dof, m) sparse, the same on
            every rank

        Returns
        -------
        X_owned : (n_owned, m), column-major

        Raises
        ------
        ConvergenceError : the true residual is above ``RESIDUAL_LIMIT``; on every rank
        """
        is_sparse = sp.issparse(B)
        B_owned = B.tocsr()[slice(*self.A.getOwnershipRange())] if is_sparse else np.asfortranarray(B, dtype=float)
        if B.shape[1] == 0:
            return np.zeros(B_owned.shape, order="F")
        start = perf_counter()
        return self._checked(B_owned, self.solver.solve(B if is_sparse else B_owned), start)

    @property
    def n_rigid(self) -> int:
        """The number of rigid-body modes."""
        return 0 if self.rigid is None else self.rigid.n

    def without_inertia(self, forces_owned: np.ndarray) -> np.ndarray:
        """Return forces (n_owned, m) less the inertia forces of rigid-body motion, P^T f.  Collective: one sum."""
        return forces_owned if self.rigid is None else self.rigid.balanced(forces_owned)

    def inverse_entries(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray | None:
        """Return the entries of A^-1 in some rows and columns, (n_rows, n_columns) on rank 0, (0, 0) elsewhere; unchecked.

        Collective on A's communicator.  None, on every rank, where the factor cannot give them: :class:`.direct.DirectSolver`,
        and where solutions are corrected by ``soft_modes``.
        """
        if self.soft_modes is not None:
            return None
        return self.solver.inverse_entries(rows, columns)

    def flexibility(self, left: sp.csr_matrix, right: sp.csc_matrix) -> np.ndarray | None:
        """Return left @ A^-1 @ right of a nodal diameter, (m_l, m_r) on rank 0, (0, 0) elsewhere; unchecked.

        Collective.  None, on every rank, for other factors, and where ``inverse_entries`` are None.
        """
        if self.soft_modes is not None or not isinstance(self.solver, DiameterFactor):
            return None
        return self.solver.flexibility(left, right)

    def _checked(self, B_owned: np.ndarray | sp.csc_matrix, X_owned: np.ndarray, start: float) -> np.ndarray:
        """Return X, refined once where that can help; raise if its residual stays too large.  Collective."""
        moved()
        error, rounding = self.relative_residual(B_owned, X_owned)
        if np.isfinite(error) and error > max(_REFINE_ABOVE, rounding):
            R_owned = (B_owned.toarray() if sp.issparse(B_owned) else B_owned) - multiply(self.A, X_owned)
            refined_owned = X_owned + self.solver.solve(R_owned)
            refined, rounding_refined = self.relative_residual(B_owned, refined_owned)
            if refined < error:
                X_owned, error, rounding = refined_owned, refined, rounding_refined
            self.info["refined"] += X_owned.shape[1]
        limit = max(RESIDUAL_LIMIT, min(ROUNDING_LIMIT, 5.0 * rounding))
        if not error <= limit:
            raise ConvergenceError(
                f"{self.what}: static solve with residual |A x - b| = {error:.1e} |b|, limit {limit:.0e}; the matrix is nearly "
                "singular or badly scaled: compare the joint's stiffnesses with the structure's"
            )
        self.info["solves"] += X_owned.shape[1]
        self.info["solve_seconds"] += perf_counter() - start
        self.info["residual"] = max(self.info["residual"], error)
        return X_owned if self.soft_modes is None else self.soft_modes.corrected(X_owned, B_owned)

    def relative_residual(self, B_owned: np.ndarray | sp.csc_matrix, X_owned: np.ndarray) -> tuple[float, float]:
        """Return the largest |A x - b| / |b| of the columns (the root of the sum of squares, if many), and that of rounding.

        Collective.  Beyond ``_N_PROBES`` columns, random sums of them are multiplied by A instead of all: with each
        column scaled by 1 / |b| and random signs, the expected square of the residual of such a sum is the sum of all
        squares, so that one bad column shows, at the price of four products.  Rounding of A x leaves a few
        eps |diag(A) x| / |b|, which no refinement in double precision removes.
        """
        m = X_owned.shape[1]
        if sp.issparse(B_owned):
            norms = np.sqrt(summed(self.comm, np.asarray(B_owned.multiply(B_owned).sum(axis=0)).ravel()))
        else:
            norms = column_norms(self.comm, B_owned)
        scale = np.divide(1.0, norms, out=np.ones(m), where=norms > 0.0)  # of a zero column, x itself is the error
        signs = np.eye(m) if m <= _N_PROBES else np.random.default_rng(m).choice([-1.0, 1.0], (m, _N_PROBES))
        probes = scale[:, None] * signs
        X_probed = X_owned @ probes
        error = column_norms(self.comm, self.without_inertia(multiply(self.A, X_probed) - B_owned @ probes))
        rounding = 20.0 * np.finfo(float).eps * column_norms(self.comm, self.diagonal_owned[:, None] * X_probed)
        return float(np.max(error)), float(np.max(rounding))
