"""`adaptive`: Algorithm 1 of Yuan et al. (2020), with the pairs that did not stick in the last solution."""

from __future__ import annotations

from ...points.selection import NonStickingPairs
from ..facts import Facts
from ..internal_variable import reduce_to_pairs
from ..reduction import Reduction
from ..settings import ReductionSettings
from ..stuck import StuckStructure

FACTS = Facts()


def coordinates(settings: ReductionSettings, n_modes: int, n_dof: int, n_pairs: int, n_loads: int) -> int:
    """Return how many unknowns a harmonic coefficient has at most.  Local."""
    return n_modes + 3 * n_pairs


def selection(settings: ReductionSettings) -> NonStickingPairs:
    """Return the set B.  Local."""
    return NonStickingPairs(settings.in_point_check)


def reduce(stuck: StuckStructure, settings: ReductionSettings) -> Reduction:
    """Return the reduction.  Collective."""
    return reduce_to_pairs(stuck, settings, selection(settings))
