"""`adaptive`: Algorithm 1 of Yuan et al. (2020), with the pairs that did not stick in the last solution."""

from ...points.selection import NonStickingPairs
from ..facts import Facts
from ..settings import ReductionSettings

FACTS = Facts(lambda _, n: n.modes + 3 * n.pairs)


def selection(settings: ReductionSettings) -> NonStickingPairs:
    """Return the set B.  Local."""
    return NonStickingPairs(settings.in_point_check)
