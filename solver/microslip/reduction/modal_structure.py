"""Reduce a linearised structure to the receptance of its pairs, loads and outputs (docs/theory.md, section 4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..assembly.system import System
from ..linear.dense import gram, multiply
from ..messages.errors import CaseError
from ..receptance.damping import Damping, added, diagonal_if_possible
from ..receptance.family import ModalFamily
from ..receptance.modes_left_out import DampingBeyond
from ..receptance.observed import Observed
from ..receptance.reduced_structure import ReducedStructure
from .settings import ModalDamping
from .stuck import StuckStructure, seen_rows

if TYPE_CHECKING:
    from mpi4py import MPI
    from petsc4py import PETSc

_ROUNDING = 1e-9  # negative eigenvalue of phi^T C phi over the largest that counts as zero


def modal_damping(damping: ModalDamping, omega_n: np.ndarray) -> np.ndarray:
    """Return phi^T C phi, (n_phi,) [1/s]: 2 zeta omega_n, or alpha + beta omega_n^2 of C = alpha M + beta K_L.  Local."""
    if damping.rayleigh is None:
        return 2.0 * damping.ratios_of(len(omega_n)) * omega_n
    alpha, beta = damping.rayleigh
    return alpha + beta * omega_n**2


def damping_beyond(damping: ModalDamping | None, family: ModalFamily) -> DampingBeyond:
    """Return the damping beyond the modes of a family: as stated, with what dampers or a matrix make of the last.  Local."""
    if damping is None:
        return DampingBeyond(float(family.damping.diagonal[-1]))
    beside = float(family.damping.diagonal[-1] - modal_damping(damping, family.omega_n)[-1])
    if damping.rayleigh is not None:
        alpha, beta = damping.rayleigh
        return DampingBeyond(alpha + max(beside, 0.0), 0.0, beta, damping.structural)
    return DampingBeyond(max(beside, 0.0), float(damping.ratios_of(len(family.omega_n) + 1)[-1]), 0.0, damping.structural)


def structural_damping(K: PETSc.Mat, phi_owned: np.ndarray, eta: float, comm: MPI.Comm) -> np.ndarray:
    """Return eta phi^T K phi [1/s2], K without the springs of the joints: diagonal where nothing couples the modes, else full.

    Collective: one sum.  docs/theory.md, eq. (13.2).
    """
    modal = gram(comm, phi_owned, multiply(K, phi_owned))
    return eta * diagonal_if_possible(0.5 * (modal + modal.T))


def projected_damping(C: PETSc.Mat, phi_owned: np.ndarray, comm: MPI.Comm) -> np.ndarray:
    """Return phi^T C phi of the user's C [1/s]: its diagonal (n_phi,) where nothing couples the modes, else (n_phi, n_phi).

    Collective: one sum.

    Raises
    ------
    CaseError : C feeds energy into a motion; on every rank
    """
    modal = gram(comm, phi_owned, multiply(C, phi_owned))
    modal = 0.5 * (modal + modal.T)
    least, most = np.linalg.eigvalsh(modal)[[0, -1]]
    if least < -_ROUNDING * max(most, -least):
        raise CaseError(
            f"[model] damping: z^T C z = {least:.3g} z^T M z 1/s for some motion z (of others up to {most:.3g}): "
            "the damping matrix feeds energy in, so that no vibration is steady; it must not be negative"
        )
    return diagonal_if_possible(modal)


def all_damping(system: System, omega_n: np.ndarray, phi_owned: np.ndarray, damping: ModalDamping | None) -> np.ndarray:
    """Return phi^T C phi [1/s] of what the scene states for the modes and of the structure's own C, (m,) or (m, m).

    Collective: one sum where the structure has one.
    """
    of_modes = None if damping is None else modal_damping(damping, omega_n)
    of_structure = None if system.C is None else projected_damping(system.C, phi_owned, system.comm)
    if of_structure is None:
        assert of_modes is not None, "a scene with [damping] where the structure has no C"
        return of_modes
    if of_modes is None:
        return of_structure
    return added(of_structure, of_modes)


def reduce_structure(stuck: StuckStructure, damping: ModalDamping | None) -> ReducedStructure:
    """Return the structure's modes with its exact static response.

    Collective on the system's communicator: a sum, with a damping matrix another.
    """
    system, modes, static = stuck.linearised.system, stuck.modes, stuck.statics
    return ReducedStructure(
        comm=system.comm,
        pair_ranges=static.pair_ranges,
        families=(modal_family(system, modes.omega_n, modes.phi_owned, damping),),
        G_static=static.G_static,
        du_static=static.du_static,
        out_static=static.out_static,
        out_R=static.out_R,
        load_static=static.load_static,
        observed=observed(system),
    )


def observed(system: System) -> Observed | None:
    """Return what makes outputs of their rows; None where all are displacements.  Local."""
    parts = system.output_orders, system.output_pairs, system.output_base
    if all(part is None for part in parts):
        return None
    n_outputs, (n_rows, n_loads) = system.outputs.shape[0], (system.R.shape[0], system.loads.shape[1])
    empty = np.zeros(n_outputs, dtype=int), np.zeros((n_outputs, n_rows)), np.zeros((n_outputs, n_loads))
    return Observed(*(none if part is None else part for part, none in zip(parts, empty)))


def modal_family(system: System, omega_n: np.ndarray, phi_owned: np.ndarray, damping: ModalDamping | None) -> ModalFamily:
    """Return what pairs, loads and outputs see of modes, and their damping.  Collective: one sum, with the user's C or
    structural damping another.
    """
    participation = owned_product(seen_rows(system), phi_owned, system)
    R_phi, o, b_T = np.split(participation, np.cumsum([system.R.shape[0], system.outputs.shape[0]]))
    C = all_damping(system, omega_n, phi_owned, damping)
    eta = 0.0 if damping is None else damping.structural
    S = structural_damping(system.K, phi_owned, eta, system.comm) if eta > 0.0 else None
    return ModalFamily(omega_n, Damping(C, S), R_phi, b_T.T.copy(), o)


def owned_product(rows: sp.csr_matrix, phi_owned: np.ndarray, system: System) -> np.ndarray:
    """Return rows @ phi on every rank, (n_rows, n_phi).  Collective: one sum."""
    first, last = system.M.getOwnershipRange()
    return system.comm.allreduce(rows[:, first:last] @ phi_owned)
