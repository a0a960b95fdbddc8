"""`adaptive-energy`: as `adaptive`, with the pairs that dissipated energy or opened in the last solution."""

from ...points.selection import DissipatingPairs
from ..facts import Facts
from ..settings import ReductionSettings

FACTS = Facts(lambda _, n: n.modes + 3 * n.pairs)


def selection(settings: ReductionSettings) -> DissipatingPairs:
    """Return the set B.  Local."""
    return DissipatingPairs(settings.in_point_check, settings.energy_tolerance)
