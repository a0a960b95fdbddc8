"""Statics: constant loads, harmonic 0 alone, the same response at every frequency (docs/theory.md, section 5)."""

from __future__ import annotations

from collections.abc import Iterator

from .branch import Point
from .follow import BranchFollower
from .point_solver import State


class StaticFollower(BranchFollower):
    """The one point of a level, at the frequency where the sweep starts; it stands for all of them."""

    def points(self) -> Iterator[tuple[State, Point]]:
        """Yield the point, from the linear response, or over the level where Newton does not reach it from there."""
        found, selected = self.first()
        if found.failure:
            found, selected = self.reach_first(found)
        yield self.accept(found, selected, asked=self.sweep.start in self.sweep.at)
