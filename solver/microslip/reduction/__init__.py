"""The reduction methods, one registry: what the scene's ``method`` names."""

from __future__ import annotations

from .selection import AllPairs, DissipatingPairs, NonStickingPairs, Selection

METHODS = {
    "receptance": lambda solver: AllPairs(),
    "adaptive": lambda solver: NonStickingPairs(solver.in_point_check),
    "adaptive-energy": lambda solver: DissipatingPairs(solver.in_point_check, solver.energy_tolerance),
}


def selection_of(solver) -> Selection:
    """Return what the scene's [solver] asks for.  Local."""
    return METHODS[solver.method](solver)
