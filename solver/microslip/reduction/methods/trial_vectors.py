"""`trial-vectors`: derivatives of the modes by the stiffness of the joint (Witteveen and Pichler 2014).

docs/theory.md, eq. (8.6), which states our choice of the derivatives and of their weights.
"""

import numpy as np

from ...linear.joint_springs import joint_stiffness
from ...parallel.agree import on_root
from ...parallel.ownership import summed
from ..facts import Facts
from ..galerkin import DEPENDENT, reduce_on_basis
from ..reduction import Reduction
from ..settings import ReductionSettings
from ..stuck import StuckStructure, owned_product

FACTS = Facts(lambda settings, n: n.modes + min(settings.interface_modes, 3 * n.pairs) + n.loads, makes_basis=True)


def reduce(stuck: StuckStructure, settings: ReductionSettings) -> Reduction:
    """Return the reduction.  Collective: 3 solves per pair."""
    system, modes = stuck.system, stuck.modes
    X_owned = stuck.factor.solve(system.R.T.tocsc())
    flexibility = summed(system.comm, system.R[:, stuck.rows] @ X_owned)
    forces = derivative_forces(joint_stiffness(stuck.pairs), owned_product(system.R, modes.phi_owned, system), modes.omega_n)
    chosen = on_root(system.comm, main_directions, forces, flexibility, settings.interface_modes)
    V_owned = np.hstack([modes.phi_owned, stuck.factor.solve(system.loads), X_owned @ chosen])
    return reduce_on_basis(stuck, V_owned, settings)


def derivative_forces(K_J: np.ndarray, r: np.ndarray, omega_n: np.ndarray) -> np.ndarray:
    """Return the weighted forces (d K_J / d q_j) R phi_i of eq. (8.6), all i, j and c, (3 n_pairs, 3 n_phi^2).  Local."""
    n_phi = len(omega_n)
    weighted = (r / omega_n**2).reshape(-1, 3, n_phi)
    products = np.einsum("pdi,pcj->pdcij", weighted, weighted)
    return K_J[:, None] * products.reshape(len(K_J), 3 * n_phi**2)


def main_directions(forces: np.ndarray, flexibility: np.ndarray, n_wanted: int) -> np.ndarray:
    """Return the ``n_wanted`` main directions of ``forces``, (3 n_pairs, m), in terms of the strain energy f^T G f.  Local.

    With G = L L^T these are the left singular vectors of L^T F, mapped back by L^-T.  A structure without joints has none.
    """
    if not len(flexibility):
        return np.empty((0, 0))
    values, Q = np.linalg.eigh(0.5 * (flexibility + flexibility.T))
    is_independent = values > DEPENDENT * values[-1]
    root = Q[:, is_independent] * np.sqrt(values[is_independent])
    directions, _, _ = np.linalg.svd(root.T @ forces, full_matrices=False)
    return (Q[:, is_independent] / np.sqrt(values[is_independent])) @ directions[:, :n_wanted]
