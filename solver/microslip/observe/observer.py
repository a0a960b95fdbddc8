"""Observers of levels and points, such as the log and the result files; observers change no result."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, Protocol

from ..parallel.agree import on_root
from ..points.branch import Branch, Point

if TYPE_CHECKING:
    from mpi4py import MPI


class Observer(Protocol):
    """Receives events of levels and points, on rank 0.  Its methods are local.

    Levels have numbers, from 0 in the order of the scene, because points of several levels may alternate: ``where`` then names
    the ranks of a level, and is empty otherwise.
    """

    def level_started(self, number: int, level: float, where: str) -> None:
        """Handle the begin of a level [N]."""

    def point(self, number: int, i: int, point: Point) -> None:
        """Handle the ``i``-th converged point of a level, from 0."""

    def level_finished(self, number: int, branch: Branch) -> None:
        """Handle the end of a level with all its points."""


class Observers:
    """All observers of the levels of a run.  ``branches`` has one branch per level [N], with the points so far.

    Its methods are local, on rank 0, except ``notify``.  Without ``keeps_motion`` the motion of all points but the one of largest
    response is dropped when a level has ended and all observers are notified: it takes most of the memory of a run.
    """

    def __init__(self, comm: MPI.Comm, levels: Sequence[float], observers: Iterable[Observer] = (), keeps_motion: bool = True):
        self.comm, self.observers, self.keeps_motion = comm, tuple(observers), keeps_motion
        self.branches = [Branch(level) for level in levels]

    def notify(self, event: str, *arguments: Any) -> None:
        """Call the method of this name on rank 0.  Collective on ``comm``: an error of an observer is raised on every rank."""
        on_root(self.comm, self.receive, event, *arguments, share=False)

    def receive(self, event: str, *arguments: Any) -> None:
        """Pass an event on by its name."""
        getattr(self, event)(*arguments)

    def level_started(self, number: int, where: str = "") -> None:
        """Pass on that a level has started."""
        for observer in self.observers:
            observer.level_started(number, self.branches[number].level, where)

    def point(self, number: int, point: Point) -> None:
        """Add a point to the branch of its level, and pass it on."""
        points = self.branches[number].points
        for observer in self.observers:
            observer.point(number, len(points), point)
        points.append(point)

    def level_finished(self, number: int, finished: Branch) -> None:
        """Record the end of a level, after its points."""
        branch = self.branches[number] = replace(finished, points=self.branches[number].points)
        for observer in self.observers:
            observer.level_finished(number, branch)
        if not self.keeps_motion:
            light = branch.without_motion()
            is_same = all(a is b for a, b in zip_longest(branch.points, finished.points))
            finished.points[:] = light if is_same else finished.without_motion()  # the same objects for the same points
            branch.points[:] = light
