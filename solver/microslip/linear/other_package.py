"""A direct factorisation by another package that PETSc has, where the options ask for one: solves, and nothing beyond them."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..messages.errors import CaseError
from ..system.watchdog import patient
from .dense import wrap

_OURS = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}
_SINGULAR = -10  # as MUMPS has it
_ZERO_PIVOT = (71, 81)  # errors of PETSc


@dataclass(frozen=True, eq=False)
class PackageFactor:
    """The factor of a matrix in another package."""

    ksp: PETSc.KSP
    order: None = None

    def destroy(self) -> None:
        """Free the factor.  Collective."""
        self.ksp.destroy()

    def solve(self, B_owned: np.ndarray) -> np.ndarray:
        """Return this rank's rows of A^-1 B, (n_owned, m), column-major, unchecked.  Collective."""
        B_owned = np.asfortranarray(B_owned)
        X_owned = np.zeros_like(B_owned)
        B, X = wrap(B_owned, self.ksp.comm), wrap(X_owned, self.ksp.comm)
        self.ksp.getPC().getFactorMatrix().matSolve(B, X)
        B.destroy()
        X.destroy()
        return X_owned

    def solve_sparse(self, B: sp.csc_matrix) -> np.ndarray:
        """Return the same for sparse right-hand sides (n_dof, m), the same on every rank.  Collective."""
        rows = slice(*self.ksp.getOperators()[0].getOwnershipRange())
        return self.solve(B.tocsr()[rows].toarray(order="F"))

    def inverse_entries(self, rows: np.ndarray, columns: np.ndarray) -> None:
        """Return None: there are none to be had."""


def is_asked_for(prefix: str) -> bool:
    """Return whether PETSc's options name another solver than ours.  Local; the same on every rank."""
    options = PETSc.Options(prefix)
    return any(options.hasName(name) and options.getString(name) != ours for name, ours in _OURS.items())


def factorise(
    A: PETSc.Mat, prefix: str, what: str, shift: tuple[float, PETSc.Mat] | None
) -> tuple[PackageFactor, dict[str, Any]]:
    """Factor A, or A - sigma M where ``shift`` is (sigma, M), by what the options name.  Collective on A's communicator.

    Raises
    ------
    CaseError : an option chose something that keeps no factor, or PETSc refused it
    """
    start, code, negative = perf_counter(), 0, 0
    ksp = _chosen(A if shift is None else _shifted(A, *shift), prefix)
    pc = ksp.getPC()
    try:
        with patient():
            ksp.setUp()
        negative = pc.getFactorMatrix().getInertia()[0] if shift is not None else 0
    except PETSc.Error as error:
        code = _SINGULAR
        if error.ierr not in _ZERO_PIVOT:
            ksp.destroy()
            raise CaseError(f"{what}: the factorisation could not start; check the -{prefix} options\n{error}") from error
    info = {"package": pc.getFactorSolverType(), "code": code, "detail": 0, "negative": negative, "null": 0, "said": ()}
    return PackageFactor(ksp), info | {"seconds": perf_counter() - start}


def _chosen(A: PETSc.Mat, prefix: str) -> PETSc.KSP:
    """Return a KSP that will factor A as the options say.  Collective.

    Raises
    ------
    CaseError : that would keep no factor
    """
    ksp = PETSc.KSP().create(A.comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(A)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.CHOLESKY)
    ksp.setFromOptions()
    if ksp.getType() != PETSc.KSP.Type.PREONLY or pc.getType() not in (PETSc.PC.Type.CHOLESKY, PETSc.PC.Type.LU):
        chosen = f"-{prefix}ksp_type {ksp.getType()} -{prefix}pc_type {pc.getType()}"
        ksp.destroy()
        raise CaseError(f"{chosen}: the factor is kept and used for everything, so it must be preonly with cholesky or lu")
    return ksp


def _shifted(A: PETSc.Mat, sigma: float, M: PETSc.Mat) -> PETSc.Mat:
    """Return A - sigma M.  Collective."""
    shifted = A.duplicate(copy=True)
    shifted.axpy(-sigma, M, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    shifted.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    shifted.setOption(PETSc.Mat.Option.SPD, False)
    return shifted
