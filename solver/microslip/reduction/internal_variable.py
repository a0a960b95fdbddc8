"""Modes of the stuck structure and its exact static residual: what `receptance`, `adaptive` and `adaptive-energy` share."""

from __future__ import annotations

from functools import partial

from ..points.selection import Selection
from .expand import displacement
from .modal_structure import reduce_structure
from .reduction import Reduction
from .settings import ReductionSettings
from .stuck import StuckStructure


def reduce_to_pairs(stuck: StuckStructure, settings: ReductionSettings, selection: Selection) -> Reduction:
    """Return the reduction in the internal-variable form (docs/theory.md, section 4).

    Collective: static solves of a pair when it first leaves sticking.
    """
    structure = reduce_structure(stuck, settings.damping)
    return Reduction(structure, selection, partial(displacement, stuck.linearised, stuck.modes), leaves_out="modes")
