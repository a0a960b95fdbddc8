"""External events while levels are followed: a signal that requests a save, and the time limit of a run."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..messages.errors import Interrupted, MicroslipError
from ..points.branch import Branch, Point
from ..system.signals import parting_with, raise_stop, save_requested
from ..system.walltime import TimeLimit
from .log import RunLog

LEAST_MARGIN = 5.0  # s before the time limit, for unmeasured work
POINTS_AHEAD, SAVES_AHEAD = 2.0, 3.0  # times the slowest point and the slowest save so far


class Stops:
    """An :class:`~microslip.observe.observer.Observer` that saves on SIGUSR1 and stops before the time limit.

    As for any observer, its exceptions are raised on all ranks: all ranks stop together, independent of their clocks.

    Parameters
    ----------
    save : writes the points of unfinished levels
    limit : time limit of this run; None: no limit
    saved : description of the saved data, for the log
    """

    def __init__(
        self,
        log: RunLog,
        save: Callable[[], None],
        limit: TimeLimit | None = None,
        saved: str = "results.h5 has every point until now",
    ):
        self._log, self._save, self._limit, self._saved = log, save, limit, saved
        self._slowest_point = self._slowest_save = 0.0  # s
        self._has_stopped = False
        if limit is not None:
            remaining = max(limit.remaining, 0.0)
            log.note(f"{remaining:.0f} s are left by {limit.source}; the run stops shortly before and can be continued")

    @property
    def margin(self) -> float:
        """The time [s] before the limit from which no further point is begun."""
        return LEAST_MARGIN + POINTS_AHEAD * self._slowest_point + SAVES_AHEAD * self._slowest_save

    def level_started(self, number: int, level: float, where: str) -> None:
        """Stop if a signal has arrived, or if too little time is left for a level."""
        self._check()

    def point(self, number: int, i: int, point: Point) -> None:
        """Save if a signal requests it; stop after a stop signal, or if too little time is left for another point."""
        self._slowest_point = max(self._slowest_point, point.seconds)
        self._check()

    def level_finished(self, number: int, branch: Branch) -> None:
        """Record the end of a level, which has been saved."""

    @contextmanager
    def saving_if_interrupted(self) -> Iterator[None]:
        """Save if a signal interrupts the block.  Local: other ranks may be in any state."""
        try:
            yield
        except Interrupted:
            if not self._has_stopped:
                with suppress(MicroslipError):
                    self._save()
            raise

    def _check(self) -> None:
        """Raise Interrupted near the time limit, after saving, or after a signal that a library has suppressed."""
        raise_stop()
        if save_requested():
            self._save_in_time()
            self._log.note(f"saved by SIGUSR1: {self._saved}")
        if self._limit is not None and self._limit.remaining < self.margin:
            self._save_in_time()
            self._has_stopped = True
            remaining = self._limit.remaining
            when = f"{remaining:.0f} s before" if remaining >= 0.0 else f"{-remaining:.0f} s after"
            raise Interrupted(f"stopped {when} the end of {self._limit.source}")

    def _save_in_time(self) -> None:
        """Save, and measure the time of saving."""
        began = time.monotonic()
        self._save()
        self._slowest_save = max(self._slowest_save, time.monotonic() - began)


@contextmanager
def explaining_continuation(folder: Path) -> Iterator[None]:
    """Add to the message of an interruption the folder of the results and how to continue.  Local."""
    with _ending_with(f"; what was computed until then is in {folder}, and the same command continues from there"):
        yield


@contextmanager
def explaining_new_start(command: str) -> Iterator[None]:
    """Add to the message of an interruption that a command without checkpoints starts from the beginning.  Local."""
    with _ending_with(f"; {command} stores no intermediate results, and the same command starts from the beginning"):
        yield


@contextmanager
def _ending_with(words: str) -> Iterator[None]:
    """Add words to the message of an interruption.  Local."""
    with parting_with(words):
        try:
            yield
        except Interrupted as problem:
            problem.args = (f"{problem}{words}",)
            raise
