"""A direct factorisation through PETSc's interface to a package: solves only, no entries of the inverse, nothing on disk.

It is MUMPS where the program was built without the bridge to it, or another package where the options select one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..guards.memory import refuse_beyond
from ..messages.errors import CaseError
from ..parallel.petsc import free
from ..system.watchdog import patient
from .analysis import FactorMemory, factor_memory
from .bridge import VARIABLE
from .dense import wrap
from .mumps import ADVICE, RELAXATION, RHS_BLOCK, SINGULAR, WORKSPACE_TOO_SMALL, failure, report

_OURS = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}
_SINGULAR = -10  # as in MUMPS
_ZERO_PIVOT = (71, 81)  # errors of PETSc
_WORKSPACE, _ON_DISK, _MOST_MEMORY = 14, 22, 23  # ICNTL
CONTROLS = ((27, RHS_BLOCK),)
_ORDER, _BY_METIS = "mat_mumps_icntl_7", 5  # MUMPS takes another order where it was built without METIS
_FOR_INERTIA = ((13, 1), (24, 1))  # no ScaLAPACK at the root, which counts no signs; null pivots are counted


@dataclass(frozen=True, eq=False)
class PackageFactor:
    """The factor of a matrix in a package that PETSc calls."""

    ksp: PETSc.KSP
    order: None = None

    @property
    def mumps(self) -> Reports:
        """Reports of MUMPS, where that is the package."""
        return Reports(self.ksp.getPC().getFactorMatrix())

    def destroy(self) -> None:
        """Free the factor.  Collective."""
        free(self.ksp)

    def solve(self, B: np.ndarray | sp.csc_matrix) -> np.ndarray:
        """Return this rank's rows of A^-1 B, (n_owned, m), column-major, unchecked.

        Collective.  B is this rank's rows, or sparse (n_dof, m) and the same on every rank.
        """
        if sp.issparse(B):
            B = B.tocsr()[slice(*self.ksp.getOperators()[0].getOwnershipRange())].toarray(order="F")
        B_owned = np.asfortranarray(B)
        X_owned = np.zeros_like(B_owned)
        right, X = wrap(B_owned, self.ksp.comm), wrap(X_owned, self.ksp.comm)
        self.ksp.getPC().getFactorMatrix().matSolve(right, X)
        right.destroy()
        X.destroy()
        return X_owned

    def inverse_entries(self, rows: np.ndarray, columns: np.ndarray) -> None:
        """Return None: this package does not compute them."""


def is_requested(prefix: str) -> bool:
    """Return whether PETSc's options name another solver than ours.  Local; the same on every rank."""
    options = PETSc.Options(prefix)
    return any(options.hasName(name) and options.getString(name) != ours for name, ours in _OURS.items())


def factorise(
    A: PETSc.Mat, prefix: str, what: str, shift: tuple[float, PETSc.Mat] | None
) -> tuple[PackageFactor, dict[str, Any]]:
    """Factor A, or A - sigma M with ``shift`` (sigma, M), by the package of the options, by default MUMPS.

    Collective on A's communicator.

    Raises
    ------
    CaseError : an option chose something that keeps no factor or needs the bridge to MUMPS, or PETSc refused it
    ResourceError : MUMPS lacks memory, also with more than it estimated; on every rank
    """
    start, messages, relaxations = perf_counter(), list[str](), iter(RELAXATION)
    if not is_requested(prefix) and PETSc.Options(prefix).getInt(f"mat_mumps_icntl_{_ON_DISK}", 0) == 1:
        raise CaseError(
            f"-{prefix}mat_mumps_icntl_{_ON_DISK} 1: factors on disk need the bridge to MUMPS, which is not in use (microslip "
            f"doctor shows the reason); install MUMPS' headers and microslip again, or unset {VARIABLE}"
        )
    matrix = A if shift is None else _shifted(A, *shift)
    memory = None if is_requested(prefix) else foreseen(matrix, prefix)
    if memory is not None:
        refuse_beyond(A.comm.tompi4py(), memory.in_core, f"{what}: its factor ({A.getSize()[0]} unknowns)", ADVICE)
    more: int | None = None
    while True:
        ksp = _chosen(matrix, prefix)
        info = _attempt(ksp, prefix, what, is_inertia=shift is not None, more=more)
        code = info["code"]
        if code >= 0 or code in SINGULAR:
            report = {} if memory is None else {"memory": memory, "out_of_core": False, "interface": "PETSc"}
            return PackageFactor(ksp), info | report | {"messages": tuple(messages), "seconds": perf_counter() - start}
        ksp.destroy()
        more = next(relaxations, None) if code in WORKSPACE_TOO_SMALL else None
        if more is None:
            raise failure(code, info["detail"], what, prefix, A.getSize()[0])
        messages.append(
            f"{what}: MUMPS ended its factorisation with INFOG(1) = {code}, INFOG(2) = {info['detail']}; again with {more} % of "
            "workspace beyond its estimate"
        )


