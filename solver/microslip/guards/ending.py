"""The end of the program: every rank with the same exit status, every problem said once, no rank left waiting.

Problems that all ranks agreed on reach :func:`conclude` on all of them.  What one rank met alone, while the others wait
for it in some collective call, ends the job by MPI's Abort: nothing else would.
"""

from __future__ import annotations

import errno
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
from ..system.signals import Answer, conclude_signals, drop_output, ignore_signals, stop_requested
from ..system.start import launcher_rank
from ..system.watchdog import unwatched
from .overdue import ABORTS, is_aborted

if TYPE_CHECKING:
    from mpi4py import MPI

GRACE = 5.0  # s that the ranks may arrive apart with a problem they agreed on, and that rank 0 has to save after a signal
GRACE_OF_SIGNAL = 2.0  # s that rank 0 waits then: longer than mpirun does before it kills the ranks that follow an Abort
DEFECT = 70
_SAID = 2  # of a rank whose problem has been said; 1: it has one
_INTERRUPTED: list[Interrupted] = []  # kept with their traces, and so with the solvers in them
_NEWS = 0.2  # s that such a message may take; the launcher kills a second after its signal
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG)
_PETSC_OUT_OF_MEMORY = 55


def conclude(comm: MPI.Comm | None, action: Callable[[], int | None]) -> int:
    """Do ``action`` and return the exit status, the largest of all ranks.

    Collective on ``comm``, which may be None where MPI is missing.  Does not return from a defect, nor from a problem that
    other ranks do not know of, if there are several ranks.
    """
    status, problem = _last_outcome(comm, action)
    if comm is None or comm.size == 1:
        if launcher_rank() > 0:  # without MPI: the launcher ends rank 0, too, as soon as one rank ends
            time.sleep(1.0)
        elif problem is not None:
            _say_problem(str(problem), problem)
    else:
        status = _together(comm, status, problem)
    if isinstance(problem, Interrupted):
        _INTERRUPTED.append(problem)
    return status


def _last_outcome(comm: MPI.Comm | None, action: Callable[[], int | None]) -> tuple[int, MicroslipError | None]:
    """Do the last action of the process, as :func:`_outcome`: then no signal changes its end."""

    def to_its_end() -> int | None:
        status = action()
        conclude_signals()
        return status

    try:
        outcome = _outcome(comm, to_its_end)
        conclude_signals()
        return outcome
    except Interrupted as problem:  # while another problem was dealt with
        conclude_signals()
        return problem.exit_status, problem


def conclude_part(comm: MPI.Comm, name: str, action: Callable[[], None]) -> int:
    """Do ``action``, one of several that a job is made of, say a problem under its ``name`` and return its exit status.

    Collective on ``comm``, all ranks or a part of them.  Ends the job where :func:`conclude` does.
    """
    status, problem = _outcome(comm, action)
    if isinstance(problem, Interrupted):
        _INTERRUPTED.append(problem)
    return _together(comm, status, problem, name=f"{name}: ")


def _outcome(comm: MPI.Comm | None, action: Callable[[], int | None]) -> tuple[int, MicroslipError | None]:
    """Return the exit status of an action on this rank, and the problem that is still to be said."""
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
    """Make a ``sys.exit`` in the block a defect: what calls it there would end one rank, or a run without its results.  Local."""
    try:
        yield
    except SystemExit as stop:
        raise RuntimeError(f"sys.exit({stop.code!r}) was called in the middle of the work") from stop


def expected(problem: BaseException) -> MicroslipError | None:
    """Return a problem as one that the user, the machine or a signal made, or None if it is a defect.  Local."""
    if isinstance(problem, MicroslipError):
        return problem
    if isinstance(problem, MemoryError) or getattr(problem, "ierr", None) == _PETSC_OUT_OF_MEMORY:
        return ResourceError(
            f"not enough memory ({str(problem) or 'no more could be had'}); use more ranks on more machines, or a smaller model"
        )
    if (refused := refused_option(problem)) is not None:
        return CaseError(refused)
    if isinstance(problem, KeyboardInterrupt):
        return Interrupted("interrupted from the keyboard")
    if isinstance(problem, BrokenPipeError):
        drop_output(sys.stdout.fileno())  # with what is left to flush
        return Interrupted("the reader of the output went away")
    if isinstance(problem, OSError) and problem.errno in _DISK:
        where = f"{problem.filename}: " if problem.filename else ""
        return ResourceError(f"{where}{problem.strerror}; make room, or choose another disk with --out")
    return None


