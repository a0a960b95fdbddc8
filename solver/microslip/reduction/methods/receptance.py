"""`receptance`: no pair is ever dropped; pairs that stick cost nothing but their contact law."""

from __future__ import annotations

from ..internal_variable import reduce_to_pairs
from ..reduction import Reduction
from ..selection import AllPairs


def reduce(linearised, modes, pairs, scene) -> Reduction:
    """Return the reduction.  Collective."""
    return reduce_to_pairs(linearised, modes, scene, AllPairs())
