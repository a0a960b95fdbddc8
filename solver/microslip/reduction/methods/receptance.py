"""`receptance`: all pairs are included; a sticking pair costs only the evaluation of its contact law."""

from ...points.selection import AllPairs
from ..facts import Facts
from ..settings import ReductionSettings

FACTS = Facts(lambda _, n: 3 * n.pairs)


def selection(settings: ReductionSettings) -> AllPairs:
    """Return the set B.  Local."""
    return AllPairs()
