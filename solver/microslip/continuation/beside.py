"""What lies beside a maximum of an output by its phase (docs/theory.md, section 7)."""

from __future__ import annotations

from dataclasses import dataclass

from .iterate import Iterate


@dataclass(frozen=True, eq=False)
class Beside:
    """What lay beside a maximum: there the next one along a branch is looked for first, which saves iterations."""

    distance: float  # rad
    bend: float  # 1/rad2, of the amplitude over the phase: 1 for one mode
    sides: tuple[Iterate, Iterate]  # the solutions before and after, turned to the phase of the maximum, less it; U over its size
