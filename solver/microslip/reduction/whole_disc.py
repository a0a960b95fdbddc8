"""A disc whose sectors may differ, with the pairs of all sectors, from the nodal diameters of the disc with identical sectors.

Loads, outputs and pairs are those of all sectors, and everything is real.  Motions over the DOFs have a row for each DOF and
sector; the sectors of a DOF are consecutive.  docs/theory.md, section 17.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg.blas import dgemm

from ..assembly.sectors import AllSectors
from ..fourier.harmonics import Harmonics
from ..linear.sector_factor import DiameterFactor
from ..mesh.data import ContactPairs
from ..parallel.ownership import pairs_of_rank, rows_of
from ..receptance.circulant import CirculantColumns, ColumnsOfOtherModes, Waves
from ..receptance.columns import ReceptanceColumns
from ..receptance.modes import ProjectedModes
from ..receptance.motions import ActingForces, linear_motion
from ..receptance.observed import Observed
from ..receptance.other_springs import with_springs
from ..receptance.per_group import PerGroup
from ..receptance.receptance import Receptance
from ..receptance.reduced_model import ReducedModel
from ..receptance.reduced_structure import ReducedStructure
from ..receptance.sector_products import SectorProducts
from ..receptance.springs import SpringChange
from ..receptance.static_response import StaticResponse
from ..receptance.truncated_modes import TruncatedModes, of_samples
from .mistuning import BladeForms, changed_modes, with_modes_changed
from .settings import ModalDamping
from .stuck import StuckStructure

if TYPE_CHECKING:
    from collections.abc import Hashable

    from ..assembly.system import System

_KEY = 21  # of the random phases of the diameters


@dataclass(frozen=True, eq=False, kw_only=True)
class WholeDisc(StuckStructure):
    """The stuck structure of a whole disc: one real group of harmonics."""

    tuned: tuple[StuckStructure, ...]  # of the nodal diameters 0, 1, ..., N // 2, with identical sectors
    weights: np.ndarray  # (N, n_loads) factor of each load in each sector
    of_tuned: np.ndarray  # (M, M) its modes in coordinates of the tuned modes, which are ordered by diameter
    turns: np.ndarray  # (N, 3, 3) rotations of the sectors about the axis
    diameter: int  # nodal diameter excited by the loads in harmonic 1, 0 to N // 2
    has_other_blades: bool = False  # whether its modes differ from the tuned modes

    @property
    def waves(self) -> Waves:
        """Transforms over the sectors."""
        return Waves(len(self.weights))

    @property
    def excited(self) -> StuckStructure:
        """The structure of the nodal diameter that the loads excite, with identical sectors."""
        return self.tuned[self.diameter]

    @property
    def change_of_springs(self) -> np.ndarray:
        """Difference of the contact stiffness of each pair from that of the tuned disc, (3 n_pairs,) [N/m]."""
        alike = self.tuned[0].pairs.law.stiffness.ravel()
        return self.pairs.law.stiffness.ravel() - np.tile(alike, self.waves.n_sectors)

    @property
    def computed_groups(self) -> dict[Hashable, StuckStructure]:
        """The structures of the nodal diameters.  Local."""
        return dict(enumerate(self.tuned))

    @property
    def system(self) -> System:
        """The system of nodal diameter 0, with the motion of the nodes of all sectors."""
        system = self.tuned[0].system
        assert system.sectors is not None, "of a disc"
        return replace(system, sectors=AllSectors(system.sectors, self.turns))


def of_all_sectors(
    tuned: Sequence[StuckStructure], pairs: ContactPairs, leads: np.ndarray, factors: np.ndarray
) -> dict[str, Any]:
    """Return the fields of the stuck structure of a disc of identical sectors.  Collective: gathers of the static columns.

    Parameters
    ----------
    tuned : of the nodal diameters 0, 1, ..., N // 2
    pairs : of all sectors
    leads : (n_loads,) n h of each load, whose phase in sector s leads by n h s alpha
    factors : (N,) of the loads of each sector
    """
    N, first = len(factors), tuned[0]
    waves, weights = Waves(N), load_weights(leads, factors)
    projected = tuned_modes(tuned, waves, weights)
    order = np.argsort(projected.omega_n, kind="stable")
    return {
        "comm": first.comm,
        "n_dof": N * first.n_dof,
        "pairs": pairs,
        "statics": _statics(tuned, waves, weights),
        "projected": projected.ordered(order),
        "n_modes": len(order),
        "n_proved": len(order),
        "observed": _observed(first.observed, N, weights.shape[1]),
        "factored": first.factored,
        "tuned": tuple(tuned),
        "weights": weights,
        "of_tuned": np.eye(len(order))[:, order],
    }


def tuned_modes(tuned: Sequence[StuckStructure], waves: Waves, weights: np.ndarray) -> ProjectedModes:
    """Return the modes of a disc of identical sectors, by diameter, projected on pairs, loads and outputs of all.  Local."""
    used = [each.projected.first(each.n_modes) for each in tuned]
    return waves.modes([replace(each, b=np.repeat(each.b, 2, axis=1)) for each in used], weights)


def with_other_blades(
    fields: Mapping[str, Any], tuned: Sequence[StuckStructure], forms: BladeForms, factors: Sequence[np.ndarray]
) -> dict[str, Any]:
    """Return the fields of a disc with changed stiffness and mass of its blades, from the fields of the tuned disc.  Collective.

    ``factors`` are the factors (N,) of the stiffness and of the mass of the blades.

    Raises
    ------
    CaseError : a stiffness or a mass that is not positive; on every rank
    """
    comm, projected = fields["comm"], fields["projected"]
    waves = Waves(len(factors[0]))
    omega_n, X = changed_modes(tuned, waves, forms, factors)
    of_before = fields["of_tuned"].T @ X
    after = in_coordinates(projected, omega_n, of_before)
    dF = (of_before / omega_n**2) @ of_before.T - np.diag(projected.omega_n**-2.0)
    pairs = pairs_of_rank(comm, fields["pairs"].n_pairs)
    truncated = CirculantColumns(waves.blocks([_truncated_columns(each) for each in tuned]), pairs)
    G_static = ColumnsOfOtherModes(truncated, after, slice(3 * pairs.start, 3 * pairs.stop))
    statics = with_modes_changed(fields["statics"], projected, dF, G_static)
    return {**fields, "projected": after, "statics": statics, "of_tuned": X, "has_other_blades": True}


def load_weights(leads: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Return the factors of the two real shapes of each load in each sector, (N, 2 n_loads): eq. (17.3).  Local.

    cos(x + b) = cos b cos x + sin b cos(x + pi / 2), b = n h s alpha.
    """
    N = len(factors)
    lead = 2.0 * np.pi / N * ((np.arange(N)[:, None] * np.asarray(leads, dtype=int)) % N)
    return factors[:, None] * np.stack([np.cos(lead), np.sin(lead)], axis=-1).reshape(N, -1)


