"""A direct factorisation by MUMPS: options, retries when memory is short, messages of failures, solves."""

from __future__ import annotations

import mmap
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..assembly._rows import upper_triangle
from ..guards.memory import refuse_beyond, shortage
from ..messages.errors import CaseError, MicroslipError, ResourceError
from ..parallel.agree import on_each
from ..parallel.to_owners import ToOwners
from ..system.memory import gigabytes, give_back
from ..system.signals import is_stopping
from ..system.watchdog import patient
from .analysis import count, factor_memory
from .bridge import VARIABLE, within_int32
from .dense import diagonal_owned
from .inverse_entries import inverse_entries
from .ordering import Elimination, Order, elimination_order, last_of_all
from .out_of_core import disks, room_on_disk, usual_folder, write_to_disk

if TYPE_CHECKING:
    from collections.abc import Callable

    from ._mumps import Instance
    from .analysis import FactorMemory, Reports

_SIZE, _USED = 8, 9  # INFO: entries of the memory for factors, and of the factor
_MILLION = 1_000_000  # MUMPS rounds larger counts to it
_SCHUR, _ON_DISK = 19, 22  # ICNTL: 1: S on rank 0; 1: factor on disk
_REDUCES, _EXPANDS = 1, 2  # ICNTL(26): half a solve
_SIDES, _SPARSE, _DISTRIBUTED = 20, 1, 10  # ICNTL, and kinds of right-hand sides
ANALYSE, FACTOR, SOLVE, SAVE, RESTORE = 1, 2, 3, 7, 8  # MUMPS' jobs
DEFINITE, INDEFINITE = 1, 2  # MUMPS' SYM: without pivoting, and L D L^T with it
_GIVEN, _BY_BLOCKS = 1, 1  # ICNTL(7): the order is ours; ICNTL(15): rows of one pattern are analysed as one, half the work
# ICNTL: no scaling by MUMPS (a tenth of its time; done here); no ScaLAPACK at the root; null pivots are counted; factors
# are discarded
_FOR_INERTIA = ((8, 0), (13, 1), (24, 1), (31, 1))
RHS_BLOCK = 128  # right-hand sides MUMPS takes at once; its own 32 is up to twice as slow on 2 ranks
RELAXATION = (60, 150, 400)  # ICNTL(14): per cent of memory beyond the estimate
WORKSPACE_TOO_SMALL = (-8, -9, -11, -12, -14, -15, -17, -20)
_OUT_OF_MEMORY = (-5, -7, -13, -19)
_BEYOND_OPTION, _DISK_FAILED = -19, -90
_SAVED = "factor"  # prefix of the files with one rank's part of a saved factor
_ORDERINGS = {0: "AMD", 1: "METIS", 2: "AMF", 3: "SCOTCH", 4: "PORD", 5: "METIS", 6: "QAMD"}  # INFOG(7)
SINGULAR = (-6, -10, -40)  # structurally, numerically, not positive definite at the root
ADVICE = "use more ranks on more machines, a machine with more memory, or a coarser mesh"


