"""A direct factorisation by MUMPS through PETSc: its options, its retries when memory is short, its failures in words."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
from petsc4py import PETSc

from ..parallel.errors import CaseError, ResourceError
from .dense import wrap

_METIS = 5
_RHS_BLOCK = 128  # right-hand sides MUMPS takes at once; its own 32 is up to twice as slow on 2 ranks
_RELAXATION = (None, 60, 150, 400)  # ICNTL(14): per cent of memory beyond the estimate
_WORKSPACE_TOO_SMALL = (-8, -9, -11, -14, -15, -17, -20)
_OUT_OF_MEMORY = (-5, -7, -13, -19)
SINGULAR = (-6, -10, -40)  # structurally, numerically, not positive definite at the root


def factorise(A: PETSc.Mat, prefix: str, what: str, *, exact_inertia: bool = False) -> tuple[PETSc.KSP, dict[str, Any]]:
    """Factor A and return the KSP that holds the factor, and what is worth logging.

    Collective on A's communicator.  A flagged as SPD is factored without pivoting, otherwise as L D L^T.

    Parameters
    ----------
    prefix : of the PETSc options, read last
    what : how messages call A
    exact_inertia : count every negative pivot, those of the last front too, which ScaLAPACK would hide

    Returns
    -------
    ksp : to be destroyed by the caller
    info : "code" is 0, or one of ``SINGULAR`` if A has no factor

    Raises
    ------
    ResourceError : not enough memory, also with more than estimated; on every rank
    CaseError : an option chose something that keeps no factor, or MUMPS refused its options
    """
    start = perf_counter()
    for relaxation in _RELAXATION:
        ksp = _direct_solver(A, prefix, relaxation, exact_inertia)
        try:
            ksp.setUp()
        except PETSc.Error as error:
            ksp.destroy()
            raise CaseError(f"{what}: the factorisation could not start; check the -{prefix} options\n{error}") from error
        info = _report(ksp)
        if info["code"] not in _WORKSPACE_TOO_SMALL:
            break
        ksp.destroy()
    code = info["code"]
    if code < 0 and code not in SINGULAR:
        ksp.destroy()
    if code in _WORKSPACE_TOO_SMALL + _OUT_OF_MEMORY:
        raise ResourceError(
            f"{what}: not enough memory for its factor ({A.getSize()[0]} unknowns, MUMPS INFOG(1) = {code}, INFOG(2) = "
            f"{info['detail']}); use a coarser mesh, a machine with more memory, or more nodes"
        )
    if code < 0 and code not in SINGULAR:
        raise CaseError(
            f"{what}: MUMPS gave up with INFOG(1) = {code}, INFOG(2) = {info['detail']}; check the -{prefix}mat_mumps options"
        )
    info["seconds"] = perf_counter() - start
    return ksp, info


def solve_block(ksp: PETSc.KSP, B_owned: np.ndarray) -> np.ndarray:
    """Return this rank's rows of A^-1 B, (n_owned, m), column-major, unchecked.

    Collective.  All columns go through MUMPS together: at 16 columns, one costs a tenth of a solve by itself.
    """
    B_owned = np.asfortranarray(B_owned)
    X_owned = np.zeros_like(B_owned)
    B, X = wrap(B_owned, ksp.comm), wrap(X_owned, ksp.comm)
    ksp.getPC().getFactorMatrix().matSolve(B, X)
    B.destroy()
    X.destroy()
    return X_owned


def _direct_solver(A: PETSc.Mat, prefix: str, relaxation: int | None, exact_inertia: bool) -> PETSc.KSP:
    """Return a KSP that will factor A: our defaults, then the user's options."""
    ksp = PETSc.KSP().create(A.comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(A)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
    ksp.setFromOptions()
    if ksp.getType() != PETSc.KSP.Type.PREONLY or pc.getType() not in (PETSc.PC.Type.CHOLESKY, PETSc.PC.Type.LU):
        chosen = f"-{prefix}ksp_type {ksp.getType()} -{prefix}pc_type {pc.getType()}"
        ksp.destroy()
        raise CaseError(f"{chosen}: the factor is kept and used for everything, so it must be preonly with cholesky or lu")
    if _is_mumps(pc):
        pc.setFactorSetUpSolverType()
        F = pc.getFactorMatrix()  # -mat_mumps_icntl_* are read later, so the user's word is the last
        F.setMumpsIcntl(7, _METIS)  # MUMPS itself takes its default ordering where it was built without
        F.setMumpsIcntl(27, _RHS_BLOCK)
        if relaxation is not None:
            F.setMumpsIcntl(14, relaxation)
        if exact_inertia:
            F.setMumpsIcntl(13, 1)
    return ksp


def _is_mumps(pc: PETSc.PC) -> bool:
    return pc.getFactorSolverType() == PETSc.Mat.SolverType.MUMPS


_ORDERINGS = {0: "AMD", 1: "given", 2: "AMF", 3: "SCOTCH", 4: "PORD", 5: "METIS", 6: "QAMD"}


def _report(ksp: PETSc.KSP) -> dict[str, Any]:
    """Return what MUMPS says of its factor; the values agree on all ranks.  Of other packages, success only.  Local."""
    pc = ksp.getPC()
    if not _is_mumps(pc):
        failed = ksp.getPC().getFailedReason() != 0
        return {"package": pc.getFactorSolverType(), "code": SINGULAR[1] if failed else 0, "detail": 0, "negative": 0}
    F = pc.getFactorMatrix()
    parallel = F.getMumpsInfog(32) == 2
    ordering = {1: "PT-Scotch", 2: "ParMETIS"} if parallel else _ORDERINGS
    return {
        "package": "mumps",
        "code": min(0, F.getMumpsInfog(1)),  # positive values are warnings
        "detail": F.getMumpsInfog(2),
        "negative": F.getMumpsInfog(12),  # pivots
        "ordering": ordering.get(F.getMumpsInfog(7), "unknown"),
        "entries": _count(F.getMumpsInfog(29)),  # of the factor
        "memory_MB": F.getMumpsInfog(22),  # used while factoring, all ranks together
        "memory_max_MB": F.getMumpsInfog(21),  # of the largest rank
        "flops": F.getMumpsRinfog(3),
    }


def _count(value: int) -> int:
    """Return a count that MUMPS gives in millions, as a negative number, where it exceeds 32 bits."""
    return value if value >= 0 else -value * 1_000_000
