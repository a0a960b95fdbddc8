"""Full displacement fields from a converged point of the reduced model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..fourier.harmonics import Harmonics
from ..receptance.motions import ActingForces
from ..receptance.reduced_model import ReducedModel

if TYPE_CHECKING:
    from ..assembly.system import System
    from ..points.branch import Branch
    from .reduction import Reduction
    from .stuck import StuckStructure


def displacements(stuck: StuckStructure, model: ReducedModel, points: Sequence[ActingForces]) -> list[np.ndarray]:
    """Return the harmonics of u on this rank's rows at some points, (n_owned, N_H) each [m].

    Collective: static solves with N_H right-hand sides a point, all at once.  u = K_L^-1 (f - R^H p) + phi c(omega) phi^H
    (f - R^H p); docs/theory.md, section 4.  The harmonics of the points may be others than the model's.
    """
    system, forces, dynamic = stuck.system, [], []
    loads, R_T = system.loads.tocsr()[stuck.rows], system.R.T.tocsr()[stuck.rows]
    for level, omega, p in points:
        full = model.with_harmonics(Harmonics.full(p.shape[-1]))
        forces.append(loads @ (level * full.f) - R_T @ p)
        (c,), (group,) = full.flexibilities(omega), full.groups
        dynamic.append(stuck.modes.phi_owned @ c.apply(group.receptance.modal_forces(level * full.f, p)))
    static = stuck.solve(np.hstack(forces)) if forces else np.empty((loads.shape[0], 0))
    ends = np.cumsum([force.shape[1] for force in forces])[:-1]
    return [own + more for own, more in zip(np.split(static, ends, axis=1), dynamic)]


def node_fields(system: System, owned: np.ndarray) -> np.ndarray | None:
    """Return fields per node, (n_nodes, 3, n_fields), in the order of Mesh.points, on rank 0 (None elsewhere).

    Collective: one gather.  ``owned`` (n_owned, n_fields) are this rank's rows; fixed DOFs are zero.
    """
    gathered = system.comm.gather(owned, root=0)
    if gathered is None:
        return None
    return system.at_nodes(np.concatenate(gathered))


def peak_displacements(
    system: System, reduction: Reduction, model: ReducedModel, branches: Sequence[Branch]
) -> list[tuple[int, np.ndarray]]:
    """Return the number of each branch's point of largest response and the harmonics of u there, (n_nodes, 3, N_H) [m].

    Collective: all at once; fields as recorded on rank 0, empty elsewhere.  Branches have points.
    """
    peaks = [branch.peak for branch in branches]
    at = [(branch, branch.points[peak]) for branch, peak in zip(branches, peaks)]
    points = [ActingForces(branch.level, point.omega, _whole(model.comm.bcast(point.p))) for branch, point in at]
    fields = (node_fields(system, u_owned) for u_owned in reduction.displacements(model, points))
    return [(peak, np.empty((0, 3, 0)) if u is None else u) for peak, u in zip(peaks, fields)]


def _whole(p: np.ndarray) -> np.ndarray:
    """Return recorded forces of pairs, (n_pairs, 3, N_H), as (3 n_pairs, N_H).  Local."""
    return p.reshape(-1, p.shape[-1])