def _twice(of_loads: np.ndarray) -> np.ndarray:
    """Return the columns of loads (a, n_loads), repeated for their two real shapes, (a, 2 n_loads).  Local."""
    return np.repeat(of_loads, 2, axis=1)


def _statics(tuned: Sequence[StuckStructure], waves: Waves, weights: np.ndarray) -> StaticResponse:
    """Return the static response of all sectors.  Collective: static columns of all pairs, gathered."""
    statics, comm = [each.statics for each in tuned], tuned[0].comm
    columns = [_all_columns(each) for each in tuned]
    n_pairs = waves.n_sectors * len(columns[0]) // 3
    loads = [_twice(each.load_static) for each in statics]
    return StaticResponse(
        G_static=CirculantColumns(waves.blocks(columns), pairs_of_rank(comm, n_pairs)),
        du_static=waves.response([_twice(each.du_static) for each in statics], weights),
        out_static=waves.response([_twice(each.out_static) for each in statics], weights),
        out_R=waves.dense([each.out_R for each in statics]),
        load_static=waves.work([np.repeat(each, 2, axis=0) for each in loads], weights, weights),
        outputs_static=np.tile(waves.blocks([each.outputs_static for each in statics])[0], waves.n_sectors),
    )


def _all_columns(stuck: StuckStructure) -> np.ndarray:
    """Return G_static of all pairs of a sector, (3 n, 3 n), on every rank.  Collective."""
    owned = stuck.statics.G_static.transposed(np.arange(stuck.pairs.n_pairs)).T
    return np.concatenate(stuck.comm.allgather(owned))  # rank order is row order


def _truncated_columns(stuck: StuckStructure) -> np.ndarray:
    """Return G_static of all pairs of a sector without the part of the modes in use, on every rank.  Collective."""
    R_phi = stuck.projected.R_phi[:, : stuck.n_modes]
    columns: np.ndarray = _all_columns(stuck) - (R_phi / stuck.omega_n**2) @ R_phi.conj().T
    return columns


