"""The end of the program: the same exit status on every rank, every problem reported once, no rank left waiting.

Collective problems reach :func:`conclude` on all ranks.  A problem of a single rank, for which the others wait in a collective
call, ends the job by MPI's Abort, the only way to end them.
"""

from __future__ import annotations

import errno
import gc
import os
import sys
import time
import traceback
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, NoReturn

from ..messages.errors import CaseError, Interrupted, MicroslipError, ResourceError
from ..parallel.agree import raise_together
from ..parallel.petsc import refused_option
from ..system.files import remove_folders
from ..system.signals import Answer, conclude_signals, drop_output, ignore_signals, raise_stop, stop_requested
from ..system.start import launcher_rank
from ..system.watchdog import unwatched
from .overdue import ABORTS, is_aborted

if TYPE_CHECKING:
    from mpi4py import MPI

GRACE = 5.0  # s between the arrivals of ranks with a collective problem, and for rank 0 to save after a signal
GRACE_OF_SIGNAL = 2.0  # s that rank 0 waits after a signal: longer than mpirun does before it kills ranks after an Abort
DEFECT = 70
_REPORTED = 2  # state of a rank with a reported problem; 1: with an unreported problem
_INTERRUPTED: list[Interrupted] = []  # referenced with their traces, so that the solvers in them are not freed
_ABORT_NOTICE = 0.2  # s that a message of an Abort may take; the launcher kills one second after its signal
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG)
_PETSC_OUT_OF_MEMORY = 55


def conclude(comm: MPI.Comm | None, action: Callable[[], int | None]) -> int:
    """Run ``action`` and return the largest exit status of all ranks.

    Collective on ``comm``, which may be None without MPI.  On several ranks it does not return after a defect or a problem of a
    single rank.
    """
    status, problem = _last_outcome(comm, action)
    if comm is None or comm.size == 1:
        if launcher_rank() > 0:  # without MPI: the launcher also ends rank 0 as soon as one rank ends
            time.sleep(1.0)
        elif problem is not None:
            _report_problem(str(problem), problem)
    else:
        status = _together(comm, status, problem)
    if isinstance(problem, Interrupted):
        _INTERRUPTED.append(problem)
    return status


def _last_outcome(comm: MPI.Comm | None, action: Callable[[], int | None]) -> tuple[int, MicroslipError | None]:
    """Run the last action of the process as :func:`_outcome` does; afterwards no signal changes its end."""

    def to_its_end() -> int | None:
        status = action()
        conclude_signals()
        return status

    try:
        outcome = _outcome(comm, to_its_end)
        conclude_signals()
        return outcome
    except Interrupted as problem:  # while another problem was handled
        conclude_signals()
        return problem.exit_status, problem


def conclude_part(comm: MPI.Comm, name: str, action: Callable[[], None]) -> int:
    """Run ``action``, one of several of a job, report a problem with its ``name`` and return its exit status.

    Collective on ``comm``, all or some of the ranks.  Ends the job in the same cases as :func:`conclude`.
    """
    status, problem = _outcome(comm, action)
    if isinstance(problem, Interrupted):
        _INTERRUPTED.append(problem)
    return _together(comm, status, problem, name=f"{name}: ")


def _outcome(comm: MPI.Comm | None, action: Callable[[], int | None]) -> tuple[int, MicroslipError | None]:
    """Return the exit status of an action on this rank, and the problem that is not yet reported."""
    try:
        return action() or 0, None
    except SystemExit as stop:  # argparse, after --help
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None), None
    except BaseException as error:
        problem = expected(error) or stop_requested()
        if problem is None:
            return _defect(comm, error), None
        return problem.exit_status, problem


@contextmanager
def no_exit() -> Iterator[None]:
    """Make ``sys.exit`` in the block a defect: it would end a single rank, or a run without its results.  Local."""
    try:
        yield
    except SystemExit as stop:
        raise RuntimeError(f"sys.exit({stop.code!r}) was called in the middle of the work") from stop


def expected(problem: BaseException) -> MicroslipError | None:
    """Return a problem as an error of the user, the machine or a signal; None for a defect.  Local."""
    if isinstance(problem, MicroslipError):
        return problem
    if isinstance(problem, MemoryError) or getattr(problem, "ierr", None) == _PETSC_OUT_OF_MEMORY:
        return ResourceError(
            f"not enough memory ({str(problem) or 'an allocation failed'}); use more ranks on more machines, or a smaller model"
        )
    if (refused := refused_option(problem)) is not None:
        return CaseError(refused)
    if isinstance(problem, KeyboardInterrupt):
        return Interrupted("interrupted from the keyboard")
    if isinstance(problem, BrokenPipeError):
        drop_output(sys.stdout.fileno())  # including unflushed output
        return Interrupted("the reader of standard output has closed it")
    if isinstance(problem, OSError) and problem.errno in _DISK:
        where = f"{problem.filename}: " if problem.filename else ""
        return ResourceError(f"{where}{problem.strerror}; make room, or choose another disk with --out")
    return None


