"""Full displacement fields from a converged point of the reduced model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..assembly.sectors import AllSectors
from ..fourier.amplitudes import matrix_times, to_complex, to_real
from ..fourier.harmonics import Harmonics
from ..receptance.motions import ActingForces
from ..receptance.receptance import Receptance
from ..receptance.reduced_model import ReducedModel
from .stuck import StuckStructure, project_rigid

if TYPE_CHECKING:
    from ..assembly.system import System
    from ..points.branch import Branch
    from .reduction import Reduction


def displacements(stuck: StuckStructure, model: ReducedModel, points: Sequence[ActingForces]) -> list[np.ndarray]:
    """Return the harmonics of u on this rank's rows at some points, (n_owned, N_H) each [m].

    Collective: static solves with N_H right-hand sides per point, all of a harmonic group at once.  u = K_L^-1 (f - R^H p) +
    phi c(omega) phi^H (f - R^H p), plus rigid-body motion; docs/theory.md, section 4.  The harmonics of the points may differ
    from those of the model.
    """
    full = [model.with_harmonics(Harmonics.full(p.shape[-1])) for _, _, p in points]
    fields: list[list[np.ndarray]] = [[] for _ in points]
    for group in {n: None for each in full for n in map(model.receptances.group_of, each.harmonics.chosen)}:
        of_group, at = stuck.per_group.of_group(group), []
        for i, ((level, omega, p), each) in enumerate(zip(points, full)):
            for part, c in zip(each.groups, each.flexibilities(omega)):
                if model.receptances.group_of(part.harmonics.chosen[0]) == group:
                    at.append((i, part, c, level * each.f[:, part.columns], p[:, part.columns]))
        static = _static_motions(of_group, [(f, p) for *_, f, p in at])
        for (i, part, c, f, p), u in zip(at, static):
            dynamic = matrix_times(of_group.modes.phi_owned, c.apply(part.receptance.modal_forces(f, p)))
            fields[i].append(u + dynamic + rigid_field(of_group, part.receptance, f, c.n_omega))
    return [each.joined(terms) for each, terms in zip(full, fields)]


def _static_motions(stuck: StuckStructure, at: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """Return K_L^-1 (f - R^H p), this rank's rows (n_owned, N_H) each, under coefficients f and p: all at once.

    A group with complex matrices has one right-hand side in real form per harmonic.
    """
    is_complex = stuck.is_complex
    amplitudes = [(to_complex(f), to_complex(p)) if is_complex else (f, p) for f, p in at]
    forces = [stuck.load_forces(f) - stuck.pair_forces(p) for f, p in amplitudes]
    if not forces:
        return []
    motions = np.split(stuck.solve(np.hstack(forces)), np.cumsum([force.shape[1] for force in forces])[:-1], axis=1)
    return [to_real(u, f.shape[1]) for u, (f, _) in zip(motions, at)] if is_complex else motions


def rigid_field(stuck: StuckStructure, receptance: Receptance, f: np.ndarray, n_omega: np.ndarray) -> np.ndarray:
    """Return the rigid-body motion of this rank's rows, (n_owned, N_H), under loads f (n_loads, N_H).

    A single zero, (1, 1), for a structure with supports.
    """
    if receptance.rigid is None or stuck.rigid is None:
        return np.zeros((1, 1))
    modes = stuck.factor.rigid
    here = project_rigid(stuck.system, modes)  # with the factor's modes, as stored ones may have other signs
    alpha = float((receptance.rigid.C - stuck.rigid.C)[0, 0])
    return modes.phi_owned @ here.with_damping(alpha).coordinates(f, n_omega)


def node_fields(system: System, owned: np.ndarray) -> np.ndarray | None:
    """Return fields per node, (n_nodes, 3, n_fields), in the order of Mesh.points, on rank 0 (None elsewhere).

    Collective: one gather.  ``owned`` (n_owned, n_fields) are this rank's rows; fixed DOFs are zero.
    """
    gathered = system.comm.gather(owned, root=0)
    if gathered is None:
        return None
    return system.at_nodes(np.concatenate(gathered))


def rest_at_nodes(system: System) -> np.ndarray | None:
    """Return the displacement at rest per node, (n_nodes, 3) [m], on rank 0, of a disc that of sector 0; None without statics.

    Collective: one gather.
    """
    if system.rest_owned is None:
        return None
    gathered = system.comm.gather(system.rest_owned)
    if gathered is None:
        return None
    at_nodes = system.at_nodes if system.sectors is None else system.sectors.rest_at_nodes
    u = at_nodes(np.concatenate(gathered))
    return u if system.moved is None else u + system.moved


def motions_at_nodes(system: System, owned: np.ndarray) -> np.ndarray | None:
    """Return the harmonics of a motion per node, (n_nodes, 3, N_H), on rank 0 (None elsewhere); for a wave, of sector 0.

    Collective: one gather, of all sectors one for each coefficient.  ``owned`` (n_owned, N_H) are the coefficients of this rank's
    rows, all harmonics from 0 on.
    """
    if system.sectors is None:
        return node_fields(system, owned)
    if not isinstance(system.sectors, AllSectors):
        gathered = system.comm.gather(owned, root=0)
        return None if gathered is None else system.sectors.at_nodes(np.concatenate(gathered))
    u = None
    for k in range(owned.shape[1]):  # memory: rows and nodes are those of all sectors
        gathered = system.comm.gather(owned[:, k : k + 1], root=0)
        if gathered is not None:
            of_k = system.sectors.at_nodes(np.concatenate(gathered))
            u = np.empty((*of_k.shape[:2], owned.shape[1])) if u is None else u
            u[..., k] = of_k[..., 0]
    return u


def peak_displacements(
    system: System, reduction: Reduction, model: ReducedModel, branches: Sequence[Branch]
) -> list[tuple[int, np.ndarray]]:
    """Return the number of each branch's point of largest response and the harmonics of u there, (n_nodes, 3, N_H) [m].

    Collective: all branches at once; fields as recorded on rank 0, empty elsewhere.  Every branch must have points.
    """
    peaks = [branch.peak for branch in branches]
    at = [(branch, branch.points[peak]) for branch, peak in zip(branches, peaks)]
    forces = [model.comm.bcast(point.p) for _, point in at]
    points = [ActingForces(branch.level, point.omega, p.reshape(-1, p.shape[-1])) for (branch, point), p in zip(at, forces)]
    fields = (motions_at_nodes(system, u_owned) for u_owned in reduction.displacements(model, points))
    return [(peak, np.empty((0, 3, 0)) if u is None else u) for peak, u in zip(peaks, fields)]
