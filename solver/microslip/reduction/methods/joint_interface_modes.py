"""`joint-interface-modes`: responses to opposite forces at the joint, reduced to a few modes (Witteveen and Irschik 2009).

docs/theory.md, eq. (8.5), which states our choice of the classical modes; the static shapes of the loads are in the basis.
"""

import numpy as np

from ...linear.dense import gram, multiply
from ...parallel.agree import on_root
from ..facts import Facts
from ..galerkin import reduce_on_basis, reduced_modes
from ..reduction import Reduction
from ..settings import ReductionSettings
from ..stuck import StuckStructure

FACTS = Facts(lambda settings, n: n.modes + min(settings.interface_modes, 3 * n.pairs) + n.loads, makes_basis=True)


def reduce(stuck: StuckStructure, settings: ReductionSettings) -> Reduction:
    """Return the reduction.  Collective: 3 solves per pair."""
    system, phi_owned = stuck.system, stuck.modes.phi_owned
    Z_owned = stuck.factor.solve(system.R.T.tocsc())
    Z_owned -= phi_owned @ gram(system.comm, phi_owned, multiply(stuck.M, Z_owned))
    shapes_owned = lowest_shapes(stuck, Z_owned, settings.interface_modes)
    return reduce_on_basis(stuck, np.hstack([phi_owned, stuck.factor.solve(system.loads), shapes_owned]), settings)


def lowest_shapes(stuck: StuckStructure, Z_owned: np.ndarray, n_wanted: int) -> np.ndarray:
    """Return the ``n_wanted`` lowest modes in the span of Z, eq. (8.5), or all if fewer; this rank's rows.  Collective."""
    comm = stuck.comm
    K_r, M_r = (gram(comm, Z_owned, multiply(A, Z_owned)) for A in (stuck.K_L, stuck.M))
    _, v, _ = on_root(comm, reduced_modes, K_r, M_r)
    return Z_owned @ v[:, :n_wanted]
