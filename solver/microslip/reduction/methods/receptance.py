"""`receptance`: no pair is ever dropped; pairs that stick cost nothing but their contact law."""

from __future__ import annotations

from ...points.selection import AllPairs
from ..facts import Facts
from ..internal_variable import reduce_to_pairs
from ..reduction import Reduction
from ..settings import ReductionSettings
from ..stuck import StuckStructure

FACTS = Facts()


def coordinates(settings: ReductionSettings, n_modes: int, n_dof: int, n_pairs: int, n_loads: int) -> int:
    """Return how many unknowns a harmonic coefficient has at most.  Local."""
    return 3 * n_pairs


def selection(settings: ReductionSettings) -> AllPairs:
    """Return the set B.  Local."""
    return AllPairs()


def reduce(stuck: StuckStructure, settings: ReductionSettings) -> Reduction:
    """Return the reduction.  Collective."""
    return reduce_to_pairs(stuck, settings, selection(settings))
