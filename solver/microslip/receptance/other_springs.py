"""Reduced structures, models and enriched models with a changed contact stiffness."""

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
    """Return the same structure, or model, with changed springs; harmonic groups are updated on demand.  Local."""
    updates = structure.receptances.mapped(lambda receptance: SpringUpdate(structure.comm, receptance, change))
    return replace(structure, receptances=updates.mapped(lambda update: update.receptance), spring_updates=updates)


def enriched_with_springs(enriched: EnrichedModel, structure: ReducedStructure) -> EnrichedModel:
    """Return an enriched model with the springs of a ``structure`` from :func:`with_springs`.  Local.

    Access to the truncated modes raises ValueError if structural damping couples them to the joint.
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
    """Return the truncated modes with changed springs: exact samples, and W of loads and outputs updated by the samples.

    Collective: one gather.

    Raises
    ------
    ValueError : structural damping couples truncated modes to the joint, for which there is no update
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
