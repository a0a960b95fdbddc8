"""The reduction methods, one registry: what the scene's ``method`` names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .selection import AllPairs, DissipatingPairs, NonStickingPairs, Selection

METHODS: dict[str, Callable[[Any], Selection]] = {
    "receptance": lambda solver: AllPairs(),
    "adaptive": lambda solver: NonStickingPairs(solver.in_point_check),
    "adaptive-energy": lambda solver: DissipatingPairs(solver.in_point_check, solver.energy_tolerance),
}


def selection_of(solver) -> Selection:
    """Return what the scene's [solver] asks for.  Local."""
    return METHODS[solver.method](solver)
