"""The story of a modal analysis: assemble, factor, lowest modes with proof, what moves in them, table and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...library.build import Assembled, assembled, factor_of, without_reference
from ...library.settings import reduction_settings
from ...linear.dense import gram, multiply
from ...modes.eigen import lowest_modes
from ...observe.log import RunLog
from ...parallel.agree import on_root
from ...reduction.expand import node_fields
from ...reduction.modal_structure import damped_modes
from ...reduction.stuck import project_modes
from ...scene.read import changed
from ...system.versions import versions
from .report import ModeTable, write_modes_of

if TYPE_CHECKING:
    from mpi4py import MPI

    from ...assembly.system import System
    from ...linear.joint_springs import Linearised
    from ...modes.eigen import Modes
    from ...scene.schema import Scene

COUNT = 12  # modes where none are stated


def modes(scene: Scene, comm: MPI.Comm, folder: Path, count: int | None = None, options: tuple[str, ...] = ()) -> None:
    """Compute the lowest modes of a scene with all pairs stuck; write modes.csv, modes.png and modes.vtkhdf.

    Collective on ``comm``.  ``count`` takes the place of [solver] modes; where neither is stated, there are 12.  With
    [statics] they are those about the state of rest.

    Raises
    ------
    CaseError, MeshError, ResourceError, ConvergenceError : on every rank
    """
    facts = {"scene": scene.source, "PETSc options": " ".join(options) or "none", **versions()}
    with RunLog(comm, str(folder / "modes.log"), facts=facts) as log:
        scene = changed(scene, {"solver": {"method": "receptance"} | ({} if count is None else {"modes": count})})
        parts = without_reference(assembled(scene, comm, log), False)
        linearised = factor_of(parts, log)
        n_modes = scene.solver.modes or min(COUNT, linearised.system.n_dof)
        with log.stage("modes"):
            computed = lowest_modes(linearised, n_modes, scene.solver.verify_modes, fewer_will_do=scene.solver.modes is None)
        table = mode_table(parts, linearised, computed)
        has_mesh = linearised.system.dof is not None
        shapes = node_fields(linearised.system, computed.phi_owned) if has_mesh else None
        with log.stage("table and pictures"):
            text = on_root(comm, write_modes_of, table, parts.mesh, shapes, scene, folder)
        log.note(text)
        log.note(_proof(computed))
        log.note(f"results in {folder}")
        linearised.destroy()
        linearised.system.destroy()


def mode_table(parts: Assembled, linearised: Linearised, computed: Modes) -> ModeTable:
    """Return what is told of each mode.  Collective: a sum or two.

    The effective mass of a mode along an axis is (phi^T M r)^2, with r a unit translation of all that is not held; all modes
    together have the mass r^T M r that moves.  The share of a joint is that of its springs in the strain energy, the sum of
    k (R phi)^2 / omega_n^2 over its pairs: the relative change of omega_n^2 with the stiffness of the joint.
    """
    system, pairs = linearised.system, parts.rest.pairs
    projected = project_modes(system, computed.omega_n, computed.phi_owned)
    K_J = pairs.law.stiffness.ravel()
    energy = (K_J[:, None] * projected.R_phi**2).reshape(pairs.n_pairs, 3, -1).sum(axis=1) / computed.omega_n**2
    names = np.array(pairs.joint, dtype=str)
    joints = {name: energy[names == name].sum(axis=0) for name in dict.fromkeys(pairs.joint)}
    settings = reduction_settings(parts.scene)
    damping = damped_modes(projected, K_J, settings.damping).zeta
    mass, total = None, None
    if system.dof is not None:
        r_owned = _translations(system)[slice(*system.M.getOwnershipRange())]
        Mr_owned = multiply(system.M, r_owned)
        mass, total = gram(system.comm, computed.phi_owned, Mr_owned) ** 2, np.diag(gram(system.comm, r_owned, Mr_owned))
    return ModeTable(computed.frequency, damping, joints, mass, total)


def _translations(system: System) -> np.ndarray:
    """Return a unit translation along x, y and z of all nodes and points that are not held, (n_dof, 3).  Local."""
    places = system.dof
    if system.constraints is not None:
        free, n_points = system.constraints.free, len(system.constraints.points)
        n_nodes = len(free) - 2 * n_points
        places = np.concatenate([free[:n_nodes], free[n_nodes::2]])
    assert places is not None, "a structure with a mesh"
    r = np.zeros((system.n_dof, 3))
    for axis, rows in enumerate(places.T):
        r[rows[rows >= 0], axis] = 1.0
    return r


def _proof(computed: Modes) -> str:
    """Say whether no mode is missing."""
    if "proof" in computed.info:
        return f"proved complete by the inertia of K_L - sigma M: {computed.info['proof']}"
    if computed.info.get("complete", True):
        return "computed from the whole spectrum: none is missing"
    return "not proved complete: [solver] verify_modes = false"
