"""The neighbours of a maximum of an output by its phase (docs/theory.md, section 7)."""

from __future__ import annotations

from dataclasses import dataclass

from .iterate import Iterate


@dataclass(frozen=True, eq=False)
class Beside:
    """Neighbours of a maximum, from which the search for the next one along the branch begins: saves iterations."""

    distance: float  # rad
    bend: float  # 1/rad2, of the amplitude over the phase: 1 for one mode
    sides: tuple[Iterate, Iterate]  # the solutions before and after, turned to the phase of the maximum, less it; U over its size