def require(comm: MPI.Comm | None, problem: str | None) -> None:
    """Raise CaseError on every rank if any rank passes a ``problem``.  Collective on ``comm``, which may be None."""
    if comm is not None:
        raise_together(comm, problem, CaseError)
    elif problem:
        raise CaseError(problem)


def leave(status: int) -> NoReturn:
    """End the process.  Collective on all ranks.

    After a signal at once: a solver that it interrupted can neither go on nor be freed.
    """
    ignore_signals()
    status = max(status, _flush())
    if not _INTERRUPTED:
        sys.exit(status)
    with suppress(ImportError):
        from mpi4py import MPI

        MPI.Finalize()
    remove_folders()
    os._exit(status)


def _flush() -> int:
    """Write what standard output and error still hold; return the status of the problem where that fails, else 0.  Local.

    What cannot be written is dropped: the interpreter would try again at its end, and exit with a status of its own.
    """
    status = 0
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as problem:
            expected_problem = expected(problem) or ResourceError(f"standard output or error: {problem.strerror}")
            drop_output(stream.fileno())
            if stream is sys.stdout:
                _say(str(expected_problem))
            status = max(status, expected_problem.exit_status)
    return status


def _say(text: str) -> None:
    """Write a problem to standard error at once."""
    with suppress(OSError):
        sys.stdout.flush()
    plain = "".join(letter if letter.isprintable() or letter in "\n\t" else "?" for letter in text)
    sys.stderr.write(f"microslip: error: {plain}\n")  # names of a file may hold what steers a terminal
    sys.stderr.flush()


def _say_problem(text: str, problem: MicroslipError | None) -> None:
    """Write a problem to standard error; of a signal that ends the program, everything has been saved by now."""
    _say(text)
    if isinstance(problem, Interrupted):
        Answer.said.set()


def _defect(comm: MPI.Comm | None, problem: BaseException) -> int:
    """Show the traceback of a mistake of this program, and end all ranks."""
    rank = "" if comm is None or comm.size == 1 else f" on rank {comm.rank} of {comm.size}"
    trace = "".join(traceback.format_exception(problem))
    _say(f"a defect of the program{rank}; please report it with these lines and run.log\n{trace}")
    if comm is not None and comm.size > 1:
        _abort(comm, DEFECT)
    return DEFECT


def _together(comm: MPI.Comm, status: int, problem: MicroslipError | None, name: str = "") -> int:
    """Wait for all ranks, let the first with a problem say it, and return the largest status.  Collective.

    A rank that has a problem waits for a while only; a rank without one waits for those that still compute.  A signal often
    finds the other ranks in the middle of something: rank 0, where everything is saved, says it before it waits for them.
    """
    is_said = comm.rank == 0 and isinstance(problem, Interrupted) and not _comes_from_abort()
    if is_said:
        _say_problem(f"{name}{problem}", None if name else problem)
        Answer.of_part.set()
    statuses = array("i", 2 * comm.size * [0])
    grace = None if problem is None else GRACE_OF_SIGNAL if is_said else GRACE
    with unwatched():
        if not _arrives(comm.Iallgather(array("i", [status, _SAID if is_said else problem is not None]), statuses), grace):
            if not is_said:
                _say(f"{name}{problem} (rank {comm.rank} of {comm.size}, alone)")
            _abort(comm, status)
        if not _arrives(comm.Ibarrier(), GRACE):  # a rank has waited in vain, has said so and ends this one, too
            _abort(comm, status)
    has_problem = statuses[1::2]
    if _SAID not in has_problem and comm.rank == next((rank for rank in range(comm.size) if has_problem[rank]), None):
        _say(f"{name}{problem}")
    comm.Barrier()  # a launcher kills the others as soon as one rank ends with a status
    return max(statuses[::2])


def _abort(comm: MPI.Comm, status: int) -> None:
    """End all ranks.  Rank 0 hears of it first, and takes the launcher's signal for no news."""
    if comm.rank > 0:
        comm.isend(None, 0, ABORTS)
    comm.Abort(status)


def _comes_from_abort() -> bool:
    """Return on rank 0 whether another one has ended all ranks: then a signal comes from the launcher."""
    began = time.monotonic()
    while time.monotonic() - began < _NEWS:
        if is_aborted():
            return True
        time.sleep(0.01)
    return False


def _arrives(request, grace: float | None) -> bool:
    """Wait for a request, for ``grace`` seconds at most; sleeping, as other ranks may still compute."""
    began = time.monotonic()
    while not request.Test():
        if grace is not None and time.monotonic() - began > grace:
            return False
        time.sleep(0.002)
    return True
