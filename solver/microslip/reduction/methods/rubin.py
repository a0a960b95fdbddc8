"""`rubin`: free-interface modes of the bodies and residual attachment modes (Rubin 1975), coupled by the joint.

docs/theory.md, section 8: V = [phi, Z].
"""

import numpy as np
import scipy.sparse as sp

from ..facts import Facts
from ..free_interface import check_rigid, free_bodies, residual_attachment_modes
from ..galerkin import reduce_on_basis
from ..interface_dofs import interface_dofs, unit_columns
from ..reduction import Reduction
from ..settings import ReductionSettings
from ..stuck import StuckStructure

FACTS = Facts(lambda settings, n: n.modes + (3 if settings.condensed else 6) * n.pairs + n.loads, makes_basis=True)


def check_modes(stuck: StuckStructure, settings: ReductionSettings) -> None:
    """Refuse too few modes.  Collective."""
    check_rigid(stuck, settings)


def reduce(stuck: StuckStructure, settings: ReductionSettings) -> Reduction:
    """Return the reduction.  Collective: a factorisation, modes, and as many solves as forces.

    Raises
    ------
    CaseError : fewer modes requested than rigid-body modes; on every rank
    """
    system = stuck.system
    free = free_bodies(stuck, settings)
    contact = system.R.T if settings.condensed else unit_columns(interface_dofs(system.R), system.n_dof)
    Z_owned = residual_attachment_modes(free, sp.hstack([contact, system.loads], format="csc"))
    V_owned = np.hstack([free.phi_owned, Z_owned])
    free.destroy()
    return reduce_on_basis(stuck, V_owned, settings)
