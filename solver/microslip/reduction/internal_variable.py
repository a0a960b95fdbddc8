"""Modes of the stuck structure and its exact static residual: what `receptance`, `adaptive` and `adaptive-energy` share."""

from __future__ import annotations

from functools import partial

from .build import reduce_structure
from .expand import displacement
from .reduction import Reduction
from .selection import Selection


def reduce_to_pairs(linearised, modes, scene, selection: Selection) -> Reduction:
    """Return the reduction in the internal-variable form (docs/theory.md, section 4).

    Collective: static solves of loads and outputs now, those of a pair when it first leaves sticking.
    """
    model = reduce_structure(linearised, modes, scene)
    return Reduction(model, selection, partial(displacement, linearised, modes, model), leaves_out="modes")
