"""Who tells the log and the result files what a run has found, and when: levels in turn, or several at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..continuation.branch import Branch, Point
from ..continuation.sweep import Sweep
from ..results.writer import ResultWriter
from .log import RunLog


class Reporter:
    """Levels that come one after the other, from all ranks.  Collective but for ``level_started``."""

    def __init__(self, log: RunLog, writer: ResultWriter, sweep: Sweep, levels: Sequence[float], is_static: bool = False):
        self.log, self.writer, self.sweep, self.levels, self.is_static = log, writer, sweep, levels, is_static

    def level_started(self, number: int, level: float) -> None:
        self.count = 0
        self.level = level
        self.log.level_started(level, self.sweep.start, self.sweep.stop, number, len(self.levels), is_static=self.is_static)
        self.writer.level_started(level)

    def point(self, point: Point) -> None:
        self.log.point(self.level, self.count, point)
        self.writer.point(self.count, point)
        self.count += 1

    def level_finished(self, branch: Branch) -> None:
        self.log.level_finished(branch.level, branch)
        self.writer.level_finished(branch)


class Minutes:
    """Levels of several groups of ranks, their points mixed, as rank 0 hears of them.  Local, on rank 0.

    ``branches`` has one for each level, in the order of ``levels``, with the points heard of so far.
    """

    def __init__(self, log: RunLog, writer: ResultWriter, sweep: Sweep, levels: Sequence[float], is_static: bool = False):
        self.log, self.writer, self.sweep, self.is_static = log, writer, sweep, is_static
        self.branches = [Branch(level) for level in levels]

    def level_started(self, number: int, where: str) -> None:
        level = self.branches[number].level
        self.log.level_started(level, self.sweep.start, self.sweep.stop, number, len(self.branches), where, self.is_static)

    def point(self, number: int, point: Point) -> None:
        branch = self.branches[number]
        self.log.point(branch.level, len(branch.points), point)
        self.writer.add_point(branch.level, len(branch.points), point)
        branch.points.append(point)

    def level_finished(self, number: int, found: Branch) -> None:
        """Take in how a level ended; its points have been heard of."""
        branch = self.branches[number] = replace(found, points=self.branches[number].points)
        self.log.level_finished(branch.level, branch)
        self.writer.add_level(number, branch)
