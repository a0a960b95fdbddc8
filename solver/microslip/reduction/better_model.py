"""The better model that error bars compare with: the stuck structure's receptance, and samples of the modes left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..linear.dense import diagonal_owned, gram, multiply
from ..linear.joint_springs import Linearised
from ..linear.random_signs import random_signs
from ..modes.eigen import Modes
from ..parallel.ownership import summed
from ..receptance.modes_left_out import KEY, LAST, SAMPLES, BetterModel, ModesLeftOut, of_samples
from ..receptance.reduced_structure import ReducedStructure
from ..receptance.structural_coupling import StructuralCoupling
from .modal_structure import damping_beyond, owned_product, reduce_structure
from .reduction import Reduction
from .settings import ModalDamping, ReductionSettings
from .stuck import StuckStructure


def better_model_of(stuck: StuckStructure, reduction: Reduction, settings: ReductionSettings) -> BetterModel:
    """Return the better model of a reduction.

    Collective on the system's communicator: the static solves of ``modes_left_out``.
    """
    if reduction.leaves_out == "nothing":
        return BetterModel(reduction.structure, None, True)
    is_solved = reduction.leaves_out == "modes"
    structure = reduction.structure if is_solved else reduce_structure(stuck, settings.damping)
    key = "modes left out", stuck.modes, settings.damping
    left_out = stuck.once(key, lambda: sample_modes_left_out(stuck.linearised, stuck.modes, structure, settings.damping))
    return BetterModel(structure, left_out, is_solved)


def sample_modes_left_out(
    linearised: Linearised, modes: Modes, structure: ReducedStructure, damping: ModalDamping | None = None
) -> ModesLeftOut | None:
    """Return the samples for the modes beyond ``modes``; None where there are none.

    Collective on the system's communicator: ``SAMPLES`` static solves, with structural damping as many more as modes.
    docs/theory.md, eq. (11.3).
    """
    system, n_rows, n_out = linearised.system, linearised.system.R.shape[0], linearised.system.outputs.shape[0]
    if len(modes.omega_n) == 0 or len(modes.omega_n) == system.n_dof:
        return None
    comm, mass = system.comm, np.maximum(diagonal_owned(linearised.M), 0.0)
    first, last = linearised.K_L.getOwnershipRange()
    # the diagonal of M, scaled to have the kinetic energy of the highest modes kept
    energies = summed(comm, mass @ modes.phi_owned[:, -LAST:] ** 2)
    random = np.sqrt(mass / energies.mean())[:, None] * random_signs(first, last - first, SAMPLES, KEY)
    given = sp.hstack([system.loads, system.outputs.T], format="csr")[first:last].toarray()
    Z_random, Z_given = np.split(beyond_modes(linearised, modes, np.hstack([random, given])), [SAMPLES], axis=1)
    everything = sp.vstack([system.R, system.outputs, system.loads.T], format="csr")
    rows = owned_product(everything, Z_random, system) / np.sqrt(SAMPLES)
    W = gram(comm, Z_given, multiply(linearised.M, Z_given))
    beyond = damping_beyond(damping, structure.one_family)
    if system.C is not None:  # what it is of the motions that the samples are
        C, M = (summed(comm, np.vdot(Z_random, multiply(A, Z_random))) for A in (system.C, linearised.M))
        beyond = replace(beyond, alpha=max(beyond.alpha, float(C / M)))
    eta = beyond.loss_factor
    coupling = structural_coupling(linearised, modes, everything, eta) if eta > 0.0 and n_rows > 0 else None
    return of_samples(structure, rows, W[-n_out:, :-n_out], np.diag(W)[:-n_out], beyond, coupling)


def structural_coupling(linearised: Linearised, modes: Modes, everything: sp.csr_matrix, eta: float) -> StructuralCoupling:
    """Return how a loss factor couples the modes to those beyond.  Collective: as many static solves as modes."""
    system, phi_owned = linearised.system, modes.phi_owned
    d_owned = eta * (multiply(linearised.K_L, phi_owned) - multiply(system.K, phi_owned))  # eta R^T K_J R phi
    Z_owned = beyond_modes(linearised, modes, d_owned)
    n_rows, n_out = system.R.shape[0], system.outputs.shape[0]
    seen = owned_product(everything, Z_owned, system)
    return StructuralCoupling(
        seen[:n_rows], seen[n_rows : n_rows + n_out], seen[n_rows + n_out :], gram(system.comm, d_owned, Z_owned)
    )


def beyond_modes(linearised: Linearised, modes: Modes, right_owned: np.ndarray) -> np.ndarray:
    """Return Z B = K_L^-1 B - phi Omega^-2 phi^T B, this rank's rows.  Collective: as many static solves as columns."""
    comm = linearised.system.comm
    of_modes = gram(comm, modes.phi_owned, right_owned) / modes.omega_n[:, None] ** 2
    return linearised.factor.solve(right_owned) - modes.phi_owned @ of_modes
