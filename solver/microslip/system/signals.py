"""Signals: SIGUSR1 saves and continues; SIGTERM, SIGINT and SIGHUP save and stop.

Under Open MPI's mpirun SIGUSR1 reaches all ranks; any of the others makes it send SIGTERM to them, a second later, and kill
them another second later.  Schedulers that start the ranks themselves send to all of them.
"""

import os
import select
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ..messages.errors import Interrupted
from .watchdog import end_within

STOPPING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
TO_FIRST = 2.5  # s that other ranks go on, in case the first has heard of the signal, too
UNWINDING = 60.0  # s that the way out may take: a library that waits there for other ranks would never end


class _Requests:
    """Requests by signals so far."""

    to_save = False
    to_stop: Interrupted | None = None
    waits_for_first = False  # another rank saves, and this one continues for a while to permit it
    is_over = False  # the end of the program is decided
    n_holding = 0  # blocks at work that are not to be broken off
    parting: str = ""  # end of the message on a stop


class Answer:
    """How far the main thread has come with a signal that stops; for a thread that watches it."""

    begun = threading.Event()  # it is on its way out
    written = threading.Event()  # the message is written: everything is saved
    of_part = threading.Event()  # a part of the job has written its message; others may still save


def obey_signals(is_first: bool = True) -> None:
    """Install the handlers of this module; a signal that the caller ignores, as nohup does, stays ignored.  Local.

    To be called again after PETSc has started, which takes SIGPIPE.  The rank that saves ``is_first`` to stop:
    if another one did, the first would wait for it in the midst of a library, where no signal is answered.
    """
    _Requests.to_save, _Requests.to_stop, _Requests.waits_for_first = False, None, not is_first
    _Requests.is_over = False
    Answer.begun.clear()
    Answer.of_part.clear()
    for number, answer in (*((number, _stop) for number in STOPPING), (signal.SIGUSR1, _save)):
        ignored = signal.getsignal(number) == signal.SIG_IGN
        signal.signal(number, signal.SIG_IGN if ignored else answer)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # PETSc's handler ends the process; without it the write fails


@contextmanager
def handlers_unchanged() -> Iterator[None]:
    """Give signals back the handlers that a library replaces in the block; one that arrives meanwhile waits.  Local."""
    numbers = (*STOPPING, signal.SIGUSR1)
    if threading.current_thread() is not threading.main_thread():  # of a notebook: handlers are not those of this program
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    handlers = [signal.getsignal(number) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, handlers):
            if handler is not None:
                signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def unsignalled() -> Iterator[None]:
    """Let threads that start in the block receive no signals: the main thread has them all.  Local."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (*STOPPING, signal.SIGUSR1))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def save_requested() -> bool:
    """Return whether SIGUSR1 has come since the last call.  Local."""
    is_requested, _Requests.to_save = _Requests.to_save, False
    return is_requested


def conclude_signals() -> None:
    """Let no signal change the end of the program any more, which is decided.  Local."""
    _Requests.is_over = True


def is_concluded() -> bool:
    """Return whether the end of the program is decided.  Local."""
    return _Requests.is_over


def ignore_signals() -> None:
    """Ignore signals until the process ends: Python takes its handlers back before that.  Local."""
    for number in (*STOPPING, signal.SIGUSR1):
        signal.signal(number, signal.SIG_IGN)


def is_stopping() -> bool:
    """Return whether a stopping signal has arrived and this process is ending.  Local."""
    return _Requests.to_stop is not None


def stop_requested() -> Interrupted | None:
    """Return the exception of a stop signal, if any has arrived.  Local."""
    return _Requests.to_stop


def raise_stop() -> None:
    """Raise again the exception of a stop signal, if any has arrived.  Local.

    A library may have caught it as one of its errors, such as a failed import, and continued.
    """
    if _Requests.to_stop is not None and not _Requests.n_holding:
        raise _Requests.to_stop


@contextmanager
def parting_with(words: str) -> Iterator[None]:
    """Set the end of the message on a stop within the block.  Local."""
    _Requests.parting, before = words, _Requests.parting
    try:
        yield
    finally:
        _Requests.parting = before


def parting_words() -> str:
    """Return the end of the message on a stop: the place of the results.  Local."""
    return _Requests.parting


@contextmanager
def unbroken() -> Iterator[None]:
    """Complete the block before a signal to stop takes effect.  Local."""
    _Requests.n_holding += 1
    before = _Requests.to_stop
    try:
        yield
    finally:
        _Requests.n_holding -= 1
    if not _Requests.n_holding and _Requests.to_stop is not None and before is None:
        raise _Requests.to_stop


def is_unbroken() -> bool:
    """Return whether a block is at work that no signal breaks off.  Local, in any thread."""
    return _Requests.n_holding > 0


def _save(number: int, frame) -> None:
    _Requests.to_save = True


def _stop(number: int, frame) -> None:
    """Raise Interrupted wherever the program is; a second signal changes nothing about the way out of the first."""
    if _Requests.to_stop is not None or _Requests.is_over:
        return
    if _Requests.waits_for_first:
        _Requests.waits_for_first = False
        timer = threading.Timer(TO_FIRST, os.kill, (os.getpid(), number))
        timer.daemon = True
        with unsignalled():
            timer.start()
        return
    _Requests.to_stop = Interrupted(f"stopped by {signal.Signals(number).name}")
    Answer.begun.set()
    end_within(UNWINDING)
    _drop_unread_output()
    if not _Requests.n_holding:
        raise _Requests.to_stop


def _drop_unread_output() -> None:
    """Discard standard output and error if they are full: a stopping mpirun no longer reads them.

    A further line would be waited for until the launcher kills, with nothing saved.
    """
    for stream in (1, 2):
        with suppress(OSError, ValueError):  # closed, or beyond the descriptors of select
            if not select.select([], [stream], [], 0.0)[1]:
                drop_output(stream)


def drop_output(stream: int) -> None:
    """Discard all further output to a file descriptor.  Local."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