def _observed(of_sector: Observed | None, N: int, n_loads: int) -> Observed | None:
    """Return the map from rows to outputs of all sectors; None if all are displacements.  Local."""
    if of_sector is None:
        return None
    n_outputs = len(of_sector.order)
    return Observed(np.tile(of_sector.order, N), np.kron(np.eye(N), of_sector.of_p), np.zeros((N * n_outputs, n_loads)))


def in_coordinates(modes: ProjectedModes, omega_n: np.ndarray, X: np.ndarray) -> ProjectedModes:
    """Return the combinations X (M, M) of some modes as modes with frequencies ``omega_n``.  Local."""
    C = None if modes.C is None else X.T @ modes.C @ X
    return ProjectedModes(omega_n, modes.R_phi @ X, X.T @ modes.b, modes.o @ X, C)


def of_sectors(disc: WholeDisc, structure: ReducedStructure, damping: ModalDamping | None) -> ReducedStructure:
    """Return the reduced structure with its sectors and the contact stiffness of each; the update is exact.  Collective."""
    structure, dK = replace(structure, n_sectors=disc.waves.n_sectors), disc.change_of_springs
    if not dK.any():
        receptance = structure.receptance_of(1)
        by_sectors = replace(receptance, sectors=sector_products(disc, receptance.modes.omega_n))
        return replace(structure, receptances=PerGroup.single(by_sectors))
    return with_springs(structure, SpringChange(dK, disc.pairs.law.stiffness.ravel(), damping))


def sector_products(disc: WholeDisc, omega_n: np.ndarray) -> SectorProducts:
    """Return products with the receptance of a disc of this contact stiffness in all sectors.  Collective: gathers."""
    modes = [each.projected.first(each.n_modes) for each in disc.tuned]
    R_phi, tuned_omega_n = [each.R_phi for each in modes], [each.omega_n for each in modes]
    columns = [_all_columns(each) for each in disc.tuned]
    return SectorProducts(disc.comm, disc.waves, columns, R_phi, tuned_omega_n, disc.of_tuned, omega_n**2)


# -- error bars ----------------------------------------------------------------------------------------------------


def truncated_of_all(disc: WholeDisc, parts: Sequence[TruncatedModes | None], receptance: Receptance) -> TruncatedModes | None:
    """Return the truncated modes of a whole disc from those of its nodal diameters; None if there are none.  Local.

    The samples of each diameter have a random phase, so that samples of different sectors are independent: eq. (17.4).
    """
    known = [part for part in parts if part is not None]
    if not known:
        return None
    waves, weights, N = disc.waves, disc.weights, disc.waves.n_sectors
    empty = replace(known[0], **{name: np.zeros_like(getattr(known[0], name)) for name in _ARRAYS})
    every = [part or empty for part in parts]
    n_samples, random = known[0].of_pairs.shape[1], np.random.default_rng(_KEY)
    turn = [
        random.choice([-1.0, 1.0], n_samples) if waves.is_real(d) else np.exp(2j * np.pi * random.random(n_samples))
        for d in waves.diameters
    ]

    def of_sectors(name: str) -> np.ndarray:
        blocks = waves.blocks([getattr(part, name) * phase for part, phase in zip(every, turn)])
        return np.sqrt(N) * blocks

    pairs, outputs, loads = (of_sectors(name) for name in ("of_pairs", "of_outputs", "of_loads"))
    of_loads = np.einsum("sl,slq->lq", weights, np.repeat(loads, 2, axis=1))
    spectrum = np.abs(np.fft.rfft(weights, axis=0)) ** 2
    drive_point = np.fft.irfft(spectrum * np.repeat([part.drive_point for part in every], 2, axis=1), n=N, axis=0)[0]
    direct = waves.response([_twice(part.direct) for part in every], weights)
    rows = np.concatenate([*pairs, *outputs, of_loads])
    whole = of_samples(receptance, rows, direct, np.maximum(drive_point, 0.0), known[0].damping, None)
    return replace(whole, omega=min(part.omega for part in known), highest=min(part.highest for part in known))


_ARRAYS = ("of_pairs", "of_outputs", "of_loads", "direct", "drive_point")


# -- fields --------------------------------------------------------------------------------------------------------


