"""Reduce a linearised structure to the receptance of its pairs, loads and outputs (docs/theory.md, section 4)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..fourier.harmonics import Harmonics
from ..linear.dense import gram, multiply
from ..modes.constraint import static_columns
from ..parallel.errors import CaseError
from ..parallel.ownership import split_evenly
from ..receptance.damping import Damping
from ..receptance.family import ModalFamily
from ..receptance.model import ReducedModel
from ..receptance.static_columns import StaticColumns

_COUPLES = 1e-12  # |C_ij| / sqrt(C_ii C_jj) between modes beyond which a damping matrix is kept full
_ROUNDING = 1e-9  # negative eigenvalue of phi^T C phi over the largest that counts as zero


def modal_damping(damping, omega_n: np.ndarray) -> np.ndarray:
    """Return phi^T C phi, (n_phi,) [1/s]: 2 zeta omega_n, or alpha + beta omega_n^2 of C = alpha M + beta K_L.  Local."""
    if damping.ratio is not None:
        return 2.0 * damping.ratio * omega_n
    alpha, beta = damping.rayleigh
    return alpha + beta * omega_n**2


def projected_damping(C, phi_owned: np.ndarray, comm) -> np.ndarray:
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
    size = np.sqrt(np.abs(np.diag(modal)))
    is_coupled = np.abs(modal - np.diag(np.diag(modal))) > _COUPLES * np.outer(size, size)
    return modal if is_coupled.any() else np.diag(modal).copy()


def load_coefficients(loads, harmonics: Harmonics) -> np.ndarray:
    """Return the Fourier coefficients of the loads at unit level, (n_loads, N_H): cos(n omega t + phase).  Local."""
    f = np.zeros((len(loads), harmonics.n_coefficients))
    for row, load in zip(f, loads):
        if load.harmonic not in harmonics:
            raise CaseError(f"[[loads]] acts in harmonic {load.harmonic}, which is not one of the harmonics {harmonics}")
        cos_sin = np.array([np.cos(load.phase), -np.sin(load.phase)])
        row[harmonics.columns(load.harmonic)] = cos_sin[:1] if load.harmonic == 0 else cos_sin
    return f


def reduce_structure(linearised, modes, scene) -> ReducedModel:
    """Return the reduced model: n_loads + n_outputs static solves now, those of the pairs when they first leave sticking.

    Collective on the system's communicator.
    """
    system = linearised.system
    n_rows, n_out, n_load = system.R.shape[0], system.outputs.shape[0], system.loads.shape[1]
    static = static_columns(linearised, _all_rows(system), sp.hstack([system.loads, system.outputs.T], format="csc"))
    pair_ranges, harmonics = split_evenly(n_rows // 3, system.comm.size), Harmonics.up_to(scene.harmonics)
    return ReducedModel(
        comm=system.comm,
        pair_ranges=pair_ranges,
        families=(modal_family(system, modes.omega_n, modes.phi_owned, scene),),
        G_static=pair_columns(linearised, pair_ranges),
        du_static=static[:n_rows, :n_load].copy(),
        out_static=static[n_rows : n_rows + n_out, :n_load].copy(),
        out_R=static[:n_rows, n_load:].T.copy(),
        load_static=static[n_rows + n_out :, :n_load].copy(),
        f=load_coefficients(scene.loads, harmonics),
        harmonics=harmonics,
    )


def modal_family(system, omega_n: np.ndarray, phi_owned: np.ndarray, scene) -> ModalFamily:
    """Return what pairs, loads and outputs see of modes, and their damping.  Collective: one sum, with the user's C another."""
    participation = owned_product(_all_rows(system), phi_owned, system)
    R_phi, o, b_T = np.split(participation, np.cumsum([system.R.shape[0], system.outputs.shape[0]]))
    C = modal_damping(scene.damping, omega_n) if system.C is None else projected_damping(system.C, phi_owned, system.comm)
    return ModalFamily(omega_n, Damping(C), R_phi, b_T.T.copy(), o)


def _all_rows(system) -> sp.csr_matrix:
    """Return the rows that are seen of a motion: of pairs, outputs and loads."""
    return sp.vstack([system.R, system.outputs, system.loads.T], format="csr")


def pair_columns(linearised, pair_ranges: np.ndarray) -> StaticColumns:
    """Return the columns of R K_L^-1 R^T, to be solved for with the kept factor when they are needed.  Local."""
    R, comm = linearised.system.R, linearised.system.comm
    R_T = R.T.tocsc()

    def solve(pairs: np.ndarray) -> np.ndarray:
        chosen = (3 * pairs[:, None] + np.arange(3)).ravel()
        return static_columns(linearised, R, R_T[:, chosen], row_ranges=3 * pair_ranges)

    n_owned = int(pair_ranges[comm.rank + 1] - pair_ranges[comm.rank])
    return StaticColumns(R.shape[0] // 3, n_owned, solve)


def owned_product(rows: sp.csr_matrix, phi_owned: np.ndarray, system) -> np.ndarray:
    """Return rows @ phi on every rank, (n_rows, n_phi).  Collective: one sum."""
    first, last = system.K.getOwnershipRange()
    return system.comm.allreduce(rows[:, first:last] @ phi_owned)
