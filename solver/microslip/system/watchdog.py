"""The watchdog of a program that may hang: it first writes the stacks, then ends the process, on each rank separately.

A rank that waits for another may be in a library that holds Python's lock, where no thread of Python runs and no signal is
answered in Python.  So a timer of the system sends SIGALRM, and faulthandler answers it at once with the stacks; later its own
thread writes them again and ends the process, and with it the launcher the others.  A rank reports progress by :func:`moved`.
"""

import faulthandler
import math
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

VARIABLE = "MICROSLIP_WATCHDOG"  # of the environment: seconds; 0: no watch
USUAL = 4.0 * 3600.0  # s without a sign until the end
LONGEST = 1e6  # s
TO_STACKS = 0.25  # share of that after which the stacks are written
PATIENCE = 12.0  # times as long during a single call that gives no sign while it works: the factor of a large model, on disk


class _Watch:
    """The state of the watchdog of this process."""

    limit = 0.0  # s; 0: there is none
    patience = 1.0  # times the limit: what holds now
    moved_at = -math.inf  # s, when the timers were last set


def watch() -> None:
    """Start the watchdog, in a process of the program itself.  Local."""
    if sys.stderr is None:  # closed by the caller: there is no place for stacks
        return
    _Watch.limit = _stated() if wrong_limit() is None else USUAL
    if _Watch.limit:
        faulthandler.register(signal.SIGALRM)
        _set()


def wrong_limit() -> str | None:
    """Return what is wrong with the time that the environment states, if anything.  Local."""
    if 0.0 <= _stated() < LONGEST:
        return None
    text = os.environ[VARIABLE][:40]
    return f"{VARIABLE}={text}: a number of seconds is expected, after which a run without progress is ended; 0: never"


def _stated() -> float:
    """Return the seconds that the environment states, or the usual ones; nan: it is no number."""
    try:
        return float(os.environ.get(VARIABLE) or USUAL)
    except ValueError:
        return math.nan


def show_stacks() -> None:
    """Write the stacks of all threads to standard error after a crash, and on SIGUSR2.  Local.

    Called after PETSc's start: its crash handler, which ends all ranks, then follows the stacks.
    """
    if not faulthandler.is_enabled() and sys.stderr is not None:
        with suppress(OSError, AttributeError):  # of a notebook, which has no file there
            faulthandler.enable()
            faulthandler.register(signal.SIGUSR2)


def moved() -> None:
    """Notify the watchdog that this rank makes progress.  Local; frequent calls cost almost nothing."""
    if _Watch.limit and time.monotonic() - _Watch.moved_at > 0.01 * _Watch.limit:
        _set()


@contextmanager
def unwatched() -> Iterator[None]:
    """Suspend the watchdog while other, watched ranks work.  Local."""
    limit, _Watch.limit = _Watch.limit, 0.0
    if limit:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        faulthandler.cancel_dump_traceback_later()
    try:
        yield
    finally:
        _Watch.limit = limit
        if limit:
            _set()


@contextmanager
def patient() -> Iterator[None]:
    """Wait ``PATIENCE`` times as long, for a call of a library that gives no sign while it works.  Local.

    Not without end: ranks may wait for each other in there, too.
    """
    before, _Watch.patience = _Watch.patience, PATIENCE
    _set()
    try:
        yield
    finally:
        _Watch.patience = before
    _set()  # after an error whoever ends the run has set its time already


def end_within(seconds: float) -> None:
    """Let the process, if it is watched, last that long at most.  Local."""
    if _Watch.limit:
        faulthandler.dump_traceback_later(seconds, exit=True)


def _set() -> None:
    """Set both timers, from now."""
    _Watch.moved_at = time.monotonic()
    if _Watch.limit:
        limit = _Watch.patience * _Watch.limit
        signal.setitimer(signal.ITIMER_REAL, TO_STACKS * limit)
        end_within(limit)