def require(comm: MPI.Comm | None, problem: str | None) -> None:
    """Raise CaseError on every rank if any rank passes a ``problem``.  Collective on ``comm``, which may be None.

    A problem after a signal that stops is its effect: a library converted it to a failed import.
    """
    if problem:
        raise_stop()
    if comm is not None:
        raise_together(comm, problem, CaseError)
    elif problem:
        raise CaseError(problem)


def leave(status: int) -> NoReturn:
    """End the process.  Collective on all ranks.

    After a signal it ends immediately: an interrupted solver can neither continue nor be freed.
    """
    ignore_signals()
    status = max(status, _flush())
    if not _INTERRUPTED:
        gc.freeze()  # else the interpreter searches all objects for cyclic garbage at its end, which takes 0.1 s
        sys.exit(status)
    with suppress(ImportError):
        from mpi4py import MPI

        MPI.Finalize()
    remove_folders()
    os._exit(status)


def _flush() -> int:
    """Flush standard output and error; return the status of a problem, otherwise 0.  Local.

    Output that cannot be written is dropped: the interpreter would try again at its end and change the exit status.
    """
    status = 0
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as problem:
            expected_problem = expected(problem) or ResourceError(f"standard output or error: {problem.strerror}")
            drop_output(stream.fileno())
            if stream is sys.stdout:
                _write_error(str(expected_problem))
            status = max(status, expected_problem.exit_status)
    return status


def _write_error(text: str) -> None:
    """Write a problem to standard error immediately."""
    with suppress(OSError):
        sys.stdout.flush()
    plain = "".join(letter if letter.isprintable() or letter in "\n\t" else "?" for letter in text)
    sys.stderr.write(f"microslip: error: {plain}\n")  # file names may contain control characters
    sys.stderr.flush()


def _report_problem(text: str, problem: MicroslipError | None) -> None:
    """Write a problem to standard error; after a signal that ends the program all results have been saved."""
    _write_error(text)
    if isinstance(problem, Interrupted):
        Answer.written.set()


def _defect(comm: MPI.Comm | None, problem: BaseException) -> int:
    """Print the traceback of a defect of this program, and end all ranks."""
    rank = "" if comm is None or comm.size == 1 else f" on rank {comm.rank} of {comm.size}"
    trace = "".join(traceback.format_exception(problem))
    _write_error(f"a defect of the program{rank}; please report it with these lines and run.log\n{trace}")
    if comm is not None and comm.size > 1:
        _abort(comm, DEFECT)
    return DEFECT


def _together(comm: MPI.Comm, status: int, problem: MicroslipError | None, name: str = "") -> int:
    """Wait for all ranks, let the first rank with a problem report it, and return the largest status.  Collective.

    A rank with a problem waits for a limited time; a rank without one waits for ranks that still compute.  After a signal rank 0,
    which has saved all results, reports it before it waits for the other ranks.
    """
    is_reported = comm.rank == 0 and isinstance(problem, Interrupted) and not _comes_from_abort()
    if is_reported:
        _report_problem(f"{name}{problem}", None if name else problem)
        Answer.of_part.set()
    statuses = array("i", 2 * comm.size * [0])
    grace = None if problem is None else GRACE_OF_SIGNAL if is_reported else GRACE
    with unwatched():
        if not _arrives(
            comm.Iallgather(array("i", [status, _REPORTED if is_reported else problem is not None]), statuses), grace
        ):
            if not is_reported:
                _write_error(f"{name}{problem} (rank {comm.rank} of {comm.size}, alone)")
            _abort(comm, status)
        if not _arrives(comm.Ibarrier(), GRACE):  # a rank has waited without success, has reported it and also ends this one
            _abort(comm, status)
    has_problem = statuses[1::2]
    if _REPORTED not in has_problem and comm.rank == next((rank for rank in range(comm.size) if has_problem[rank]), None):
        _write_error(f"{name}{problem}")
    comm.Barrier()  # a launcher kills the others as soon as one rank ends with a nonzero status
    return max(statuses[::2])


def _abort(comm: MPI.Comm, status: int) -> None:
    """End all ranks.  Rank 0 is notified first, so that it ignores the launcher's signal."""
    if comm.rank > 0:
        comm.isend(None, 0, ABORTS)
    comm.Abort(status)


def _comes_from_abort() -> bool:
    """Return on rank 0 whether another rank has ended all ranks; a signal then comes from the launcher."""
    began = time.monotonic()
    while time.monotonic() - began < _ABORT_NOTICE:
        if is_aborted():
            return True
        time.sleep(0.01)
    return False


def _arrives(request, grace: float | None) -> bool:
    """Wait for a request for at most ``grace`` seconds, with sleeps, because other ranks may still compute."""
    began = time.monotonic()
    while not request.Test():
        if grace is not None and time.monotonic() - began > grace:
            return False
        time.sleep(0.002)
    return True
