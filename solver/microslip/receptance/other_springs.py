"""Reduced structures, models and enriched models with other contact stiffness than they were built with."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from .per_group import PerGroup
from .reduced_structure import ReducedStructure
from .springs import SpringChange, SpringUpdate
from .truncated_modes import EnrichedModel, TruncatedModes, of_samples

Reduced = TypeVar("Reduced", bound=ReducedStructure)


def with_springs(structure: Reduced, change: SpringChange) -> Reduced:
    """Return the same structure, or model, with other springs; each group of harmonics when it is needed.  Local."""
    updates = structure.receptances.mapped(lambda receptance: SpringUpdate(structure.comm, receptance, change))
    return replace(structure, receptances=updates.mapped(lambda update: update.receptance), spring_updates=updates)


def enriched_with_springs(enriched: EnrichedModel, structure: ReducedStructure) -> EnrichedModel:
    """Return an enriched model with the springs of a structure by :func:`with_springs`.  Local.

    Samples of truncated modes raise ValueError, where they are needed, if structural damping couples these to the joint.
    """
    updates = structure.spring_updates
    if updates is None:
        return enriched
    if not enriched.is_solved:
        structure = with_springs(enriched.structure, updates.of(1).change)
        updates = structure.spring_updates
        assert updates is not None, "just made"
    before, of = enriched.truncated, updates
    truncated = PerGroup(lambda group: _truncated(of.of_group(group), before.of_group(group)), before.group_of, before.groups)
    return EnrichedModel(structure, truncated, enriched.is_solved)


def _truncated(update: SpringUpdate, before: TruncatedModes | None) -> TruncatedModes | None:
    """Return the truncated modes with other springs: their samples exactly, W of loads and outputs as these change it.

    Collective: one gather.

    Raises
    ------
    ValueError : structural damping couples truncated modes to the joint, which the samples do not know of other springs
    """
    if before is None:
        return None
    if before.coupling is not None:
        raise ValueError("structural damping couples the truncated modes to the joint: build the structure again")
    v = before.of_pairs
    outputs, loads = update.of_outputs(before.of_outputs, v), update.of_loads(before.of_loads, v)
    direct = before.direct + outputs @ loads.conj().T - before.of_outputs @ before.of_loads.conj().T
    drive_point = before.drive_point + (np.abs(loads) ** 2 - np.abs(before.of_loads) ** 2).sum(axis=1)
    rows = np.concatenate([update.of_pairs(v), outputs, loads])
    return of_samples(update.receptance, rows, direct, np.maximum(drive_point, 0.0), before.damping, None)
