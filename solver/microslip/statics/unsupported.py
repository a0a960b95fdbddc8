"""Check of constant loads on a structure with free rigid-body motions: the loads must be in balance along them."""

from __future__ import annotations

import numpy as np

from ..assembly.spin import stated_statics
from ..assembly.system import System
from ..messages.errors import CaseError
from ..messages.words import place
from ..parallel.ownership import summed
from ..tables.structure_tables import StructureTables

_BALANCED = 1e-6  # of the sum of all forces and of their moments: smaller imbalances are rounding


def check_unsupported(system: System, settings: StructureTables, forces_owned: np.ndarray, where: str) -> None:
    """Raise CaseError on every rank for constant loads that are not in balance along free rigid-body motions.

    Collective: one sum.  ``forces_owned`` (n_dof_owned,) [N].
    """
    motions, statics = system.rigid_owned, stated_statics(settings)
    if motions is None or motions.shape[1] == 0 or statics is None:
        return
    start = f"{where}{': ' if where else ''}[statics]"
    for key, is_stated in (
        ("rotation_speed", statics.rotation_speed > 0.0),
        ("large_displacements = true", statics.large_displacements),
    ):
        if is_stated:
            lacks = "has none" if motions.shape[1] == 6 else "can still move as a rigid body"
            raise CaseError(f"{start} {key} needs [[supports]]: the structure {lacks}, and nothing holds its axis or its turn")
    resultant, size = summed(system.comm, np.stack([motions.T @ forces_owned, np.abs(motions).T @ np.abs(forces_owned)]))
    if motions.shape[1] < 6 and (np.abs(resultant) > _BALANCED * size).any():
        raise CaseError(
            f"{start}: constant loads must be in balance along the rigid-body motions that [[supports]] leave free, and push the "
            "structure along one of them; add [[supports]] that hold it, or what balances it"
        )
    if (np.abs(resultant) > _BALANCED * size).any():
        force, moment = np.where(np.abs(resultant) > _BALANCED * size, resultant, 0.0).reshape(2, 3)
        raise CaseError(
            f"{start}: constant loads on a structure without supports must be in balance: a force of {place(force)} N and a "
            f"moment of {place(moment)} N m about the middle of its nodes are left over; add [[supports]], or what balances it"
        )
