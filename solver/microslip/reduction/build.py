"""Reduce a linearised structure to the receptance of its pairs, loads and outputs (docs/theory.md, section 4)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..modes.constraint import static_columns
from ..parallel.errors import CaseError
from .columns import StaticColumns
from .model import ReducedModel


def modal_damping(damping, omega_n: np.ndarray) -> np.ndarray:
    """Return phi^T C phi, (n_phi,) [1/s]: 2 zeta omega_n, or alpha + beta omega_n^2 of C = alpha M + beta K_L.  Local."""
    if damping.ratio is not None:
        return 2.0 * damping.ratio * omega_n
    alpha, beta = damping.rayleigh
    return alpha + beta * omega_n**2


def load_coefficients(loads, harmonics: int) -> np.ndarray:
    """Return the Fourier coefficients of the loads at unit level, (n_loads, N_H): cos(n omega t + phase).  Local."""
    f = np.zeros((len(loads), 2 * harmonics + 1))
    for row, load in zip(f, loads):
        if load.harmonic > harmonics:
            raise CaseError(f"[[loads]] acts in harmonic {load.harmonic}, but [solver] harmonics = {harmonics}")
        if load.harmonic == 0:
            row[0] = np.cos(load.phase)
        else:
            row[2 * load.harmonic - 1: 2 * load.harmonic + 1] = np.cos(load.phase), -np.sin(load.phase)
    return f


def split_evenly(n: int, size: int) -> np.ndarray:
    """Return (size + 1,) limits that split n items over ``size`` ranks; a rank may get none.  Local."""
    return np.array([n * rank // size for rank in range(size + 1)])


def reduce_structure(linearised, modes, scene) -> ReducedModel:
    """Return the reduced model: n_loads + n_outputs static solves now, those of the pairs when they first leave sticking.

    Collective on the system's communicator.
    """
    system = linearised.system
    comm, R, loads, outputs = system.comm, system.R, system.loads, system.outputs
    n_rows, n_out, n_load = R.shape[0], outputs.shape[0], loads.shape[1]
    everything = sp.vstack([R, outputs, loads.T], format="csr")
    static = static_columns(linearised, everything, sp.hstack([loads, outputs.T], format="csc"))
    participation = owned_product(everything, modes.phi_owned, system)
    pair_ranges = split_evenly(n_rows // 3, comm.size)
    return ReducedModel(
        comm=comm, pair_ranges=pair_ranges, omega_n=modes.omega_n, C=modal_damping(scene.damping, modes.omega_n),
        r=participation[:n_rows], o=participation[n_rows: n_rows + n_out], b=participation[n_rows + n_out:].T.copy(),
        G_static=pair_columns(linearised, pair_ranges),
        du_static=static[:n_rows, :n_load].copy(),
        out_static=static[n_rows: n_rows + n_out, :n_load].copy(),
        out_R=static[:n_rows, n_load:].T.copy(),
        load_static=static[n_rows + n_out:, :n_load].copy(),
        f=load_coefficients(scene.loads, scene.solver.harmonics),
    )


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
