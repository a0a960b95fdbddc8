"""`adaptive-energy`: the same, with the pairs that lost energy in the last solution, or opened."""

from __future__ import annotations

from ...points.selection import DissipatingPairs
from ..facts import Facts
from ..internal_variable import reduce_to_pairs
from ..reduction import Reduction
from ..settings import ReductionSettings
from ..stuck import StuckStructure

FACTS = Facts()


def coordinates(settings: ReductionSettings, n_modes: int, n_dof: int, n_pairs: int, n_loads: int) -> int:
    """Return how many unknowns a harmonic coefficient has at most.  Local."""
    return n_modes + 3 * n_pairs


def selection(settings: ReductionSettings) -> DissipatingPairs:
    """Return the set B.  Local."""
    return DissipatingPairs(settings.in_point_check, settings.energy_tolerance)


def reduce(stuck: StuckStructure, settings: ReductionSettings) -> Reduction:
    """Return the reduction.  Collective."""
    return reduce_to_pairs(stuck, settings, selection(settings))
