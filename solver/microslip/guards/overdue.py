"""The end of a run that does not handle a signal in time, by a thread that the signal wakes.

Python handles a signal when the call in progress returns: a factorisation may take minutes.  MUMPS and mpi4py let other threads
run meanwhile, so that this thread can end the process; in calls that do not, faulthandler's timers end it.  The thread also
forwards a signal to the rank that saves, which may not have received it.
"""

from __future__ import annotations

import os
import select
import signal
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, NoReturn

from ..messages.errors import Interrupted
from ..system.files import remove_folders
from ..system.signals import STOPPING, TO_FIRST, Answer, is_concluded, is_unbroken, parting_words
from ..system.start import early_signal, launcher_rank
from ..system.watchdog import end_within
from .lock import release_all, started

if TYPE_CHECKING:
    from mpi4py import MPI

NOTICE = 0.6  # s without reaction until a line reports it: mpirun kills one second after its signal
ANSWER = 5.0  # s without reaction until the process ends
LEAVING = 5.0  # s from the message to the end of the process
_STILL = 1.0  # further s without a file being written, if the end waits for other ranks
_ABORTING = 2.0  # s that MPI may take to end the job
_LEAVE = b"\0"  # not a signal: wakes the thread to end it
ABORTS = 32  # tag of the message to rank 0 from a rank that ends all ranks


class _Thread:
    """The state of the thread that oversees signals."""

    sender: int | None = None  # of the pipe that wakes it


class _First:
    """The rank that saves, if it is another process of this machine."""

    process, start = 0, ""  # its number and start time; 0: none
    last: int | None = None  # the last stop signal that this process has received


def pass_on_to_first(comm: MPI.Comm) -> None:
    """Forward stop signals to the first rank of ``comm``, if it is a process of this machine.  Collective on ``comm``."""
    process, start = comm.bcast((os.getpid(), started(os.getpid())))
    is_here = comm.rank > 0 and start != "" and started(process) == start
    _First.process, _First.start = (process, start) if is_here else (0, "")


def repeat_early_signal() -> None:
    """Repeat a stop signal that arrived during the start of the program: to the first rank and to this process.  Local.

    A signal that this process has handled already, but before it knew the process of the first rank, is only forwarded.
    """
    number = early_signal()
    to_first = _First.last if number is None else number
    if to_first is not None:
        _pass_on(to_first)
    if number is not None:
        os.kill(os.getpid(), number)


def _pass_on(number: int) -> None:
    """Send a signal to the first rank unless it has ended.  Local; a repeated signal has no effect there."""
    _First.last = number
    if _First.process and started(_First.process) == _First.start:
        with suppress(ProcessLookupError):
            os.kill(_First.process, number)


def oversee_signals() -> None:
    """Start the thread.  Local; in the main thread of a process of the program."""
    receiver, sender = os.pipe()
    os.set_blocking(sender, False)
    with suppress(RuntimeError):  # no further thread available: signals are handled late in long calls
        threading.Thread(target=_oversee, args=(receiver,), name="signals", daemon=True).start()
        signal.set_wakeup_fd(sender, warn_on_full_buffer=False)
        _Thread.sender = sender


def leave_signals_to_main() -> None:
    """Let the thread receive no signals itself any more.  Local; once the main thread has left the start of MPI.

    METIS would handle one in another thread (parallel/metis.py).
    """
    if _Thread.sender is not None:
        os.write(_Thread.sender, _LEAVE)


def _oversee(receiver: int) -> NoReturn:
    """Wait for a stop signal, and ensure that the process ends after it."""
    while True:
        numbers = os.read(receiver, 64)
        if _LEAVE[0] in numbers:
            signal.pthread_sigmask(signal.SIG_BLOCK, (*STOPPING, signal.SIGUSR1))
        stopping = [number for number in numbers if number in STOPPING]
        if stopping and not is_concluded():
            _pass_on(stopping[0])
            _ensure_end(signal.Signals(stopping[0]).name)


def _ensure_end(name: str) -> None:
    """End the process if it does not handle a signal, or does not end after its message."""
    is_first = launcher_rank() == 0
    if not Answer.begun.wait(NOTICE) and is_first and not is_aborted():
        _write(f"microslip: {name} arrived: the call in progress may end within {ANSWER:.0f} s{parting_words()}\n")
    if not Answer.begun.wait(ANSWER - NOTICE if is_first else ANSWER + TO_FIRST) and not is_concluded():
        _end(f"stopped by {name} during a call that takes longer than {ANSWER:.0f} s{parting_words()}" if is_first else "")
    if is_first and _n_ranks() > 1 and not _is_reported():
        _end(f"stopped by {name}{parting_words()}")
    Answer.written.wait()
    time.sleep(LEAVING)
    _end("")


def _is_reported() -> bool:
    """Return whether the main thread reports the signal; False if it already waits for other ranks at its end."""
    answered = idle_since = time.monotonic()
    while not (Answer.written.wait(0.1) or Answer.of_part.is_set()):
        now = time.monotonic()
        idle_since = now if is_unbroken() else idle_since
        if now - answered > ANSWER - _STILL and now - idle_since > _STILL:
            return False
    return True


def _n_ranks() -> int:
    """Return the number of ranks, 1 unless MPI runs.  Local, in any thread."""
    with suppress(ImportError):
        from mpi4py import MPI

        if MPI.Is_initialized() and not MPI.Is_finalized() and _lets_threads_call(MPI):
            return MPI.COMM_WORLD.size
    return 1


def _end(message: str) -> NoReturn:
    """Print a message and end this process, and with it the job, independent of its main thread.  Local.

    No message if another rank has ended all ranks and reported the reason.
    """
    if message and not is_aborted():
        _write(f"microslip: error: {message}\n")
    release_all()
    remove_folders()
    end_within(_ABORTING)
    with suppress(ImportError):
        from mpi4py import MPI

        if _n_ranks() > 1:
            MPI.COMM_WORLD.Abort(Interrupted.exit_status)
    os._exit(Interrupted.exit_status)


def is_aborted() -> bool:
    """Return on rank 0 whether another rank has ended all ranks; a signal then is the launcher's.  Local, in any thread."""
    with suppress(ImportError):
        from mpi4py import MPI

        if MPI.Is_initialized() and not MPI.Is_finalized() and _lets_threads_call(MPI):
            return MPI.COMM_WORLD.iprobe(tag=ABORTS)
    return False


def _lets_threads_call(MPI) -> bool:
    return MPI.Query_thread() == MPI.THREAD_MULTIPLE


def _write(text: str) -> None:
    """Write to standard error without Python's buffers, whose locks the main thread may hold; errors are ignored."""
    with suppress(OSError, ValueError):
        if select.select([], [2], [], 0.0)[1]:
            os.write(2, text.encode(errors="backslashreplace"))
