"""Build a structure once: mesh or matrices, pairs, the factor of the stuck structure, its static response and lowest modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from ..assembly.assemble import assemble
from ..assembly.matrices import distribute_structure, read_structure
from ..assembly.prestress import constant_forces, stiffness_at_rest
from ..assembly.pretension import pretension
from ..assembly.system import System
from ..formats.model import FileModel
from ..linear.contact_outputs import with_contact_forces
from ..linear.joint_springs import Linearised, linearise
from ..mesh.data import ContactPairs, DistributedMesh, Mesh
from ..mesh.pairing import pair_contacts
from ..mesh.partition import distribute
from ..mesh.read import read_mesh
from ..mesh.settings import MeshSettings
from ..modes.eigen import Modes
from ..modes.limits import refuse_too_many
from ..observe.log import RunLog
from ..parallel.agree import on_root
from ..parallel.petsc import everyone
from ..reduction.choose_modes import choose_modes
from ..reduction.methods import check_size
from ..reduction.stuck import StuckStructure, static_response
from ..scene.schema import Scene
from ..statics.bolts import BoltsAtRest
from ..statics.equilibrium import equilibrium
from ..statics.flight import which_flies
from ..statics.pressed import check_pressed
from ..statics.rest import at_rest, in_words
from .complete import read_completed
from .memory import of_factor, refuse_modes
from .settings import matrix_settings, mesh_settings, outputs, reduction_settings

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True, eq=False)
class Structure(StuckStructure):
    """The stuck structure of a scene."""

    scene: Scene
    mesh: Mesh | None  # rank 0 only; None of a scene given as matrices whose rows belong to no nodes
    bolts: BoltsAtRest | None = None

    @property
    def comm(self) -> MPI.Comm:
        return self.linearised.system.comm

    def close(self) -> None:
        """Free the factor.  Collective."""
        self.linearised.destroy()

    def __enter__(self) -> Structure:
        return self

    def __exit__(self, *_) -> None:
        self.close()


def build(
    scene: Scene,
    comm: MPI.Comm | None = None,
    log: RunLog | None = None,
    known_modes: Callable[[Linearised], Modes] | None = None,
) -> Structure:
    """Return the structure with all pairs stuck, factored, and its lowest modes.

    Collective on ``comm``, by default all ranks.  Without a ``log`` nothing is said.  ``known_modes`` returns those that an
    earlier call has found, collectively.

    Raises
    ------
    CaseError, MeshError, ResourceError : on every rank
    """
    comm = comm or everyone()
    log = log or RunLog(comm, screen=False)
    if scene.model.mesh is None:
        mesh, system, pairs, bolts = from_matrices(scene, comm, log)
    else:
        with log.stage("model file"):
            file, scene, notes = read_completed(scene, comm)
        for note in notes:
            log.note(note)
        mesh, system, pairs, bolts = from_mesh(scene, file, comm, log)
    settings = reduction_settings(scene)
    system = with_contact_forces(system, pairs, outputs(scene))
    log.note(f"{system.n_dof} DOF, {pairs.n_pairs} contact pairs")
    refuse_too_many(settings.modes, system.n_dof, scene.path)
    check_size(settings, system)
    with log.stage("factor of the stuck structure"):
        linearised = linearise(system, pairs, str(scene.path))
    for note in (*linearised.factor.info["said"], of_factor(linearised.factor.info)):
        log.note(note)
    if known_modes is None:
        refuse_modes(linearised, settings)
    with log.stage("modes"):
        statics = static_response(linearised)
        modes, why = choose_modes(linearised, pairs, statics, settings) if known_modes is None else (known_modes(linearised), "")
    for note in filter(None, (*modes.info.get("said", ()), why)):
        log.note(note)
    return Structure(linearised, pairs, statics, modes, scene, mesh, bolts)


def from_mesh(
    scene: Scene, file: FileModel | None, comm: MPI.Comm, log: RunLog
) -> tuple[Mesh | None, System, ContactPairs, BoltsAtRest | None]:
    """Return mesh (on rank 0), matrices, pairs and bolts of a scene with a mesh, whose file rank 0 has read.  Collective."""
    settings = mesh_settings(scene)
    with log.stage("mesh and contact pairs"):
        mesh = on_root(comm, read_mesh, settings, file, share=False)
        pairs = on_root(comm, pair_contacts, mesh, settings.joints)
    for note in (*on_root(comm, lambda: mesh.notes), *pairs.notes):
        log.note(note)
    with log.stage("partition"):
        shares = distribute(mesh, settings, comm)
    with log.stage("assembly"):
        system = assemble(shares, mesh, pairs, settings)
    for note in system.constraints.notes if system.constraints is not None else ():
        log.note(note)
    bolts = None
    if settings.statics is not None:
        system, pairs, bolts = brought_to_rest(system, shares, mesh, pairs, settings, log, str(scene.path))
    return mesh, system, pairs, bolts


def brought_to_rest(
    system: System,
    shares: DistributedMesh,
    mesh: Mesh | None,
    pairs: ContactPairs,
    settings: MeshSettings,
    log: RunLog,
    where: str,
) -> tuple[System, ContactPairs, BoltsAtRest | None]:
    """Return the structure, its pairs and bolts as they vibrate about their rest under the constant loads.  Collective.

    Raises
    ------
    CaseError, ConvergenceError, MeshError, ResourceError : on every rank
    """
    statics = settings.statics
    assert statics is not None, "a scene with [statics]"
    with log.stage("statics"):
        forces = constant_forces(shares, mesh, settings, system)
        bolts = pretension(shares, mesh, settings, system)
        linearised = linearise(system, pairs, where)
        flies = partial(which_flies, system, mesh, pairs, forces, settings.body_of)
        rest = equilibrium(linearised, pairs, forces, statics.steps, bolts, flies, where)
        linearised.destroy()
        check_pressed(system, mesh, pairs, rest, forces, settings.body_of, where)
        seen = None if bolts is None or rest.bolts is None else partial(bolts.overlap.seen, shortening=rest.bolts.shortening)
        K = stiffness_at_rest(shares, settings, system, rest.u_owned, seen) if statics.stiffens else system.K
    for line in in_words(system, mesh, pairs, rest, forces, settings.body_of):
        log.note(line)
    return replace(system, K=K, rest_owned=rest.u_owned), at_rest(pairs, rest), rest.bolts


def from_matrices(scene: Scene, comm: MPI.Comm, log: RunLog) -> tuple[Mesh | None, System, ContactPairs, None]:
    """Return nodes (on rank 0, where there are any), matrices and pairs of a scene given as matrices.  Collective."""
    settings = matrix_settings(scene)
    with log.stage("matrices and contact pairs"):
        given = on_root(comm, read_structure, settings, share=False)
        system, pairs = distribute_structure(given, settings, comm)
    for note in on_root(comm, lambda: given.notes):
        log.note(note)
    return (None if given is None else given.mesh), system, pairs, None