def displacements(disc: WholeDisc, model: ReducedModel, points: Sequence[ActingForces]) -> list[np.ndarray]:
    """Return the harmonics of u of all sectors on this rank's rows at some points, (n_owned N, N_H) each [m].

    Collective: for each nodal diameter, as many static solves as the points have coefficients, all at once.
    """
    N, n_owned = disc.waves.n_sectors, len(disc.tuned[0].modes.phi_owned)
    spectra = [_spectrum(disc, model.with_harmonics(Harmonics.full(point.p.shape[-1])), point) for point in points]
    fields = [np.zeros((point.p.shape[-1], n_owned, N)) for point in points]
    for each, back, *of_points in zip(disc.tuned, disc.waves.inverse, *spectra):
        forces = [each.load_forces(f) - each.pair_forces(p) for f, p, _ in of_points]
        moved = each.solve(np.hstack(forces)) + each.modes.phi_owned @ np.hstack([eta for *_, eta in of_points])
        forget_faces(each)
        columns = iter(moved.T)
        for field in fields:
            for of_sectors, u_d in zip(field, columns) if n_owned else ():
                dgemm(1.0, back.T, np.array([u_d.real, u_d.imag]), 1.0, of_sectors.T, overwrite_c=True)
    return [field.reshape(len(field), -1).T for field in fields]


def _spectrum(disc: WholeDisc, model: ReducedModel, point: ActingForces) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return loads (n_loads, N_H), forces of the pairs, and coordinates of the modes for each nodal diameter.  Collective."""
    waves, N, N_H = disc.waves, disc.waves.n_sectors, model.N_H
    f, p = point.level * model.f, point.p + _forces_of_other_springs(disc, model, point)
    updates = model.spring_updates
    receptance = model.receptance_of(1) if updates is None else updates.of(1).before
    c = receptance.modes.flexibility(model.harmonics, point.omega)
    q = receptance.modal_forces(f, p)
    eta = disc.of_tuned @ c.apply(q)
    if disc.has_other_blades:  # the static solution has the static part of the tuned modes
        static_share = disc.of_tuned @ (q / receptance.modes.omega_n[:, None] ** 2)
        eta = eta + static_share - _tuned_share(disc, f, p)
    of_sectors = (disc.weights[:, :, None] * f).reshape(N, -1, 2, N_H).sum(axis=2)
    f_d, p_d = np.fft.rfft(of_sectors, axis=0), np.fft.rfft(p.reshape(N, -1, N_H), axis=0)
    return zip(f_d, p_d, waves.spectrum(eta, [each.n_modes for each in disc.tuned]))


def forget_faces(stuck: StuckStructure) -> None:
    """Free the factor on the faces of a nodal diameter, if it is computed; computed again when needed.  Local."""
    if (solver := _solver_of(stuck)) is not None:
        solver.forget()


def _solver_of(stuck: StuckStructure) -> DiameterFactor | None:
    """Return the factor of a nodal diameter, if it is computed and shared with others.  Local."""
    solver = None if stuck.factored.value is None else stuck.factor.solver
    return solver if isinstance(solver, DiameterFactor) else None


def forget_all_faces(disc: Sequence[StuckStructure]) -> None:
    """Free the same of all nodal diameters, and what they share for proofs and static columns.  Local."""
    for solver in filter(None, map(_solver_of, disc)):
        solver.forget()
        solver.of_sector.forget()


def _forces_of_other_springs(disc: WholeDisc, model: ReducedModel, point: ActingForces) -> np.ndarray:
    """Return the forces of the differences in contact stiffness, (3 n_pairs, N_H) [N]; 0 without any.  Collective."""
    dK = disc.change_of_springs
    if not dK.any():
        return np.zeros_like(point.p)
    active = np.flatnonzero(point.p.reshape(disc.pairs.n_pairs, -1).any(axis=1))
    by_p = ReceptanceColumns(model, point.omega, active).apply(point.p[rows_of(active)]).reshape(-1, model.N_H)
    du = linear_motion(model, point.level, point.omega, slice(None)) - np.concatenate(model.comm.allgather(by_p))
    forces: np.ndarray = dK[:, None] * du
    return forces


def _tuned_share(disc: WholeDisc, f: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the static coordinates of the tuned modes under loads and forces of pairs, (M, N_H), by diameter.  Local."""
    alike = tuned_modes(disc.tuned, disc.waves, disc.weights)
    return (alike.b @ f - alike.R_phi.T @ p) / alike.omega_n[:, None] ** 2