def foreseen(A: PETSc.Mat, prefix: str) -> FactorMemory | None:
    """Return the memory of a factor by MUMPS on this rank, from an analysis; None, on every rank, where options limit it.

    Collective on A's communicator.
    """
    if PETSc.Options(prefix).hasName(f"mat_mumps_icntl_{_MOST_MEMORY}"):
        return None
    analysed = PackageFactor(analyse(A, prefix))
    try:
        return factor_memory(analysed.mumps)
    finally:
        analysed.destroy()


def analyse(A: PETSc.Mat, prefix: str) -> PETSc.KSP:
    """Return a KSP in which MUMPS has analysed a matrix.  Collective.

    petsc4py has no call for the analysis alone: a limit of 1 MB ends the following factorisation before it allocates memory.
    """
    ksp = _chosen(A, prefix)
    ksp.getPC().setFactorSetUpSolverType()
    for number, value in (*CONTROLS, (_MOST_MEMORY, 1)):
        ksp.getPC().getFactorMatrix().setMumpsIcntl(number, value)
    with patient(), _ordered_by_metis(ksp):
        ksp.setUp()
    return ksp


@contextmanager
def _ordered_by_metis(ksp: PETSc.KSP) -> Iterator[None]:
    """Ask MUMPS for METIS' order in the block, unless options name an order: PETSc overwrites the control itself.  Local."""
    options = PETSc.Options(ksp.getOptionsPrefix())
    is_ours = not options.hasName(_ORDER)
    if is_ours:
        options[_ORDER] = _BY_METIS
    try:
        yield
    finally:
        if is_ours:
            options.delValue(_ORDER)


def _attempt(ksp: PETSc.KSP, prefix: str, what: str, *, is_inertia: bool, more: int | None) -> dict[str, Any]:
    """Let a KSP factor its matrix, MUMPS with ``more`` per cent of workspace; return the report.  Collective.

    Raises
    ------
    CaseError : PETSc refused
    """
    pc = ksp.getPC()
    package, code, negative = pc.getFactorSolverType(), 0, 0
    is_signed = package == "mumps" and pc.getType() == PETSc.PC.Type.CHOLESKY  # L D L^T, the signs of whose pivots MUMPS counts
    try:
        if is_signed:
            pc.setFactorSetUpSolverType()
            for number, value in (*CONTROLS, *(_FOR_INERTIA if is_inertia else ())):
                pc.getFactorMatrix().setMumpsIcntl(number, value)
            if more is not None:
                pc.getFactorMatrix().setMumpsIcntl(_WORKSPACE, more)
        with patient(), _ordered_by_metis(ksp):
            ksp.setUp()
        if is_signed:
            return report(Reports(pc.getFactorMatrix()))
        negative = pc.getFactorMatrix().getInertia()[0] if is_inertia else 0
    except PETSc.Error as error:
        code = _SINGULAR
        if error.ierr not in _ZERO_PIVOT:
            ksp.destroy()
            raise CaseError(f"{what}: the factorisation could not start; check the -{prefix} options\n{error}") from error
    package = pc.getFactorSolverType()  # PETSc chooses it as it sets up, where options name a kind of factor alone
    return {"package": package, "code": code, "detail": 0, "negative": negative, "null": 0}


@dataclass(frozen=True)
class Reports:
    """MUMPS' reports by their numbers, from PETSc."""

    factor: PETSc.Mat

    def info(self, number: int) -> int:
        """Return INFO(number) of MUMPS, of this rank."""
        return int(self.factor.getMumpsInfo(number))

    def infog(self, number: int) -> int:
        """Return INFOG(number) of MUMPS."""
        return int(self.factor.getMumpsInfog(number))

    def rinfog(self, number: int) -> float:
        """Return RINFOG(number) of MUMPS."""
        return float(self.factor.getMumpsRinfog(number))


def _chosen(A: PETSc.Mat, prefix: str) -> PETSc.KSP:
    """Return a KSP that factors A according to the options.  Collective.

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
    pc.setFactorSolverType(_OURS["pc_factor_mat_solver_type"])  # unless the options state another
    ksp.setFromOptions()
    if ksp.getType() != PETSc.KSP.Type.PREONLY or pc.getType() not in (PETSc.PC.Type.CHOLESKY, PETSc.PC.Type.LU):
        chosen = f"-{prefix}ksp_type {ksp.getType()} -{prefix}pc_type {pc.getType()}"
        ksp.destroy()
        raise CaseError(f"{chosen}: the factor is used for all solves, so it must be preonly with cholesky or lu")
    return ksp


def _shifted(A: PETSc.Mat, sigma: float, M: PETSc.Mat) -> PETSc.Mat:
    """Return A - sigma M.  Collective."""
    shifted = A.duplicate(copy=True)
    shifted.axpy(-sigma, M, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    shifted.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    shifted.setOption(PETSc.Mat.Option.SPD, False)
    return shifted
