"""`joint-interface-modes`: pairs of opposite forces at the joint, and few modes of what they cause.

From W. Witteveen and H. Irschik, *Efficient mode-based computational approach for jointed structures: joint interface modes*,
AIAA Journal 47 (2009): the classical modes of the structure are enriched by shapes of the joint that are computed once and for
all under Newton's third law, equal and opposite forces on the two surfaces, and reduced in number by an eigenproblem of their
own.  Here: the classical modes are those of the free bodies, the shapes their residual attachment modes Z of the relative DOFs,
both as in `rubin` with ``condensed = true``, and

    Z^T K Z v = lambda Z^T M Z v

keeps the ``[solver] interface_modes`` lowest v.  With all of them, 3 a pair, this is `rubin`, condensed.  That the residual
space takes the place of the statically condensed one, and the attachment modes of the loads, are our choice.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...linear.dense import gram, multiply
from ...parallel.agree import on_root
from ..free_interface import free_bodies, residual_attachment_modes
from ..galerkin import reduce_on_basis, reduced_modes
from ..reduction import Reduction


def reduce(linearised, modes, pairs, scene) -> Reduction:
    """Return the reduction.  Collective: a factorisation, modes, and 3 solves a pair.

    Raises
    ------
    CaseError : fewer modes asked for than rigid-body modes; on every rank
    """
    system = linearised.system
    free = free_bodies(linearised, modes, scene)
    Z_owned = residual_attachment_modes(free, sp.hstack([system.R.T, system.loads], format="csc"))
    T_owned = np.hstack([free.phi_owned, Z_owned[:, system.R.shape[0]:],
                         interface_modes(system, Z_owned[:, : system.R.shape[0]], scene.solver.interface_modes)])
    free.destroy()
    return reduce_on_basis(linearised, T_owned, scene)


def interface_modes(system, Z_owned: np.ndarray, n_wanted: int) -> np.ndarray:
    """Return the ``n_wanted`` lowest modes of (K, M) in the span of Z, or all there are; this rank's rows.  Collective."""
    K_r, M_r = (gram(system.comm, Z_owned, multiply(A, Z_owned)) for A in (system.K, system.M))
    _, v = on_root(system.comm, reduced_modes, K_r, M_r)
    return Z_owned @ v[:, :n_wanted]
