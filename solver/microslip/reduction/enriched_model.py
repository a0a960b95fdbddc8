"""The enriched model of the error bars: the receptance of the stuck structure, and samples of the truncated modes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..linear.dense import gram
from ..linear.random_signs import random_signs
from ..parallel.ownership import summed
from ..receptance.modes import ProjectedModes
from ..receptance.per_group import PerGroup
from ..receptance.receptance import Receptance
from ..receptance.structural_coupling import StructuralCoupling
from ..receptance.truncated_modes import KEY, LAST, SAMPLES, EnrichedModel, TruncatedModes, of_samples
from .modal_structure import damping_beyond, reduce_structure, stuck_receptance
from .reduction import Reduction
from .settings import ModalDamping, ReductionSettings
from .stuck import StuckStructure, owned_product, projection_rows
from .whole_disc import WholeDisc, forget_all_faces, truncated_of_all


def enriched_model_of(stuck: StuckStructure, reduction: Reduction, settings: ReductionSettings) -> EnrichedModel:
    """Return the enriched model of a reduction.

    Collective on the system's communicator: the static solves of ``samples_beyond``, for the group of harmonic 1 now, and for
    other groups on demand.
    """
    if reduction.leaves_out == "nothing":
        return EnrichedModel.of_all_modes(reduction.structure)
    is_solved, damping = reduction.leaves_out == "modes", settings.damping

    def truncated_of(of_group: StuckStructure) -> TruncatedModes | None:
        key = "truncated modes", of_group.projected, of_group.n_modes, damping
        receptance = stuck_receptance(of_group, damping)
        if isinstance(of_group, WholeDisc):
            return of_group.once(key, lambda: of_all(of_group, receptance))
        return of_group.once(key, lambda: truncated_modes(of_group, receptance, damping))

    def of_all(disc: WholeDisc, receptance: Receptance) -> TruncatedModes | None:
        parts = list(map(truncated_of, disc.tuned))
        forget_all_faces(disc.tuned)
        return truncated_of_all(disc, parts, receptance)

    truncated: PerGroup[TruncatedModes | None] = stuck.per_group.mapped(truncated_of)
    truncated.of(1)
    return EnrichedModel(reduction.structure if is_solved else reduce_structure(stuck, damping), truncated, is_solved)


# -- samples beyond all computed modes, computed once --------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Samples:
    """Responses to random vectors s, loads and outputs under Z = K_L^-1 - phi Omega^-2 phi^H of all N computed modes; replicated.

    s has the covariance diag(M).  docs/theory.md, section 11.
    """

    rows: np.ndarray  # (3 n_pairs + n_outputs + n_loads, SAMPLES) Z s projected on pairs, outputs and loads
    direct: np.ndarray  # (n_outputs, n_loads) W = Z M Z between outputs and loads
    drive_point: np.ndarray  # (n_loads,) W of each load with itself
    energies: np.ndarray  # (N,) phi^H diag(M) phi of each mode
    amplitudes: np.ndarray  # (N, SAMPLES) phi^H s
    mass: float  # sum of (Z s)^H M Z s
    damping: float = 0.0  # sum of (Z s)^H C Z s with the structure's damping matrix C
    coupled: np.ndarray | None = None  # (N, SAMPLES) phi^H C Z s; None without C


SAMPLED, COUPLED = "samples", "structural coupling"  # keys of results computed once for the modes of a structure


def samples_beyond(stuck: StuckStructure) -> Samples:
    """Return the samples beyond all computed modes, computed once.  Collective: one solve per random vector, load and output."""

    def make() -> Samples:
        everything = stuck.using(stuck.n_computed)
        system, comm, rows = stuck.system, stuck.comm, stuck.rows
        n_out, mass, phi_owned = system.outputs.shape[0], np.maximum(stuck.masses, 0.0), everything.modes.phi_owned
        random = np.sqrt(mass)[:, None] * random_signs(rows.start, len(mass), SAMPLES, KEY)
        forces = sp.hstack([system.loads, system.outputs.conj().T], format="csr")[rows].toarray()
        Z_random, Z_forces = np.split(beyond_modes(everything, np.hstack([random, forces])), [SAMPLES], axis=1)
        W = gram(comm, Z_forces, stuck.product(stuck.M, Z_forces))
        samples = Samples(
            rows=owned_product(projection_rows(system), Z_random, system),
            direct=W[-n_out:, :-n_out].copy(),
            drive_point=np.diag(W)[:-n_out].real.copy(),
            energies=summed(comm, mass @ np.abs(phi_owned) ** 2),
            amplitudes=everything.participation(random),
            mass=float(summed(comm, np.vdot(Z_random, stuck.product(stuck.M, Z_random))).real),
        )
        if system.C is None:
            return samples
        CZ_owned = stuck.product(system.C, Z_random)
        lost = float(summed(comm, np.vdot(Z_random, CZ_owned)).real)
        return replace(samples, damping=lost, coupled=everything.participation(CZ_owned))

    return stuck.once((SAMPLED, stuck.projected), make)


def coupling_beyond(stuck: StuckStructure) -> StructuralCoupling:
    """Return Z d, d = R^H K_J R phi of all computed modes, for a loss factor of 1, cached.  Collective: a solve per mode."""

    def make() -> StructuralCoupling:
        system, everything = stuck.system, stuck.using(stuck.n_computed)
        d_owned = stuck.pair_forces(stuck.pairs.law.stiffness.reshape(-1, 1) * stuck.projected.R_phi)
        Z_owned = beyond_modes(everything, d_owned)
        of_pairs, of_outputs, of_loads = _parts(stuck, owned_product(projection_rows(system), Z_owned, system))
        return StructuralCoupling(of_pairs, of_outputs, of_loads, gram(stuck.comm, d_owned, Z_owned))

    return stuck.once((COUPLED, stuck.projected), make)


def beyond_modes(stuck: StuckStructure, right_owned: np.ndarray) -> np.ndarray:
    """Return Z B = K_L^-1 B - phi Omega^-2 phi^H B, this rank's rows.  Collective: as many static solves as columns."""
    of_modes = stuck.participation(right_owned) / stuck.omega_n[:, None] ** 2
    return stuck.solve(right_owned) - stuck.modes.phi_owned @ of_modes


