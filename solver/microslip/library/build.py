"""Build a structure once: mesh or matrices, pairs, the factor of the stuck structure, its static response and lowest modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..assembly.assemble import assemble
from ..assembly.matrices import distribute_structure, read_structure
from ..formats.model import FileModel
from ..linear.contact_outputs import with_contact_forces
from ..linear.factor import KnownFactor
from ..linear.joint_springs import Linearised, joint_stiffness, linearise
from ..mesh.data import ContactPairs, Mesh
from ..mesh.pairing import pair_contacts
from ..mesh.partition import distribute
from ..mesh.read import read_mesh
from ..modes.eigen import Modes
from ..modes.limits import refuse_too_many
from ..observe.log import RunLog
from ..parallel.agree import on_root
from ..parallel.petsc import everyone
from ..reduction.choose_modes import choose_modes
from ..reduction.memory_of_modes import memory_of_modes, refuse_modes
from ..reduction.methods import check_size, keeps_to_K_L
from ..reduction.stuck import Factored, StuckStructure, static_response
from ..scene.schema import Scene
from ..statics.balance import Balance
from ..statics.bolts import BoltsAtRest
from ..statics.reference_state import AtRest, ReferenceState, find_rest
from ..system.memory import gigabytes
from .complete import read_completed
from .dropped import free_dropped, free_if_dropped
from .settings import reduction_settings

if TYPE_CHECKING:
    from mpi4py import MPI

_OTHER_REST = "other rest"  # of what a structure keeps


@dataclass(frozen=True, eq=False)
class Known:
    """What an earlier run has found of a structure."""

    modes: Callable[[Linearised], Modes]  # collective
    factor: KnownFactor | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Structure(StuckStructure):
    """The stuck structure of a scene."""

    scene: Scene
    mesh: Mesh | None  # rank 0 only; None of a scene given as matrices whose rows belong to no nodes
    bolts: BoltsAtRest | None = None
    balance: Balance | None = None  # of forces at rest, with [statics]
    reference: ReferenceState | None = None  # with [statics]: before its loads act

    def close(self) -> None:
        """Free the factors and the matrices.  Collective."""
        free_other_rest(self)
        system = self.linearised.system
        if self.reference is not None:
            self.reference.close()
            self.reference.system.destroy(system)
        self.linearised.destroy()
        system.destroy()

    def refuse_closed(self) -> None:
        """Raise CaseError once the factors are freed: PETSc would end the process.  Local; the same on every rank."""
        _ = self.linearised.factor.solver

    def __enter__(self) -> Structure:
        return self

    def __exit__(self, *_) -> None:
        self.close()


def build(
    scene: Scene,
    comm: MPI.Comm | None = None,
    log: RunLog | None = None,
    known: Known | None = None,
    keeps_reference: bool = True,
) -> Structure:
    """Return the structure with all pairs stuck, factored, and its lowest modes.

    Collective on ``comm``, by default all ranks.  Without a ``log`` nothing is said.  What an earlier run has found may be
    ``known``.  With [statics], what finds another rest is kept, unless ``keeps_reference`` is False: K before the loads act, and
    the mesh.  The memory of structures that were dropped without being closed is freed first.

    Raises
    ------
    CaseError, MeshError, ResourceError : on every rank
    """
    comm = comm or everyone()
    log = log or RunLog(comm, screen=False)
    free_dropped(comm)
    if scene.model.mesh is None:
        mesh, rest, reference = *from_matrices(scene, comm, log), None
    else:
        with log.stage("model file"):
            file, scene, notes = read_completed(scene, comm)
        for note in notes:
            log.note(note)
        mesh, rest, reference = from_mesh(scene, file, comm, log)
    if reference is not None and not keeps_reference:
        reference.system.destroy(rest.system)  # its memory before the factor's
        reference = None
    return stuck_structure(scene, mesh, rest, log, known, reference)


def stuck_structure(
    scene: Scene,
    mesh: Mesh | None,
    rest: AtRest,
    log: RunLog,
    known: Known | None = None,
    reference: ReferenceState | None = None,
) -> Structure:
    """Return the structure as it vibrates about its rest: factored, with its static response and its modes.  Collective.

    Raises
    ------
    CaseError, ResourceError : on every rank
    """
    settings, pairs = reduction_settings(scene), rest.pairs
    system = with_contact_forces(rest.system, pairs, scene.outputs)
    log.note(f"{system.n_dof} DOF, {pairs.n_pairs} contact pairs")
    refuse_too_many(settings.modes, system.n_dof, scene.path)
    check_size(settings, system)
    with log.stage("factor of the stuck structure"):
        later = None if known else partial(memory_of_modes, system.K, settings)
        linearised = linearise(system, pairs, str(scene.path), later, known.factor if known else None)
    for note in (*linearised.factor.info["said"], factor_in_words(linearised.factor.info)):
        log.note(note)
    if linearised.factor.info.get("out_of_core") and reference is None and keeps_to_K_L(settings):
        linearised.let_K_go()  # memory is short
    if not known:
        refuse_modes(linearised, settings)
    with log.stage("modes"):
        statics = static_response(linearised)
        stuck = StuckStructure.of(linearised, pairs, statics)
        modes, why = (known.modes(linearised), "") if known else choose_modes(stuck, settings)
    for note in filter(None, (*modes.info.get("said", ()), why)):
        log.note(note)
    free_if_dropped(linearised.system.comm, linearised.factor)
    of_scene = {"scene": scene, "mesh": mesh, "bolts": rest.bolts, "balance": rest.balance, "reference": reference}
    return Structure.of(linearised, pairs, statics, modes, **of_scene)


def factor_in_words(info: dict[str, Any]) -> str:
    """Return what a factor took beside what was foreseen, in words.  Local."""
    memory = info.get("memory")
    if memory is None:
        return f"factor by {info['package']}, which PETSc calls"
    by = f" by {info['interface']}'s interface to MUMPS" if "interface" in info else ""
    if "kept_in" in info:
        size = gigabytes(1e6 * info["memory_MB"])
        return f"factor: that of an earlier run, {info['entries']} entries, {size} in {info['kept_in']}"
    foreseen = memory.out_of_core if info["out_of_core"] else memory.in_core
    return (
        f"factor{by}: {info['entries']} entries, ordered by {info['ordering']}; memory {info['memory_MB']} MB on all ranks, "
        f"{info['memory_max_MB']} MB on the largest (foreseen on rank 0: {foreseen / 1e6:.0f} MB)"
    )


def at_another_rest(structure: Structure, scene: Scene, pairs: ContactPairs) -> tuple[Structure, tuple[str, ...]]:
    """Return a structure at the rest that it comes to with other ``pairs``, as ``scene`` states them, and what a log says of it.

    Collective.  The last one is kept: the factor of the one before is freed.  Mesh, matrices and constant forces are those there
    are; factor and static columns of the reference structure are made for the first other rest, and kept.  Where the rest leaves
    stiffness and springs what they are for ``structure``, its factor, modes and all that was made of them serve on.

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : on every rank
    """
    assert structure.reference is not None, "a structure that keeps it"
    key, own = ((one.mu.tobytes(), one.N0.tobytes()) for one in (pairs, structure.reference.pairs))
    if key == own:
        return structure, ()
    if structure.kept.get(_OTHER_REST, (None,))[0] != key:
        structure.refuse_closed()
        free_other_rest(structure)
        free_dropped(structure.comm)
        known, log = structure.linearised, RunLog(structure.comm, screen=False)
        rest = find_rest(structure.reference, pairs, known.system)
        if rest.system.K is known.system.K and np.array_equal(joint_stiffness(rest.pairs), joint_stiffness(structure.pairs)):
            linearised = replace(known, system=replace(known.system, rest_owned=rest.system.rest_owned))
            factored = Factored(linearised, structure.modes)
            found = replace(
                structure, factored=lambda: factored, pairs=rest.pairs, scene=scene, bolts=rest.bolts, balance=rest.balance
            )
        else:
            found = stuck_structure(scene, structure.mesh, rest, log)
        structure.kept[_OTHER_REST] = key, found, (*rest.said, *log.notes)
    _, found, notes = structure.kept[_OTHER_REST]
    return found, notes


def free_other_rest(structure: Structure) -> None:
    """Free the factor and the stiffness of the structure at another rest, if it has its own.  Collective."""
    known = structure.kept.pop(_OTHER_REST, None)
    if known is None or known[1].linearised.factor is structure.linearised.factor:
        return
    assert structure.reference is not None, "a structure that keeps it"
    at_rest, reference = known[1].linearised, structure.reference.system
    at_rest.destroy()
    if at_rest.system.K is not reference.K:
        at_rest.system.destroy(structure.linearised.system)


def from_mesh(
    scene: Scene, file: FileModel | None, comm: MPI.Comm, log: RunLog
) -> tuple[Mesh | None, AtRest, ReferenceState | None]:
    """Return mesh (on rank 0) and structure of a scene with a mesh, whose file rank 0 has read.  Collective.

    With [statics] it is that at rest, and what was there before comes with it.
    """
    with log.stage("mesh and contact pairs"):
        mesh = on_root(comm, read_mesh, scene, file, share=False)
        pairs = on_root(comm, pair_contacts, mesh, scene.joints)
    for note in (*on_root(comm, lambda: mesh.notes), *pairs.notes):
        log.note(note)
    with log.stage("partition"):
        shares = distribute(mesh, scene, comm)
    with log.stage("assembly"):
        system = assemble(shares, mesh, pairs, scene)
    for note in (*(system.constraints.notes if system.constraints is not None else ()), *system.notes):
        log.note(note)
    if scene.statics is None:
        return mesh, AtRest(system, pairs), None
    with log.stage("statics"):
        reference = ReferenceState.of(system, shares, mesh, pairs, scene, str(scene.path))
        rest = find_rest(reference, reference.pairs)
        reference.close()
    for line in rest.said:
        log.note(line)
    return mesh, rest, reference


def from_matrices(scene: Scene, comm: MPI.Comm, log: RunLog) -> tuple[Mesh | None, AtRest]:
    """Return nodes (on rank 0, where there are any) and structure of a scene given as matrices.  Collective."""
    with log.stage("matrices and contact pairs"):
        given = on_root(comm, read_structure, scene, share=False)
        system, pairs = distribute_structure(given, scene, comm)
    for note in on_root(comm, lambda: given.notes):
        log.note(note)
    return (None if given is None else given.mesh), AtRest(system, pairs)
