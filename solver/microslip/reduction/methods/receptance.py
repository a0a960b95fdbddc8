"""`receptance`: no pair is ever dropped; pairs that stick cost nothing but their contact law."""

from __future__ import annotations

from ...points.selection import AllPairs
from ..facts import Facts
from ..settings import ReductionSettings

FACTS = Facts(lambda _, n: 3 * n.pairs)


def selection(settings: ReductionSettings) -> AllPairs:
    """Return the set B.  Local."""
    return AllPairs()