@dataclass(eq=False)
class MumpsFactor:
    """The factor of a symmetric matrix, or its analysis, in MUMPS.

    Attributes
    ----------
    mumps : the bridge; freed by :meth:`destroy`
    order : of elimination; None, on every rank, if MUMPS chose it
    """

    mumps: Instance
    comm: Any  # MPI.Comm
    ranges: np.ndarray  # (size + 1,) rows of the ranks
    prefix: str
    order: Order | None = None
    schur: tuple[np.ndarray, np.ndarray] | None = None  # rows not eliminated, from 1, and S; None: all are eliminated
    units: np.ndarray | None = None  # (m,) powers of two by which rows and columns of S are scaled; None: 1
    _to_owners: ToOwners | None = None
    _workspace: mmap.mmap | None = None  # of the factor; None: MUMPS has it

    def take_workspace(self) -> None:
        """Provide the memory for an analysed factor, of which MUMPS would return nothing before the factor is freed.  Local."""
        size = max(8 * count(self.mumps.info(_SIZE)), mmap.PAGESIZE)
        with suppress(OSError):  # MUMPS then reports that there is none
            self._workspace = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
            self.mumps.set_workspace(np.frombuffer(self._workspace), self.mumps.info(_SIZE))

    def trim_workspace(self) -> None:
        """Return memory beyond the factor, which comes first, to the system; all of it where there is no factor.  Local."""
        if self.mumps.infog(1) < 0:
            self.mumps.set_workspace(np.empty(0), 0)
            self._workspace = None
        elif self._workspace is not None and hasattr(mmap, "MADV_DONTNEED"):
            entries = self.mumps.info(_USED)
            end = 8 * (count(entries) + _MILLION * (entries < 0))
            end += -end % mmap.PAGESIZE
            if end < len(self._workspace):
                self._workspace.madvise(mmap.MADV_DONTNEED, end, len(self._workspace) - end)

    def destroy(self) -> None:
        """Free the factor, except after a stopping signal, when other ranks do not take part.  Collective."""
        if not is_stopping():
            self.mumps.end()
            self._workspace = None

    def save(self, folder: str) -> None:
        """Write the factor, which lies in memory, into an empty folder: :func:`saved_file` of every rank.  Collective.

        Raises
        ------
        ResourceError : it could not be written; on every rank, and its files are removed
        """
        code = self.saved(folder, SAVE)
        if code < 0:
            raise ResourceError(f"{folder}: MUMPS cannot write there (INFOG(1) = {code})")

    def saved(self, folder: str, job: int) -> int:
        """Write the factor into a folder, or read it from there; return INFOG(1).  Collective."""

        def state_folder() -> None:
            try:
                self.mumps.set_saved(folder, _SAVED)
            except ValueError as error:
                raise ResourceError(f"{folder}: {error}") from error

        on_each(self.comm, state_folder)
        with patient():
            return self.mumps.run(job)

    def solve(self, B: np.ndarray | sp.csc_matrix) -> np.ndarray:
        """Return this rank's rows of A^-1 B, (n_owned, m), column-major, unchecked.

        Collective.  B is this rank's rows, or sparse (n_dof, m) and the same on every rank: MUMPS then skips the branches of its
        elimination tree that B does not touch.  All columns are solved together: one of 16 costs a tenth of a single solve.

        Raises
        ------
        CaseError, ResourceError : MUMPS gave up; on every rank
        """
        X = self._state(B)
        self._run_solve()
        return self._to_owner(X)

    def inverse_entries(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray | None:
        """Return some entries of A^-1 on rank 0; collective: :func:`.inverse_entries.inverse_entries`."""
        return inverse_entries(self.mumps, self.comm, int(self.ranges[-1]), rows, columns)

    def take_schur(self) -> np.ndarray:
        """Return the Schur complement on the rows not eliminated, (m, m) on rank 0, the upper triangle of it; once.  Local."""
        assert self.schur is not None, "with a Schur complement"
        rows, S = self.schur
        self.schur = rows, np.empty((0, 0), order="F")
        self.mumps.set_schur(*self.schur)  # solves do without it
        return S

    def reduced(self, B: np.ndarray | sp.csc_matrix) -> np.ndarray:
        """Return right-hand sides less the forces of the rows that are eliminated, (m, q) on rank 0, (0, q) elsewhere.

        Collective.  B as in :meth:`solve`.  :meth:`expanded` must come next.
        """
        assert self.schur is not None, "with a Schur complement"
        self._X = self._state(B)
        self._reduced = np.zeros((len(self.schur[0]) * (self.comm.rank == 0), B.shape[1]), order="F")
        self.mumps.set_reduced(self._reduced)
        self._run_solve(_REDUCES)
        return self._reduced

    def expanded(self, x: np.ndarray) -> np.ndarray:
        """Return this rank's rows of the solution, ``x`` (m, q) in the rows that are not eliminated, on rank 0.  Collective."""
        self._reduced[:] = x
        self._run_solve(_EXPANDS)
        return self._to_owner(self._X)

    def _state(self, B: np.ndarray | sp.csc_matrix) -> np.ndarray:
        """State right-hand sides as of :meth:`solve`; return the array in which MUMPS leaves its rows of the solution.  Local."""
        is_sparse, m, comm = sp.issparse(B), B.shape[1], self.comm
        self.mumps.set_icntl(_SIDES, _SPARSE if is_sparse else _DISTRIBUTED * (comm.size > 1))
        if is_sparse:
            within_int32(B.nnz + 1, "entries of right-hand sides")
            here = sp.csc_matrix(B if comm.rank == 0 else (B.shape[0], 0))
            starts, rows = ((each + 1).astype(np.int32) for each in (here.indptr[: None if comm.rank == 0 else 0], here.indices))
            self.mumps.set_sparse(m, starts, rows, here.data.astype(float))
        if comm.size == 1:
            X = np.zeros(B.shape, order="F") if is_sparse else np.array(B, order="F", dtype=float)
            self.mumps.set_dense(X)
            return X
        if not is_sparse:
            rows = np.arange(self.ranges[comm.rank] + 1, self.ranges[comm.rank + 1] + 1, dtype=np.int32)
            self.mumps.set_distributed(rows, np.array(B, order="F", dtype=float))
        n_here = self.mumps.info(23)  # pivots eliminated here
        self._rows_here, X = np.zeros(n_here, dtype=np.int32), np.zeros((n_here, m), order="F")
        self.mumps.set_solution(self._rows_here, X)
        return X

    def _run_solve(self, half: int = 0) -> None:
        """Solve for the given right-hand sides, or do ``half`` of it.  Collective."""
        self.mumps.set_icntl(26, half)
        with patient() if self.mumps.icntl(_ON_DISK) == 1 else nullcontext():
            code = self.mumps.run(SOLVE)
        if half != _REDUCES:
            self.mumps.drop()
        if code < 0:
            raise failure(code, self.mumps.infog(2), "a solve with the factor", self.prefix, int(self.ranges[-1]))

    def _to_owner(self, X: np.ndarray) -> np.ndarray:
        """Return this rank's rows of a solution from the rows that MUMPS left on the ranks.  Collective."""
        if self.comm.size == 1:
            return X
        if self._to_owners is None:  # a factor's rows stay where they are
            self._to_owners = ToOwners(self.comm, self.ranges, self._rows_here.astype(np.int64) - 1)
        return self._to_owners.send(X)


def factorise(
    A: PETSc.Mat,
    prefix: str,
    what: str,
    *,
    elimination: Elimination = Elimination(),  # noqa: B008  frozen
    shift: tuple[float, PETSc.Mat] | None = None,
    later: Callable[[FactorMemory], float] | None = None,
    schur: np.ndarray | None = None,
) -> tuple[MumpsFactor, dict[str, Any]]:
    """Factor A, symmetric and positive definite, without pivoting, or find the signs of the pivots of A - sigma M.

    Collective on A's communicator.  The memory it takes is known after the analysis: a factor too large for it, or for what comes
    later, is written to disk, if a disk has room; otherwise one that is too large alone is refused.

    Parameters
    ----------
    prefix : of the PETSc options, read last
    what : name of A in messages
    elimination : of the order of elimination
    shift : (sigma, M): A - sigma M is factored as L D L^T, every negative pivot counted, those of the last front too, and its
        entries discarded
    later : returns the bytes that this rank needs in addition to the factor, from the size of the factor
    schur : (m,) rows that are not eliminated, rising: their Schur complement is S of the factor

    Returns
    -------
    factor : to be destroyed by the caller
    info : "code" is 0, or one of ``SINGULAR`` if A has no factor; "messages": lines on measures for lack of memory

    Raises
    ------
    ResourceError : not enough memory, also with more than estimated, and on disk; on every rank
    CaseError : MUMPS refused its options, or is not the version that this program was built for
    """
    start = perf_counter()
    return factored(analysed(A, prefix, what, elimination=elimination, shift=shift, schur=schur), what, start, later)


def factored(
    factor: MumpsFactor, what: str, start: float, later: Callable[[FactorMemory], float] | None = None
) -> tuple[MumpsFactor, dict[str, Any]]:
    """Factor an analysed matrix, which MUMPS has; ``start`` is the time at which its analysis began.

    Collective; all else as of :func:`factorise`.
    """
    give_back()
    try:
        info = _with_numbers(factor, what, later or (lambda _: 0.0))
    except MicroslipError:  # on every rank; of another error other ranks may not know, and freeing waits for them
        factor.destroy()
        raise
    factor.mumps.drop()
    return factor, info | {"seconds": perf_counter() - start}


def restored(A: PETSc.Mat, prefix: str, folder: str) -> tuple[MumpsFactor, dict[str, Any]] | None:
    """Return the factor of A written by :meth:`MumpsFactor.save`, and its report; None, on every rank, if MUMPS rejects it.

    Collective on A's communicator.  MUMPS trusts its files: callers verify that they are complete.

    Raises
    ------
    CaseError : MUMPS is not the version that this program was built for
    """
    start, factor = perf_counter(), _started(A, prefix, DEFINITE)
    try:
        for number in range(1, 5):  # ignores unknown options silently; the controls of the factor come with it
            factor.mumps.set_icntl(number, 0)
        code = factor.saved(folder, RESTORE)
    except MicroslipError:  # on every rank
        factor.destroy()
        raise
    if code < 0:
        factor.destroy()
        return None
    info = report(factor.mumps) | {"memory": factor_memory(factor.mumps), "out_of_core": False, "messages": ()}
    return factor, info | {"seconds": perf_counter() - start}


def saved_file(rank: int) -> str:
    """Return the name of the file that holds a rank's part of a saved factor.  Local."""
    return f"{_SAVED}_{rank}.mumps"


def failure(code: int, detail: int, what: str, prefix: str, n: int) -> CaseError | ResourceError:
    """Return the meaning of MUMPS' INFOG(1) and INFOG(2) for the matrix ``what`` with ``n`` unknowns.  Local."""
    numbers = f"MUMPS INFOG(1) = {code}, INFOG(2) = {detail}"
    if code == _BEYOND_OPTION:
        numbers += f": -{prefix}mat_mumps_icntl_23 allows it too few MB"
    if code in WORKSPACE_TOO_SMALL + _OUT_OF_MEMORY:
        return ResourceError(f"{what}: not enough memory for its factor ({n} unknowns, {numbers}); {ADVICE}")
    if code == _DISK_FAILED:
        return ResourceError(
            f"{what}: its factor could not be written to disk or read from it ({numbers}); make room, or name another folder "
            "with $MUMPS_OOC_TMPDIR"
        )
    return CaseError(f"{what}: MUMPS gave up with INFOG(1) = {code}, INFOG(2) = {detail}; check the -{prefix}mat_mumps options")


def analysed(
    A: PETSc.Mat,
    prefix: str,
    what: str,
    *,
    elimination: Elimination = Elimination(),  # noqa: B008  frozen
    shift: tuple[float, PETSc.Mat] | None = None,
    schur: np.ndarray | None = None,
) -> MumpsFactor:
    """Hand a matrix to MUMPS and let it be analysed.  Collective; arguments as of :func:`factorise`."""
    factor = _started(A, prefix, INDEFINITE if shift else DEFINITE)
    mumps, comm, order = factor.mumps, factor.comm, elimination.order
    try:
        _set_controls(mumps, comm.size, prefix, is_inertia=shift is not None)
        scale = np.empty(0) if shift is None else _units(A)
        entries = on_each(comm, _handed_over, A, shift, scale, what)
        if mumps.icntl(7) != _GIVEN:
            order = None
        elif order is None:
            last = elimination.last if schur is None else schur
            order = elimination_order(A, np.empty(0, dtype=int) if last is None else last, schur is None)
        if schur is not None:
            order = None if order is None else last_of_all(order, schur)
            S: np.ndarray = np.zeros((len(schur) * (comm.rank == 0),) * 2, order="F")
            factor.schur, factor.units = ((schur + 1).astype(np.int32), S), scale[schur] if len(scale) else None
            mumps.set_schur(*factor.schur)
            mumps.set_icntl(_SCHUR, 1)
        if order is not None:
            mumps.set_order(order.places, order.starts)
        if schur is not None or (order is None and mumps.icntl(15) == _BY_BLOCKS):
            mumps.set_icntl(15, 0)
        mumps.set_matrix(A.getSize()[0], *entries, comm.size > 1)
        with patient():
            mumps.run(ANALYSE)
    except MicroslipError:  # on every rank
        factor.destroy()
        raise
    factor.order = order
    return factor


def _started(A: PETSc.Mat, prefix: str, sym: int) -> MumpsFactor:
    """Return a new instance of MUMPS for A.  Collective.

    Raises
    ------
    CaseError : it is another version than the one built for
    """
    from . import _mumps

    comm = A.comm.tompi4py()
    mumps = _mumps.Instance(PETSc.__file__, comm.py2f(), sym)
    if mumps.version != _mumps.BUILT_FOR:  # it is not used any more
        raise CaseError(
            f"microslip was built for MUMPS {_mumps.BUILT_FOR}, and PETSc has another; install it again: pip install "
            "--force-reinstall --no-deps . in the folder of microslip's setup.py, or set "
            f"{VARIABLE}=petsc in the environment"
        )
    return MumpsFactor(mumps, comm, np.array(A.getOwnershipRanges()), prefix)


def _set_controls(mumps: Instance, size: int, prefix: str, *, is_inertia: bool) -> None:
    """Set our controls, then the user's.  Local; the same on every rank."""
    ours = ((3, 0), (4, 0), (7, _GIVEN), (15, _BY_BLOCKS), (18, 3 * (size > 1)), (21, size > 1), (27, RHS_BLOCK))
    for number, value in (*ours, *(_FOR_INERTIA if is_inertia else ())):
        mumps.set_icntl(number, value)
    options = PETSc.Options(prefix)
    for kind, n, read, state in (("icntl", 60, options.getInt, mumps.set_icntl), ("cntl", 15, options.getReal, mumps.set_cntl)):
        for number in range(1, n + 1):
            if options.hasName(f"mat_mumps_{kind}_{number}"):
                state(number, read(f"mat_mumps_{kind}_{number}"))
    if mumps.icntl(4) > 0 and not options.hasName("mat_mumps_icntl_3"):
        mumps.set_icntl(3, 6)  # Fortran's unit of the screen, for MUMPS' output


def _units(A: PETSc.Mat) -> np.ndarray:
    """Return powers of two that make the diagonal of A about 1, (n_dof,): units of rows change no pivot.  Collective."""
    diagonal = np.concatenate(A.comm.tompi4py().allgather(diagonal_owned(A)))
    return np.exp2(-np.round(0.5 * np.log2(np.where(diagonal > 0.0, diagonal, 1.0))))


def _handed_over(
    A: PETSc.Mat, shift: tuple[float, PETSc.Mat] | None, scale: np.ndarray, what: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and values of the upper triangle of this rank's rows of A, or of A - sigma M.

    Local.  The values are scaled by rows and columns, ``scale`` (n_dof,), if it is not empty.
    """
    within_int32(A.getSize()[0], "unknowns")
    sigma, M = shift or (0.0, None)
    try:
        return upper_triangle(A, M, sigma, scale)
    except MemoryError as error:
        raise ResourceError(f"{what}: not enough memory to hand it to its factorisation; {ADVICE}") from error


def _with_numbers(factor: MumpsFactor, what: str, later: Callable[[FactorMemory], float]) -> dict[str, Any]:
    """Give an analysed factor its numbers, with more memory or on disk where it lacks; return the report.  Collective.

    Raises
    ------
    CaseError, ResourceError : as :func:`factorise`
    """
    messages, relaxations, on_disk, is_analysed = list[str](), iter(RELAXATION), False, factor.mumps.infog(1) >= 0
    is_partial = factor.schur is not None and factor.units is None  # such factors are not saved, and their entries not discarded
    while True:
        placed: dict[str, Any] = {"messages": []}
        if is_analysed:
            placed = _placed(factor, what, later, on_disk)
            has_workspace = is_partial and not (placed["out_of_core"] or messages)
            if has_workspace:
                factor.take_workspace()
            with patient():
                factor.mumps.run(FACTOR)
            if has_workspace:
                factor.trim_workspace()
        info = report(factor.mumps) | placed
        code, messages = info["code"], messages + info.pop("messages")
        if code >= 0 or code in SINGULAR:
            return info | {"messages": tuple(messages)}
        failed = f"{what}: MUMPS ended its factorisation with INFOG(1) = {code}, INFOG(2) = {info['detail']}"
        more = next(relaxations, None) if code in WORKSPACE_TOO_SMALL else None
        if more is not None:
            factor.mumps.set_icntl(14, more)  # an option was too small
            messages.append(f"{failed}; again with {more} % of workspace beyond its estimate")
        elif code in _OUT_OF_MEMORY and not on_disk and not info["out_of_core"] and "memory" in info:
            on_disk = True
            messages.append(f"{failed}; again with the factor on disk")
        else:
            raise failure(code, info["detail"], what, factor.prefix, int(factor.ranges[-1]))


def _placed(factor: MumpsFactor, what: str, later: Callable[[FactorMemory], float], on_disk: bool) -> dict[str, Any]:
    """Choose memory or disk for an analysed factor; return the estimate, whether it goes to disk, and messages.

    Collective.

    Raises
    ------
    ResourceError : neither has room; on every rank
    """
    comm, memory, n_dof = factor.comm, factor_memory(factor.mumps), int(factor.ranges[-1])
    if factor.mumps.icntl(_ON_DISK) == 1:  # the user's option
        refuse_beyond(comm, memory.out_of_core, f"{what}: its factor ({n_dof} unknowns)", ADVICE)
        write_to_disk(comm, factor.mumps, room_on_disk(comm, memory) or usual_folder())
        return {"memory": memory, "out_of_core": True, "messages": []}
    later_memory = later(memory)
    lacks, in_memory = shortage(comm, memory.in_core + later_memory), {"memory": memory, "out_of_core": False, "messages": []}
    if lacks is None and not on_disk:
        return in_memory
    lacks_beside, folder = shortage(comm, memory.out_of_core), room_on_disk(comm, memory)
    if lacks_beside is not None or folder is None:
        if not on_disk and shortage(comm, memory.in_core) is None:
            return in_memory  # later memory may be less than the forecast
        less = f"; on disk it would still be so: {lacks_beside}" if lacks_beside else f"; nor is there room for {disks(memory)}"
        raise ResourceError(f"{what}: not enough memory for its factor ({n_dof} unknowns): {lacks}{less}; {ADVICE}")
    write_to_disk(comm, factor.mumps, folder)
    with_what = " with what comes later" if comm.allreduce(later_memory) > 0.0 else ""
    reason = f", which does not fit into memory{with_what} ({lacks})," if lacks else ""
    message = f"{what}: its factor of {gigabytes(8.0 * memory.entries)}{reason} is on disk, in {folder}"
    return {"memory": memory, "out_of_core": True, "messages": [message]}


def report(mumps: Reports) -> dict[str, Any]:
    """Return MUMPS' report on its factor, the same on all ranks, from INFOG and RINFOG.  Local."""
    ordering = {1: "PT-Scotch", 2: "ParMETIS"} if mumps.infog(32) == 2 else _ORDERINGS
    return {
        "package": "mumps",
        "code": min(0, mumps.infog(1)),  # positive values are warnings
        "detail": mumps.infog(2),
        "negative": mumps.infog(12),  # pivots
        "null": mumps.infog(28),
        "ordering": ordering.get(mumps.infog(7), "unknown"),
        "entries": count(mumps.infog(29)),  # of the factor
        "memory_MB": mumps.infog(22),  # used while factoring, all ranks together
        "memory_max_MB": mumps.infog(21),  # of the largest rank
        "flops": mumps.rinfog(3),
    }
