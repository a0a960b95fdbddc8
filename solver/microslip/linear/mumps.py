"""A direct factorisation by MUMPS through PETSc: its options, its retries when memory is short, its failures in words."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any

import numpy as np
from petsc4py import PETSc

from ..parallel.errors import CaseError, ResourceError
from ..parallel.memory import gigabytes, refuse_beyond, shortage
from .analysis import FactorMemory, analyse, count, factor_memory, scaled_memory
from .dense import wrap
from .out_of_core import disks, room_on_disk, write_to_disk

_METIS = 5
_FOR_INERTIA = (13, 24, 31)  # no ScaLAPACK at the root, null pivots are counted, factors are dropped as they come
_RHS_BLOCK = 128  # right-hand sides MUMPS takes at once; its own 32 is up to twice as slow on 2 ranks
_RELAXATION = (None, 60, 150, 400)  # ICNTL(14): per cent of memory beyond the estimate
_WORKSPACE_TOO_SMALL = (-8, -9, -11, -12, -14, -15, -17, -20)
_OUT_OF_MEMORY = (-5, -7, -13, -19)
_BEYOND_OPTION, _DISK_FAILED = -19, -90
_PETSC_OUT_OF_MEMORY = 55
SINGULAR = (-6, -10, -40)  # structurally, numerically, not positive definite at the root
ADVICE = "use more ranks on more machines, a machine with more memory, or a coarser mesh"


def factorise(A: PETSc.Mat, prefix: str, what: str, *, inertia_only: bool = False) -> tuple[PETSc.KSP, dict[str, Any]]:
    """Factor A and return the KSP that holds the factor, and what is worth logging.

    Collective on A's communicator.  A flagged as SPD is factored without pivoting, otherwise as L D L^T.  The memory it takes is
    known after the analysis: a factor too large for it is written to disk, where one has room, and refused otherwise.

    Parameters
    ----------
    prefix : of the PETSc options, read last
    what : how messages call A
    inertia_only : count every negative pivot, those of the last front too, which ScaLAPACK would hide, and keep nothing else

    Returns
    -------
    ksp : to be destroyed by the caller
    info : "code" is 0, or one of ``SINGULAR`` if A has no factor; "said": lines on what was done for want of memory

    Raises
    ------
    ResourceError : not enough memory, also with more than estimated, and on disk; on every rank
    CaseError : an option chose something that keeps no factor, or MUMPS refused its options
    """
    start, said, relaxations, on_disk = perf_counter(), list[str](), iter(_RELAXATION), False
    relaxation = next(relaxations)
    while True:
        ksp = _direct_solver(A, prefix, relaxation, inertia_only)
        info = _attempt(ksp, A, prefix, what, relaxation, on_disk)
        code, said = info["code"], said + info.pop("said")
        if code >= 0 or code in SINGULAR:
            info.update(said=tuple(said), seconds=perf_counter() - start)
            return ksp, info
        ksp.destroy()
        failed = f"{what}: MUMPS ended its factorisation with INFOG(1) = {code}, INFOG(2) = {info['detail']}"
        more = next(relaxations, None) if code in _WORKSPACE_TOO_SMALL else None
        if more is not None:
            relaxation = more
            said.append(f"{failed}; again with {more} % of workspace beyond its estimate")
        elif code in _OUT_OF_MEMORY and not on_disk and not info["out_of_core"] and "memory" in info:
            on_disk = True
            said.append(f"{failed}; again with the factor on disk")
        else:
            raise failure(code, info["detail"], what, prefix, A.getSize()[0])


def foreseen(graph: PETSc.Mat, n_dof_each: int, entries_owned: int) -> FactorMemory | None:
    """Return the memory of a factor on this rank, from the coupling of nodes with ``n_dof_each`` unknowns each.

    Collective on the graph's communicator; nothing is solved.  ``entries_owned`` of the matrix lie on this rank.  None, on every
    rank, where PETSc has no MUMPS, or does not let it analyse alone.
    """
    ksp = _direct_solver(graph, "static_", None, inertia_only=False)
    try:
        pc = ksp.getPC()
        if not _is_mumps(pc) or analyse(pc, graph) != 0:
            return None
        return scaled_memory(pc.getFactorMatrix(), n_dof_each, entries_owned)
    finally:
        ksp.destroy()


def failure(code: int, detail: int, what: str, prefix: str, n: int) -> CaseError | ResourceError:
    """Return what MUMPS' INFOG(1) and INFOG(2) mean for the matrix ``what`` with ``n`` unknowns.  Local."""
    numbers = f"MUMPS INFOG(1) = {code}, INFOG(2) = {detail}"
    if code == _BEYOND_OPTION:
        numbers += f": -{prefix}mat_mumps_icntl_23 allows it too few MB"
    if code in _WORKSPACE_TOO_SMALL + _OUT_OF_MEMORY:
        return ResourceError(f"{what}: not enough memory for its factor ({n} unknowns, {numbers}); {ADVICE}")
    if code == _DISK_FAILED:
        return ResourceError(
            f"{what}: its factor could not be written to disk or read from it ({numbers}); make room, or name another folder "
            "with $MUMPS_OOC_TMPDIR"
        )
    return CaseError(f"{what}: MUMPS gave up with INFOG(1) = {code}, INFOG(2) = {detail}; check the -{prefix}mat_mumps options")


