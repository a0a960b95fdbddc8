"""A Galerkin reduction on any basis V, condensed exactly to the relative motion of the pairs (docs/theory.md, (8.1), (8.2))."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy.linalg

from ..fourier.amplitudes import to_real
from ..fourier.harmonics import Harmonics
from ..linear.dense import gram, multiply
from ..modes.rayleigh import sharpened
from ..parallel.agree import on_root
from ..parallel.ownership import rows_of, split_evenly
from ..points.selection import AllPairs
from ..receptance.modes import DampedModes
from ..receptance.motions import ActingForces, modal_motion
from ..receptance.observed import Observed
from ..receptance.per_group import PerGroup
from ..receptance.receptance import Receptance
from ..receptance.reduced_model import ReducedModel
from ..receptance.reduced_structure import ReducedStructure
from ..receptance.rigid_motion import RigidMotion
from ..receptance.static_columns import StaticColumns
from ..receptance.static_response import StaticResponse
from .expand import rigid_field
from .modal_structure import damped_modes, damped_rigid
from .reduction import Basis, Expansion, Reduction
from .settings import ReductionSettings
from .stuck import StuckStructure, project_modes

if TYPE_CHECKING:
    from mpi4py import MPI

DEPENDENT = 1e-13  # strain energy of a combination of columns, each scaled to energy 1, below which it is discarded
NEARLY_DEPENDENT = 1e-8  # the same, below which rounding errors require a second projection
MASSLESS = 1e-16  # theta relative to the largest: motions below it count as massless
_BLOCKS = 4  # blocks of the basis' size in memory at the same time


def reduce_on_basis(
    stuck: StuckStructure,
    V_owned: np.ndarray,
    settings: ReductionSettings,
    unknowns: int | None = None,
    leaves_out: Literal["basis", "nothing"] = "basis",
) -> Reduction:
    """Return the Galerkin reduction on the columns of V, this rank's rows (n_owned, n_V).

    Collective on the system's communicator.  ``unknowns`` is the reported number per harmonic coefficient, by default n_V.
    """
    rigid = stuck.factor.rigid
    omega_n, phi_owned = galerkin_modes(stuck, V_owned if rigid is None else rigid.elastic(V_owned))

    def displacements(model: ReducedModel, points: Sequence[ActingForces]) -> list[np.ndarray]:
        fields = []
        for level, omega, p in points:
            full = model.with_harmonics(Harmonics.full(p.shape[-1]))
            (eta,) = modal_motion(full, level, omega, p)
            elastic = phi_owned @ to_real(eta, full.N_H)
            fields.append(elastic + rigid_field(stuck, full.groups[0].receptance, level * full.f, omega * full.harmonics.numbers))
        return fields

    basis = Basis(project_modes(stuck.system, omega_n, phi_owned), unknowns or V_owned.shape[1], leaves_out)
    return replace(reduction_of_basis(stuck, basis, settings, displacements), phi_owned=phi_owned)


def reduction_of_basis(stuck: StuckStructure, basis: Basis, settings: ReductionSettings, displacements: Expansion) -> Reduction:
    """Return the reduction with the modes of a basis.  Local."""
    modes = damped_modes(basis.modes, stuck.pairs.law.stiffness.ravel(), settings.damping)
    structure = structure_of_modes(stuck.comm, modes, stuck.observed, damped_rigid(stuck, settings.damping))
    return Reduction(structure, AllPairs(coordinates=basis.unknowns), displacements, basis.leaves_out, basis)


def galerkin_modes(stuck: StuckStructure, V_owned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (omega_n, phi_owned): the modes of (K_L, M) in the span of V, ascending, phi^T M phi = I.

    Collective: sums of the reduced matrices, twice if columns are nearly dependent.  The second pass starts from the modes of
    the first, in which a low mode is no longer a small difference of stiff columns.  docs/theory.md, eq. (8.1).
    """
    comm = stuck.comm
    phi_owned, least = V_owned, 0.0
    for _ in range(2):
        if least < NEARLY_DEPENDENT:
            K_r, M_r = (gram(comm, phi_owned, multiply(A, phi_owned)) for A in (stuck.K_L, stuck.M))
            theta, q, least = on_root(comm, reduced_modes, K_r, M_r)
            phi_owned = phi_owned @ q
    theta = np.maximum(theta, MASSLESS * theta[0])
    phi_owned = phi_owned / np.sqrt(theta)  # from phi^T K_L phi = I
    eigenvalues = sharpened(stuck.linearised, 1.0 / theta, phi_owned)
    order = np.argsort(eigenvalues)
    return np.sqrt(eigenvalues[order]), phi_owned[:, order]


def reduced_modes(K_r: np.ndarray, M_r: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return (theta, q): M_r q = theta K_r q, theta descending, q^T K_r q = I, without dependent directions.  Local.

    docs/theory.md, eq. (8.1).  The third value is the smallest energy of a retained combination of columns, relative to the
    largest.
    """
    if not len(K_r):  # no columns: a structure without joints
        return np.empty(0), np.empty((0, 0)), 1.0
    energy = np.maximum(np.diag(K_r), 0.0)
    scale = np.divide(1.0, np.sqrt(energy), out=np.zeros_like(energy), where=energy > 0.0)
    values, Q = scipy.linalg.eigh(0.5 * (K_r + K_r.T) * np.outer(scale, scale))
    is_independent = values > DEPENDENT * values[-1]
    if not is_independent.any():  # columns without energy: the modes span all motions of the joint
        return np.empty(0), np.empty((len(energy), 0)), 1.0
    W = scale[:, None] * Q[:, is_independent] / np.sqrt(values[is_independent])
    theta, q = scipy.linalg.eigh(W.T @ (0.5 * (M_r + M_r.T)) @ W)
    return theta[::-1], (W @ q)[:, ::-1], float(values[is_independent][0] / values[-1])


def structure_of_modes(
    comm: MPI.Comm, modes: DampedModes, observed: Observed | None = None, rigid: RigidMotion | None = None
) -> ReducedStructure:
    """Return a structure of these modes and rigid-body motion in all harmonics, with their static response, eq. (8.2).  Local."""
    R_phi, o, b, n_pairs = modes.R_phi, modes.o, modes.b, len(modes.R_phi) // 3
    pair_ranges, flexibility = split_evenly(n_pairs, comm.size), 1.0 / modes.omega_n**2
    local = R_phi[3 * pair_ranges[comm.rank] : 3 * pair_ranges[comm.rank + 1]] * flexibility

    def columns(pairs: np.ndarray) -> np.ndarray:
        return local @ R_phi[rows_of(pairs)].T

    static = StaticResponse(
        G_static=StaticColumns(n_pairs, len(local) // 3, columns),
        du_static=(R_phi * flexibility) @ b,
        out_static=(o * flexibility) @ b,
        out_R=(o * flexibility) @ R_phi.T,
        load_static=(b.T * flexibility) @ b,
        outputs_static=(o**2 * flexibility).sum(axis=1),
    )
    receptances = PerGroup.single(Receptance(modes, static, rigid))
    return ReducedStructure(comm=comm, n_pairs=n_pairs, n_outputs=len(o), receptances=receptances, observed=observed)


def memory_of_basis(n_dof: int, n_columns: int) -> float:
    """Return the memory of a reduction on ``n_columns`` in addition to the factor [bytes], over all ranks.  Local."""
    return 8.0 * n_columns * (_BLOCKS * n_dof + 8.0 * n_columns)
