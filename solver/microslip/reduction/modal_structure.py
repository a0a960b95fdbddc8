"""Reduce a stuck structure to the receptance of its pairs, loads and outputs (docs/theory.md, section 4)."""

import numpy as np

from ..messages.errors import CaseError
from ..receptance.damping import Damping, added, diagonal_if_possible, structural_damping
from ..receptance.modes import DampedModes, ProjectedModes
from ..receptance.receptance import Receptance
from ..receptance.reduced_structure import ReducedStructure
from ..receptance.rigid_motion import RigidMotion
from ..receptance.truncated_modes import DampingBeyond
from .settings import ModalDamping
from .stuck import StuckStructure

_ROUNDING = 1e-9  # negative eigenvalue of phi^T C phi, relative to the largest, that counts as zero


def damping_beyond(damping: ModalDamping | None, modes: DampedModes) -> DampingBeyond:
    """Return the damping of the truncated modes: as stated, plus that of the last mode by dampers or a matrix.  Local."""
    if damping is None:
        return DampingBeyond(float(modes.damping.diagonal[-1]))
    of_matrix = float(modes.damping.diagonal[-1] - damping.modal(modes.omega_n)[-1])
    if damping.rayleigh is not None:
        alpha, beta = damping.rayleigh
        return DampingBeyond(alpha + max(of_matrix, 0.0), 0.0, beta, damping.structural)
    return DampingBeyond(max(of_matrix, 0.0), float(damping.ratios_of(len(modes.omega_n) + 1)[-1]), 0.0, damping.structural)


def projected_damping(C: np.ndarray) -> np.ndarray:
    """Return phi^H C phi of the user's C [1/s], as a diagonal (m,) if it couples no modes, otherwise (m, m).  Local.

    Raises
    ------
    CaseError : C feeds energy into a motion; on every rank
    """
    least, most = np.linalg.eigvalsh(C)[[0, -1]]
    if least < -_ROUNDING * max(most, -least):
        raise CaseError(
            f"[model] damping: z^T C z = {least:.3g} z^T M z 1/s for some motion z (of others up to {most:.3g}): "
            "the damping matrix feeds energy in, so that no vibration is steady; it must not be negative"
        )
    return diagonal_if_possible(C)


def all_damping(modes: ProjectedModes, damping: ModalDamping | None) -> np.ndarray:
    """Return phi^H C phi [1/s] of the scene's modal damping and the structure's matrix C, (m,) or (m, m).  Local."""
    of_modes = None if damping is None else damping.modal(modes.omega_n)
    of_structure = None if modes.C is None else projected_damping(modes.C)
    if of_structure is None:
        assert of_modes is not None, "a scene with [damping] where the structure has no C"
        return of_modes
    if of_modes is None:
        return of_structure
    return added(of_structure, of_modes)


def damped_modes(modes: ProjectedModes, K_J: np.ndarray, damping: ModalDamping | None) -> DampedModes:
    """Return modes with their complete damping; ``K_J`` (3 n_pairs,) are the springs of the joints [N/m].  Local."""
    eta = 0.0 if damping is None else damping.structural
    S = structural_damping(modes.omega_n, modes.R_phi, K_J, eta) if eta > 0.0 else None
    return DampedModes(modes.omega_n, Damping(all_damping(modes, damping), S), modes.R_phi, modes.b, modes.o)


def stuck_receptance(stuck: StuckStructure, damping: ModalDamping | None) -> Receptance:
    """Return the receptance of one harmonic group: modes of its stuck structure, with its exact static response.  Local."""
    K_J = stuck.pairs.law.stiffness.ravel()
    modes = damped_modes(stuck.projected.first(stuck.n_modes), K_J, damping)
    return Receptance(modes, stuck.statics, damped_rigid(stuck, damping))


def damped_rigid(stuck: StuckStructure, damping: ModalDamping | None) -> RigidMotion | None:
    """Return the rigid-body motion of a free structure with its complete damping, including Rayleigh's alpha M.  Local."""
    if stuck.rigid is None or damping is None:
        return stuck.rigid
    return stuck.rigid.with_damping(float(damping.modal(np.zeros(1))[0]))


def reduce_structure(stuck: StuckStructure, damping: ModalDamping | None) -> ReducedStructure:
    """Return the reduced structure by modes and exact static response: for harmonic 1 now, for other groups on demand.

    Local.

    Raises
    ------
    CaseError : the structure's damping matrix feeds energy into a motion; on every rank
    """
    receptances = stuck.per_group.mapped(lambda of_group: stuck_receptance(of_group, damping))
    receptances.of(1)
    return ReducedStructure(
        comm=stuck.comm,
        n_pairs=stuck.pairs.n_pairs,
        n_outputs=len(stuck.statics.out_static),
        receptances=receptances,
        observed=stuck.observed,
    )
