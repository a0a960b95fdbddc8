"""The story of a run: one call a stage, from the scene to the response and its pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .assembly.assemble import assemble
from .assembly.check import check_elements
from .assembly.matrices import distribute_structure, read_structure
from .assembly.system import System
from .continuation.levels import follow_levels, response_problem
from .error_estimate.better_model import BetterModel, better_model_of
from .library.response_settings import response_settings
from .linear.joint_springs import Linearised, linearise
from .mesh.data import ContactPairs, Mesh
from .mesh.pairing import pair_contacts
from .mesh.partition import distribute
from .mesh.read import read_mesh
from .modes.eigen import Modes
from .modes.limits import refuse_too_many
from .observe.level_log import LevelLog
from .observe.log import RunLog
from .observe.not_computed import not_computed
from .observe.observer import Observers
from .observe.side_by_side import follow_side_by_side
from .parallel.agree import on_each, on_root
from .parallel.errors import ConvergenceError
from .parallel.versions import versions
from .reduction.choose_modes import choose_modes
from .reduction.expand import node_fields, peak_displacement
from .reduction.methods import check_size, reduce_by_method
from .reduction.reduction import Reduction
from .results.audit import audit_text
from .results.measures import shown_with
from .results.plots import draw_all
from .results.record import LinearCurve
from .results.vtk import peak_fields, write_fields, write_modes
from .results.writer import ResultWriter
from .studies.check import needs, needs_of_matrices


@dataclass(frozen=True)
class Structure:
    """The linearised structure and its contact pairs."""

    mesh: Mesh | None  # rank 0 only; None of a scene given as matrices
    pairs: ContactPairs
    linearised: Linearised
    modes: Modes


def run(scene, comm, folder: Path, options: tuple[str, ...] = (), n_groups: int = 1, screen: bool = True) -> None:
    """Solve one scene, from mesh or matrices to response and pictures.

    Collective on ``comm``, whose ranks part into ``n_groups`` for the levels.  Without ``screen`` only files are written.

    Raises
    ------
    CaseError, ResourceError : on every rank, before anything is solved or as soon as it is known
    ConvergenceError : a level ended early, after everything that converged was written and drawn; on every rank
    """
    facts = {"scene": str(scene.path), "method": scene.solver.method, "PETSc options": " ".join(options) or "none", **versions()}
    with RunLog(comm, str(folder / "run.log"), screen=screen, facts=facts) as log:
        structure = build_structure(scene, comm, log)
        with log.stage("reduction"):
            reduction = reduce_by_method(structure.linearised, structure.modes, structure.pairs, scene)
            has_bars = scene.solver.error_bars and scene.harmonics > 0
            better = better_model_of(structure.linearised, structure.modes, reduction, scene) if has_bars else None
        with log.stage("response"):
            branches = follow(scene, structure, reduction, folder, options, log, n_groups, better)
        with log.stage("fields for ParaView"):
            write_shapes(structure, reduction, branches, folder)
        with log.stage("pictures"):
            on_each(comm, draw_all, str(folder / "results.h5"), str(folder), slice(comm.rank, None, comm.size))
        log.note(f"results in {folder}")
        structure.linearised.destroy()
    failed = [branch for branch in branches if branch.failure]
    if failed:
        raise ConvergenceError(
            "\n".join(f"level {branch.level:g} N ends after {len(branch.points)} points: {branch.failure}" for branch in failed)
            + f"\nwhat converged is in {folder}"
        )


def build_structure(scene, comm, log: RunLog) -> Structure:
    """Return the structure with all pairs stuck, factored, and its lowest modes.  Collective."""
    mesh, system, pairs = (from_matrices if scene.model.mesh is None else from_mesh)(scene, comm, log)
    log.note(f"{system.n_dof} DOF, {pairs.n_pairs} contact pairs")
    refuse_too_many(scene.solver.modes, system.n_dof, scene.path)
    check_size(scene, system.n_dof, system.R.shape[0], comm)
    with log.stage("factor of the stuck structure"):
        linearised = linearise(system, pairs, str(scene.path))
    with log.stage("modes"):
        modes, why = choose_modes(linearised, pairs, scene)
    log.note(why)
    return Structure(mesh, pairs, linearised, modes)


def from_mesh(scene, comm, log: RunLog) -> tuple[Mesh | None, System, ContactPairs]:
    """Return mesh (on rank 0), matrices and pairs of a scene with a mesh.  Collective."""
    with log.stage("mesh and contact pairs"):
        mesh = on_root(comm, read_mesh, scene, share=False)
        pairs = on_root(comm, pair_contacts, mesh, scene.joints)
    for note in on_root(comm, lambda: mesh.notes):
        log.note(note)
    with log.stage("partition"):
        shares = distribute(mesh, scene, comm)
    with log.stage("assembly"):
        system = assemble(shares, mesh, pairs, scene, comm)
    return mesh, system, pairs


def from_matrices(scene, comm, log: RunLog) -> tuple[None, System, ContactPairs]:
    """Return matrices and pairs of a scene given as matrices.  Collective."""
    with log.stage("matrices and contact pairs"):
        given = on_root(comm, read_structure, scene, share=False)
        system, pairs = distribute_structure(given, scene, comm)
    return None, system, pairs


def follow(
    scene,
    structure: Structure,
    reduction: Reduction,
    folder: Path,
    options,
    log: RunLog,
    n_groups: int = 1,
    better: BetterModel | None = None,
) -> list:
    """Return the branches of all levels, with error bars where a ``better`` is given; write and log each point as it comes.

    Collective.
    """
    pairs, model, comm = structure.pairs, reduction.model, reduction.model.comm
    settings, omega_n = response_settings(scene), structure.modes.omega_n
    response = response_problem(settings, model, pairs.law, reduction.selection, omega_n, better)
    writer = ResultWriter(
        comm,
        str(folder),
        scene,
        pairs,
        N_H=model.recorded.n_coefficients,
        omega_n=omega_n,
        versions=versions(),
        options=options,
        linear=LinearCurve(response.curve.omega / (2.0 * np.pi), response.curve.response),
        node_numbers=None if structure.mesh is None else structure.mesh.numbers,
    )
    levels, known, shown = settings.levels, None, shown_with(model.harmonics.highest)
    observers = Observers(comm, levels, [LevelLog(log, response.sweep, len(levels), shown), writer])
    try:
        if min(n_groups, len(levels)) == 1:
            branches = follow_levels(response, observers.tell)
            columns = model.G_static
            known = columns.known if better is None else columns.known | better.model.G_static.known
            log.note(f"static columns: of {columns.known.sum()} of {model.n_pairs} pairs, in {columns.batches} batches")
        else:
            branches = follow_side_by_side(response, n_groups, observers, log)
            writer.put_in_order(branches)
    finally:
        writer.close()
    log.note(audit_text(branches))
    system = structure.linearised.system
    lines = not_computed(
        scene,
        leaves_out=reduction.leaves_out,
        omega_n=structure.modes.omega_n,
        n_dof=system.n_dof,
        known=known,
        branches=branches,
        has_mesh=system.dof is not None,
        is_static=shown.is_static,
    )
    log.note("\n  ".join(["not computed, and why, or what it would change:", *lines]))
    return branches


def write_shapes(structure: Structure, reduction: Reduction, branches, folder: Path) -> None:
    """Write the modes and the motion at the peak of every level on the mesh.  Collective; rank 0 writes."""
    system = structure.linearised.system
    comm = system.comm
    if system.dof is None:
        return
    shapes = node_fields(system, structure.modes.phi_owned)
    on_root(comm, _write_modes, structure, shapes, folder, share=False)
    fields: dict[str, np.ndarray] = {}
    for branch in branches:
        frequency, u = peak_displacement(system, reduction, branch)
        if u is not None:
            fields.update(peak_fields(branch.level, frequency, u))
    on_root(comm, write_fields, str(folder / "peak_response.vtkhdf"), structure.mesh, fields, share=False)


def _write_modes(structure: Structure, shapes, folder: Path) -> None:
    assert structure.mesh is not None, "called on rank 0 of a scene with a mesh"
    write_modes(str(folder / "modes.vtkhdf"), structure.mesh, structure.modes.omega_n, np.moveaxis(shapes, -1, 0))


def check(scene, comm) -> None:
    """Read mesh and pairs, or matrices, check them, and print what a run will need; nothing is solved.

    Collective on ``comm``.

    Raises
    ------
    CaseError, MeshError : on every rank
    """
    if scene.model.mesh is None:
        lines = on_root(comm, lambda: needs_of_matrices(scene, read_structure(scene)))
    else:
        mesh = on_root(comm, read_mesh, scene, share=False)
        pairs = on_root(comm, pair_contacts, mesh, scene.joints)
        check_elements(distribute(mesh, scene, comm), scene)
        lines = on_root(comm, needs, scene, mesh, pairs)
    if comm.rank == 0:
        print("\n".join(lines))