def _attempt(ksp: PETSc.KSP, A: PETSc.Mat, prefix: str, what: str, relaxation: int | None, on_disk: bool) -> dict[str, Any]:
    """Factor A once: analysis, choice of its place, numbers; return the report.  Collective.

    Raises
    ------
    CaseError, ResourceError : as :func:`factorise`; the KSP is then freed
    """
    placed: dict[str, Any] = {"out_of_core": False, "said": []}
    try:
        pc = ksp.getPC()
        if _is_mumps(pc) and analyse(pc, A) == 0:
            placed = _placed(A, pc.getFactorMatrix(), what, on_disk)
            if relaxation is not None:  # the user's option was too small
                pc.getFactorMatrix().setMumpsIcntl(14, relaxation)
        ksp.setUp()
        return _report(ksp) | placed
    except ResourceError:
        ksp.destroy()
        raise
    except PETSc.Error as error:
        ksp.destroy()
        if error.ierr == _PETSC_OUT_OF_MEMORY:
            raise ResourceError(f"{what}: not enough memory to hand it to its factorisation; {ADVICE}") from error
        raise CaseError(f"{what}: the factorisation could not start; check the -{prefix} options\n{error}") from error


def _placed(A: PETSc.Mat, F: PETSc.Mat, what: str, on_disk: bool) -> dict[str, Any]:
    """Choose memory or disk for an analysed factor; return the estimate, whether it goes to disk, and what is to be said.

    Collective.

    Raises
    ------
    ResourceError : neither has room; on every rank
    """
    comm, memory = A.comm.tompi4py(), factor_memory(F)
    what_of = f"{what}: its factor ({A.getSize()[0]} unknowns)"
    if F.getMumpsIcntl(22) == 1:  # the user's option
        refuse_beyond(comm, memory.out_of_core, what_of, ADVICE)
        return {"memory": memory, "out_of_core": True, "said": []}
    lacks = shortage(comm, memory.in_core)
    if lacks is None and not on_disk:
        return {"memory": memory, "out_of_core": False, "said": []}
    lacks_beside, folder = shortage(comm, memory.out_of_core), room_on_disk(comm, memory)
    if lacks_beside is not None or folder is None:
        less = f"; on disk it would still be so: {lacks_beside}" if lacks_beside else f"; nor is there room for {disks(memory)}"
        raise ResourceError(f"{what}: not enough memory for its factor ({A.getSize()[0]} unknowns): {lacks}{less}; {ADVICE}")
    write_to_disk(comm, F, folder)
    reason = f" does not fit into memory ({lacks})" if lacks else ""
    said = f"{what}: its factor of {gigabytes(8.0 * memory.entries)}{reason} is kept on disk, in {folder}"
    return {"memory": memory, "out_of_core": True, "said": [said]}


@contextmanager
def said_of_solve(ksp: PETSc.KSP) -> Iterator[PETSc.Mat]:
    """Yield the factor of a KSP to solve with; what MUMPS reports becomes an error with an exit status.  Local.

    MUMPS tells all ranks the same.

    Raises
    ------
    CaseError, ResourceError : on every rank
    """
    F = ksp.getPC().getFactorMatrix()
    try:
        yield F
    except PETSc.Error as error:
        if not _is_mumps(ksp.getPC()) or F.getMumpsInfog(1) >= 0:
            raise
        what, prefix = "a solve with the kept factor", ksp.getOptionsPrefix() or ""
        raise failure(F.getMumpsInfog(1), F.getMumpsInfog(2), what, prefix, F.getSize()[0]) from error


def solve_block(ksp: PETSc.KSP, B_owned: np.ndarray) -> np.ndarray:
    """Return this rank's rows of A^-1 B, (n_owned, m), column-major, unchecked.

    Collective.  All columns go through MUMPS together: at 16 columns, one costs a tenth of a solve by itself.
    """
    B_owned = np.asfortranarray(B_owned)
    X_owned = np.zeros_like(B_owned)
    B, X = wrap(B_owned, ksp.comm), wrap(X_owned, ksp.comm)
    with said_of_solve(ksp) as F:
        F.matSolve(B, X)
    B.destroy()
    X.destroy()
    return X_owned


def _direct_solver(A: PETSc.Mat, prefix: str, relaxation: int | None, inertia_only: bool) -> PETSc.KSP:
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
        if inertia_only:
            for number in _FOR_INERTIA:
                F.setMumpsIcntl(number, 1)
    return ksp


def _is_mumps(pc: PETSc.PC) -> bool:
    return pc.getFactorSolverType() == PETSc.Mat.SolverType.MUMPS


_ORDERINGS = {0: "AMD", 1: "given", 2: "AMF", 3: "SCOTCH", 4: "PORD", 5: "METIS", 6: "QAMD"}


def _report(ksp: PETSc.KSP) -> dict[str, Any]:
    """Return what MUMPS says of its factor; the values agree on all ranks.  Of other packages, success only.  Local."""
    pc = ksp.getPC()
    if not _is_mumps(pc):
        failed = ksp.getPC().getFailedReason() != 0
        return {"package": pc.getFactorSolverType(), "code": SINGULAR[1] if failed else 0, "detail": 0, "negative": 0, "null": 0}
    F = pc.getFactorMatrix()
    parallel = F.getMumpsInfog(32) == 2
    ordering = {1: "PT-Scotch", 2: "ParMETIS"} if parallel else _ORDERINGS
    return {
        "package": "mumps",
        "code": min(0, F.getMumpsInfog(1)),  # positive values are warnings
        "detail": F.getMumpsInfog(2),
        "negative": F.getMumpsInfog(12),  # pivots
        "null": F.getMumpsInfog(28),
        "ordering": ordering.get(F.getMumpsInfog(7), "unknown"),
        "entries": count(F.getMumpsInfog(29)),  # of the factor
        "memory_MB": F.getMumpsInfog(22),  # used while factoring, all ranks together
        "memory_max_MB": F.getMumpsInfog(21),  # of the largest rank
        "flops": F.getMumpsRinfog(3),
    }
