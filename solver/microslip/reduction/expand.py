"""Full displacement fields from a converged point of the reduced model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..fourier.harmonics import Harmonics
from ..receptance.motions import modal_forces
from ..receptance.reduced_model import ReducedModel

if TYPE_CHECKING:
    from ..assembly.system import System
    from ..linear.joint_springs import Linearised
    from ..modes.eigen import Modes
    from ..points.branch import Branch
    from .reduction import Reduction


def displacement(
    linearised: Linearised, modes: Modes, model: ReducedModel, level: float, omega: float, p: np.ndarray
) -> np.ndarray:
    """Return the harmonics of u on this rank's rows, (n_owned, N_H) [m].

    Collective: one static solve with N_H right-hand sides.  u = K_L^-1 (f - R^T p) + phi c(omega) phi^T (f - R^T p), with
    p (3 n_pairs, N_H) [N] of the full set of harmonics 0 to H, whatever those of the model; docs/theory.md, section 4.
    """
    system, model = linearised.system, model.with_harmonics(Harmonics.full(p.shape[-1]))
    first, last = system.K.getOwnershipRange()
    force = system.loads.tocsr()[first:last] @ (level * model.f) - system.R.T.tocsr()[first:last] @ p
    (c,), (q,) = model.flexibilities(omega), modal_forces(model, level, p)
    return linearised.factor.solve(np.ascontiguousarray(force)) + modes.phi_owned @ c.apply(q)


def node_fields(system: System, owned: np.ndarray) -> np.ndarray | None:
    """Return fields per node, (n_nodes, 3, n_fields), in the order of Mesh.points, on rank 0 (None elsewhere).

    Collective: one gather.  ``owned`` (n_owned, n_fields) are this rank's rows; fixed DOFs are zero.
    """
    gathered = system.comm.gather(owned, root=0)
    if gathered is None:
        return None
    return system.at_nodes(np.concatenate(gathered))


def peak_displacement(system: System, reduction: Reduction, model: ReducedModel, branch: Branch) -> tuple[int, np.ndarray | None]:
    """Return the number of a branch's point of largest response and the harmonics of u there, (n_nodes, 3, N_H) [m], as recorded.

    Collective; the field on rank 0, None elsewhere and where the branch has no point.
    """
    if not branch.points:
        return -1, None
    at = branch.peak
    p = model.comm.bcast(branch.points[at].p)
    u = reduction.displacement(model, branch.level, branch.points[at].omega, p.reshape(-1, p.shape[-1]))
    return at, node_fields(system, u)
