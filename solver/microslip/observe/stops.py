"""What comes from outside while levels are followed: a signal that asks to save, and the end of the time that a run has."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..messages.errors import Interrupted, MicroslipError
from ..points.branch import Branch, Point
from ..system.signals import parting_with, raise_stop, save_requested
from ..system.walltime import TimeLimit
from .log import RunLog

LEAST_MARGIN = 5.0  # s before the end, for what is not measured
POINTS_AHEAD, SAVES_AHEAD = 2.0, 3.0  # times the slowest point and the slowest save so far


class Stops:
    """An :class:`~microslip.observe.observer.Observer` that saves when SIGUSR1 asks for it, and stops before the time is up.

    What it raises is raised on all ranks, as of any observer: they agree, whenever the time ends by their own clocks.

    Parameters
    ----------
    save : writes what the levels at work have so far
    limit : of this run; None: nothing limits it
    """

    def __init__(self, log: RunLog, save: Callable[[], None], limit: TimeLimit | None = None):
        self._log, self._save, self._limit = log, save, limit
        self._slowest_point = self._slowest_save = 0.0  # s
        self._has_stopped = False
        if limit is not None:
            remaining = max(limit.remaining, 0.0)
            log.note(f"{remaining:.0f} s are left by {limit.source}; what is not done shortly before is left to the next run")

    @property
    def margin(self) -> float:
        """The time [s] before the end at which no further point is begun."""
        return LEAST_MARGIN + POINTS_AHEAD * self._slowest_point + SAVES_AHEAD * self._slowest_save

    def level_started(self, number: int, level: float, where: str) -> None:
        """Look whether there is time for a level."""
        self._look()

    def point(self, number: int, i: int, point: Point) -> None:
        """Look whether something is asked for, and whether there is time for another point."""
        self._slowest_point = max(self._slowest_point, point.seconds)
        self._look()

    def level_finished(self, number: int, branch: Branch) -> None:
        """Take note of a level at its end, which has been saved."""

    @contextmanager
    def in_force(self) -> Iterator[None]:
        """Save on the way out of what a signal interrupts.  Local: other ranks may be anywhere."""
        try:
            yield
        except Interrupted:
            if not self._has_stopped:
                with suppress(MicroslipError):
                    self._save()
            raise

    def _look(self) -> None:
        """Raise Interrupted when the time is nearly up, with everything saved, or a signal has been swallowed."""
        raise_stop()
        if save_requested():
            self._save_in_time()
            self._log.note("saved by SIGUSR1: results.h5 has every point until now")
        if self._limit is not None and self._limit.remaining < self.margin:
            self._save_in_time()
            self._has_stopped = True
            remaining = self._limit.remaining
            when = f"{remaining:.0f} s before" if remaining >= 0.0 else f"{-remaining:.0f} s after"
            raise Interrupted(f"stopped {when} the end of {self._limit.source}")

    def _save_in_time(self) -> None:
        """Save, and learn how long that takes."""
        began = time.monotonic()
        self._save()
        self._slowest_save = max(self._slowest_save, time.monotonic() - began)


@contextmanager
def goes_on(folder: Path) -> Iterator[None]:
    """Say of an interruption where the results are, and how they are completed.  Local."""
    words = f"; what was computed until then is in {folder}, and the same command continues from there"
    with parting_with(words):
        try:
            yield
        except Interrupted as problem:
            problem.args = (f"{problem}{words}",)
            raise
