"""The enriched model that error bars compare with: the stuck structure's receptance, and samples of the truncated modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..linear.dense import diagonal_owned, gram, multiply
from ..linear.random_signs import random_signs
from ..parallel.ownership import summed
from ..receptance.modes import DampedModes
from ..receptance.per_group import PerGroup
from ..receptance.receptance import Receptance
from ..receptance.structural_coupling import StructuralCoupling
from ..receptance.truncated_modes import KEY, LAST, SAMPLES, EnrichedModel, TruncatedModes, of_samples
from .modal_structure import damping_beyond, reduce_structure, stuck_receptance
from .reduction import Reduction
from .settings import ModalDamping, ReductionSettings
from .stuck import StuckStructure, owned_product, seen_rows


def enriched_model_of(stuck: StuckStructure, reduction: Reduction, settings: ReductionSettings) -> EnrichedModel:
    """Return the enriched model of a reduction.

    Collective on the system's communicator: the static solves of ``truncated_modes``, for the group of harmonic 1 now, for
    others when they are needed.
    """
    if reduction.leaves_out == "nothing":
        return EnrichedModel.of_all_modes(reduction.structure)
    is_solved, damping = reduction.leaves_out == "modes", settings.damping

    def truncated_of(of_group: StuckStructure) -> TruncatedModes | None:
        key = "truncated modes", of_group.seen, of_group.n_modes, damping
        return of_group.once(key, lambda: truncated_modes(of_group, stuck_receptance(of_group, damping), damping))

    truncated: PerGroup[TruncatedModes | None] = stuck.per_group.mapped(truncated_of)
    truncated.of(1)
    return EnrichedModel(reduction.structure if is_solved else reduce_structure(stuck, damping), truncated, is_solved)


def truncated_modes(stuck: StuckStructure, receptance: Receptance, damping: ModalDamping | None = None) -> TruncatedModes | None:
    """Return the samples for the truncated modes of one group of harmonics; None where there are none.

    Collective on the system's communicator: ``SAMPLES`` static solves, with structural damping as many more as modes.
    docs/theory.md, eq. (11.3).
    """
    if stuck.n_modes in (0, stuck.n_dof):
        return None
    modes, system, comm, (first, last) = stuck.modes, stuck.system, stuck.comm, stuck.K_L.getOwnershipRange()
    n_rows, n_out, mass = system.R.shape[0], system.outputs.shape[0], np.maximum(diagonal_owned(stuck.M), 0.0)
    # the diagonal of M, scaled to have the kinetic energy of the highest modes used
    energies = summed(comm, mass @ modes.phi_owned[:, -LAST:] ** 2)
    random = np.sqrt(mass / energies.mean())[:, None] * random_signs(first, last - first, SAMPLES, KEY)
    given = sp.hstack([system.loads, system.outputs.T], format="csr")[first:last].toarray()
    Z_random, Z_given = np.split(beyond_modes(stuck, np.hstack([random, given])), [SAMPLES], axis=1)
    rows = owned_product(seen_rows(system), Z_random, system) / np.sqrt(SAMPLES)
    W = gram(comm, Z_given, multiply(stuck.M, Z_given))
    beyond = damping_beyond(damping, receptance.modes)
    if system.C is not None:  # what it is of the motions that the samples are
        C, M = (summed(comm, np.vdot(Z_random, multiply(A, Z_random))) for A in (system.C, stuck.M))
        beyond = replace(beyond, alpha=max(beyond.alpha, float(C / M)))
    coupling = structural_coupling(stuck, receptance.modes, beyond.loss_factor) if beyond.loss_factor > 0.0 and n_rows else None
    return of_samples(receptance, rows, W[-n_out:, :-n_out], np.diag(W)[:-n_out], beyond, coupling)


def structural_coupling(stuck: StuckStructure, modes: DampedModes, eta: float) -> StructuralCoupling:
    """Return how a loss factor couples the modes to the truncated ones.  Collective: as many static solves as modes."""
    system = stuck.system
    forces = eta * stuck.pairs.law.stiffness.reshape(-1, 1) * modes.R_phi
    d_owned = system.R.T.tocsr()[stuck.rows] @ forces  # eta R^T K_J R phi
    Z_owned = beyond_modes(stuck, d_owned)
    n_rows, n_out = system.R.shape[0], system.outputs.shape[0]
    seen = owned_product(seen_rows(system), Z_owned, system)
    return StructuralCoupling(
        seen[:n_rows], seen[n_rows : n_rows + n_out], seen[n_rows + n_out :], gram(system.comm, d_owned, Z_owned)
    )


def beyond_modes(stuck: StuckStructure, right_owned: np.ndarray) -> np.ndarray:
    """Return Z B = K_L^-1 B - phi Omega^-2 phi^T B, this rank's rows.  Collective: as many static solves as columns."""
    modes = stuck.modes
    of_modes = gram(stuck.comm, modes.phi_owned, right_owned) / modes.omega_n[:, None] ** 2
    return stuck.solve(right_owned) - modes.phi_owned @ of_modes