# -- samples beyond the modes in use: with the terms of the further computed modes ---------------------------------


def truncated_modes(stuck: StuckStructure, receptance: Receptance, damping: ModalDamping | None = None) -> TruncatedModes | None:
    """Return the samples of the truncated modes of one harmonic group; None if no mode is truncated.

    Collective if its :class:`Samples` are new.  With M-orthonormal modes, Z M Z beyond m of N modes is that beyond N plus
    phi_k phi_k^H / omega_k^4 of each mode in between.  docs/theory.md, eq. (11.3).
    """
    if stuck.n_modes in (0, stuck.n_elastic):
        return None
    samples, projected, between = samples_beyond(stuck), stuck.projected, slice(stuck.n_modes, None)
    squares, o, b = projected.omega_n[between] ** 2, projected.o[:, between], projected.b[between]
    motions = samples.amplitudes[between] / squares[:, None]
    # random vectors are scaled to the kinetic energy of the highest modes in use
    scale = 1.0 / np.sqrt(samples.energies[: stuck.n_modes][-LAST:].mean() * SAMPLES)
    rows = scale * (samples.rows + _of_modes(projected, between) @ motions)
    direct = samples.direct + (o / squares**2) @ b
    drive_point = samples.drive_point + (np.abs(b) ** 2 / squares[:, None] ** 2).sum(axis=0)
    beyond = damping_beyond(damping, receptance.modes)
    if samples.coupled is not None and projected.C is not None:  # the damping matrix in the motions of the samples
        lost = np.vdot(motions, 2.0 * samples.coupled[between] + projected.C[between, between] @ motions).real
        kinetic = samples.mass + float(np.sum(np.abs(motions) ** 2))
        beyond = replace(beyond, alpha=max(beyond.alpha, float(samples.damping + lost) / kinetic))
    has_coupling = beyond.loss_factor > 0.0 and stuck.pairs.n_pairs > 0
    coupling = structural_coupling(stuck, beyond.loss_factor) if has_coupling else None
    return of_samples(receptance, rows, direct, drive_point, beyond, coupling)


def structural_coupling(stuck: StuckStructure, eta: float) -> StructuralCoupling:
    """Return the coupling of the modes in use to the truncated ones by a loss factor.  Collective if it must be computed."""
    coupling, projected, n = coupling_beyond(stuck), stuck.projected, stuck.n_modes
    between, K_J = slice(n, None), stuck.pairs.law.stiffness.reshape(-1, 1)
    of_modes = projected.R_phi[:, between].conj().T @ (K_J * projected.R_phi[:, :n])  # phi^H d of the modes in between
    motions = of_modes / projected.omega_n[between, None] ** 2
    rows = (
        np.concatenate([coupling.of_pairs, coupling.of_outputs, coupling.of_loads])[:, :n]
        + _of_modes(projected, between) @ motions
    )
    modal = coupling.modal[:n, :n] + of_modes.conj().T @ motions
    of_pairs, of_outputs, of_loads = (eta * part for part in _parts(stuck, rows))
    return StructuralCoupling(of_pairs, of_outputs, of_loads, eta**2 * modal)


def _of_modes(projected: ProjectedModes, between: slice) -> np.ndarray:
    """Return some modes projected on pairs, outputs and loads, (3 n_pairs + n_outputs + n_loads, m).  Local."""
    return np.concatenate([projected.R_phi[:, between], projected.o[:, between], projected.b[between].conj().T])


def _parts(stuck: StuckStructure, rows: np.ndarray) -> Sequence[np.ndarray]:
    """Return rows split into pairs, outputs and loads.  Local."""
    return np.split(rows, np.cumsum([3 * stuck.pairs.n_pairs, len(stuck.statics.out_static)]))
