"""Times of functions of the program, measured from outside: they are wrapped while a stopwatch runs."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from functools import wraps
from typing import Any


class Stopwatch:
    """Exclusive time and number of calls by group of functions; leaving the context restores the functions.

    Parameters
    ----------
    groups : (owner, name of its attribute, group) of each function; a function called from another one is counted only
        in its own group
    clock : processor time of this process by default, which others on the machine disturb least
    """

    def __init__(self, groups: list[tuple[Any, str, str]], clock: Callable[[], float] = time.process_time):
        self.clock, self._groups = clock, groups
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self._inner: list[float] = []  # time spent in wrapped functions called by each open one
        self._originals: list[tuple[Any, str, Any]] = []

    def __enter__(self) -> Stopwatch:
        for owner, name, group in self._groups:
            original = vars(owner)[name]
            self._originals.append((owner, name, original))
            setattr(owner, name, self._timed(original, group))
        return self

    def __exit__(self, *_) -> None:
        for owner, name, original in self._originals:
            setattr(owner, name, original)
        self._originals.clear()

    def _timed(self, function, group: str):
        @wraps(function)
        def timed(*args, **kwargs):
            self._inner.append(0.0)
            start = self.clock()
            try:
                return function(*args, **kwargs)
            finally:
                whole = self.clock() - start
                self.seconds[group] += whole - self._inner.pop()
                self.calls[group] += 1
                if self._inner:
                    self._inner[-1] += whole

        return timed

    def reset(self) -> None:
        """Set all times and counts to zero."""
        self.seconds.clear()
        self.calls.clear()
