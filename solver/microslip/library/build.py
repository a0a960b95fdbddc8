"""Build a structure once: mesh or matrices, pairs, the factor of the stuck structure, its static response and lowest modes."""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..assembly.assemble import assemble
from ..assembly.matrices import distribute_structure, read_structure
from ..assembly.real_form import real_columns
from ..assembly.sectors import Sectors
from ..formats.model import FileModel
from ..linear.contact_outputs import with_contact_forces
from ..linear.factor import FactorCache
from ..linear.joint_springs import Linearised, joint_stiffness, linearise
from ..linear.lockstep import in_lockstep
from ..linear.soft_modes import SoftModes
from ..mesh.data import ContactPairs, Mesh
from ..mesh.pairing import pair_contacts
from ..mesh.partition import distribute
from ..mesh.read import read_mesh
from ..mesh.sector_factors import SectorFactors, factors_of, notes_on_sectors, pairs_of_all_sectors
from ..messages.errors import CaseError
from ..messages.words import counted
from ..modes.eigen import Modes
from ..modes.limits import refuse_too_many
from ..observe.log import RunLog
from ..parallel.agree import on_root
from ..parallel.petsc import everyone, free
from ..points.band import frequency_band
from ..receptance.circulant import Waves
from ..receptance.per_group import PerGroup
from ..reduction.choose_modes import choose_modes
from ..reduction.memory_of_modes import PICKED, diameters_together, memory_of_diameter, memory_of_modes, refuse_modes
from ..reduction.methods import check_size, keeps_to_K_L
from ..reduction.mistuning import FORMS, BladeForms, blade_forms, with_first_modes, with_static_shapes
from ..reduction.stuck import Factored, ModesOf, OnDemand, StuckStructure, static_response
from ..reduction.whole_disc import WholeDisc, forget_all_faces, of_all_sectors, with_other_blades
from ..results.whole_disc import turns, whole_numbers
from ..scene.schema import Scene
from ..statics.balance import Balance
from ..statics.bolts import BoltsAtRest
from ..statics.equilibrium import Flexibility
from ..statics.reference_state import AtRest, ReferenceState, find_rest
from ..system.memory import gigabytes, give_back
from ..tables.cyclic import Cyclic
from .complete import completed_scene, read_completed
from .dropped import free_dropped, free_if_dropped
from .settings import reduction_settings

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..assembly.system import System

_OTHER_REST = "other rest"  # key of the cached state


@dataclass(frozen=True, eq=False, kw_only=True)
class Structure(StuckStructure):
    """The stuck structure of a scene."""

    scene: Scene
    has_mesh: bool  # else its matrices belong to no nodes
    numbers: np.ndarray | None = None  # (n_nodes,) the user's, of ``mesh.points``; on rank 0 of a scene with a mesh
    bolts: BoltsAtRest | None = None
    balance: Balance | None = None  # of forces at rest, with [statics]
    reference: ReferenceState | None = None  # with [statics]: before its loads act

    @property
    def mesh(self) -> Mesh | None:
        """The mesh on rank 0, where there is one; None elsewhere.  Collective where the structure must be assembled first."""
        return self.factored().mesh

    def pair_flexibility(self) -> Flexibility:
        """Return R K_L^-1 R^T for equilibria of the joint.  Collective if the structure must be assembled first."""
        return Flexibility(self.linearised)

    def with_sectors(self, scene: Scene) -> Structure:
        """Return the disc of another scene: :meth:`WholeStructure.with_sectors`.  Raises CaseError: no disc of such sectors."""
        raise CaseError(
            f"{scene.source}: with_sectors: the structure is no disc whose sectors may differ; build it of a scene with whole = "
            "true in [cyclic]"
        )

    def close(self) -> None:
        """Free the factors and the matrices, if there are any.  Collective."""
        groups = [stuck.factored.value.linearised for stuck in self.computed_groups.values() if stuck.factored.value is not None]
        if not groups:
            return
        free_other_rest(self)
        if self.reference is not None:
            self.reference.close(self.linearised.system)
            self.reference.system.destroy(self.linearised.system)
        for linearised in groups:
            linearised.destroy()
            linearised.system.destroy()
        if groups[0].system.sectors is not None:
            groups[0].system.sectors.destroy()

    def refuse_closed(self) -> None:
        """Raise CaseError once the factors are freed: PETSc would end the process.  Local; the same on every rank."""
        if self.factored.value is not None:
            _ = self.factored.value.linearised.factor.solver

    def __enter__(self) -> Structure:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@dataclass(frozen=True, eq=False, kw_only=True)
class WholeStructure(WholeDisc, Structure):
    """The stuck structure of a scene whose disc has sectors that may differ."""

    alike: Structure  # of the same disc with alike sectors, from one sector

    shares: bool = False  # whether factor and matrices are those of another structure, which frees them

    def with_sectors(self, scene: Scene) -> WholeStructure:
        """Return the disc of a scene that differs from this one in its sectors alone, with the same factor, modes and columns.

        Collective: small matrices of all modes.  Valid until this structure is closed.

        Raises
        ------
        CaseError : the scene differs in more, or its blades differ and those of this disc do not; invalid factors; on every rank
        """
        scene = completed_scene(scene, self.comm)
        if not self.shares_modes_with(scene):
            raise CaseError(
                f"{scene.source}: with_sectors: only scatter, sector and table of [cyclic] may be others than those of the disc "
                "that was built, from a scene in the same folder, and the blades differ only if they differ there; build the "
                "structure of this scene"
            )
        disc = whole_disc(self._alike, scene, factors_of_sectors(scene, self.comm), RunLog(self.comm, screen=False))
        return replace(disc, shares=True)

    def shares_modes_with(self, scene: Scene) -> bool:
        """Return whether a scene of the same folder differs in its sectors alone, with blades that differ only if those here do.

        Collective.
        """
        whole = [self.scene, completed_scene(scene, self.comm)]
        if self.scene.folder.resolve() != scene.folder.resolve():  # their files may be others of the same name
            return False
        if not all(each.cyclic is not None and each.cyclic.whole for each in whole):
            return False
        first, second = (each.model_dump(exclude={"cyclic": {"scatter", "sector", "table"}}) for each in whole)
        has_forms = (FORMS, self.tuned[0].projected) in self.tuned[0].results
        return first == second and (has_forms or not factors_of_sectors(whole[1], self.comm).changes_blades)

    @property
    def _alike(self) -> list[Structure]:
        return [each for each in self.tuned if isinstance(each, Structure)]

    def close(self) -> None:
        """Free the factors and the matrices, unless they are those of another structure.  Collective."""
        if not self.shares:
            super().close()


@dataclass(frozen=True, eq=False)
class Assembled:
    """The mesh and matrices of a scene that its model file completes."""

    scene: Scene
    mesh: Mesh | None  # rank 0 only; None of a scene given as matrices whose rows belong to no nodes
    rest: AtRest
    reference: ReferenceState | None = None  # with [statics]


def assembled(scene: Scene, comm: MPI.Comm, log: RunLog, explicit: bool = True) -> Assembled:
    """Return mesh and matrices of a scene, with [statics] at rest.  Collective.

    Unless ``explicit``, K and M of a disc at nodal diameter 0 may have no entries: they are products with those of the sector.

    Raises
    ------
    CaseError, MeshError, ResourceError : on every rank
    """
    if scene.model.mesh is None:
        return Assembled(scene, *from_matrices(scene, comm, log))
    with log.stage("model file"):
        file, scene, notes = read_completed(scene, comm)
    for note in notes:
        log.note(note)
    return Assembled(scene, *from_mesh(scene, file, comm, log, explicit))


def build(scene: Scene, comm: MPI.Comm | None = None, log: RunLog | None = None, keeps_reference: bool = True) -> Structure:
    """Return the structure with all pairs stuck, factored, and its lowest modes.

    Collective on ``comm``, by default all ranks.  Without a ``log`` nothing is logged.  With [statics], the structure before the
    loads act (its K and mesh) is stored for other states of rest, unless ``keeps_reference`` is False.  The memory of dropped
    structures that were not closed is freed first.

    Raises
    ------
    CaseError, MeshError, ResourceError : on every rank
    """
    if not isinstance(scene, Scene):
        raise CaseError(f"build: expected a scene, as microslip.read(PATH) returns it, found {type(scene).__name__}")
    comm = comm or everyone()
    log = log or RunLog(comm, screen=False)
    free_dropped(comm)
    is_whole = scene.cyclic is not None and scene.cyclic.whole
    return stuck_structure(without_reference(assembled(scene, comm, log, explicit=not is_whole), keeps_reference), log)


def rebuilt(scene: Scene, comm: MPI.Comm, log: RunLog, cached: FactorCache | None, modes_of: ModesOf) -> Factored:
    """Return the large parts of a restored structure: assembled again, with a cached factor and cached modes.

    Collective, and so is ``modes_of``.

    Raises
    ------
    CaseError, MeshError, ResourceError : on every rank
    """
    log.note("the structure is assembled again, its modes are known")
    return factored_of(without_reference(assembled(scene, comm, log), False), log, cached, modes_of)


def factored_of(parts: Assembled, log: RunLog, cached: FactorCache | None, modes_of: ModesOf) -> Factored:
    """Return the large parts of a structure with known modes.  Collective, and so is ``modes_of``; raises as :func:`rebuilt`."""
    linearised = factor_of(parts, log, cached=cached, has_later=False)
    with log.stage("modes"):
        modes = modes_of(linearised)
    correct_soft_modes(linearised, modes, parts.scene)
    return Factored(linearised, modes, parts.mesh)


def without_reference(parts: Assembled, keeps_reference: bool) -> Assembled:
    """Return the assembled parts, without the structure before the loads unless it is stored.  Collective."""
    if parts.reference is None or keeps_reference:
        return parts
    parts.reference.system.destroy(parts.rest.system)  # its memory before the factor's
    return replace(parts, reference=None)


def factor_of(parts: Assembled, log: RunLog, cached: FactorCache | None = None, has_later: bool = True) -> Linearised:
    """Return the stuck structure, factored, or with a cached factor.  Collective.

    Reserves memory for modes that are computed later.

    Raises
    ------
    CaseError, ResourceError : on every rank
    """
    system = _to_factor(parts, log)
    with log.stage("factor of the stuck structure"):
        later = partial(memory_of_modes, system.K, reduction_settings(parts.scene)) if has_later else None
        linearised = linearise(system, parts.rest.pairs, str(parts.scene.path), later, cached)
    _note_factor(parts, linearised, log)
    return linearised


def _to_factor(parts: Assembled, log: RunLog) -> System:
    """Return the system that is factored.  Collective.  Raises CaseError: more modes than it has, or too large for the method."""
    scene, settings = parts.scene, reduction_settings(parts.scene)
    system = with_contact_forces(parts.rest.system, parts.rest.pairs, scene.outputs)
    _note_once(log, f"{system.n_dof} DOF, {counted(parts.rest.pairs.n_pairs, 'contact pair')}")
    refuse_too_many(settings.modes, system.n_dof, scene.path, scene.response.mode)
    check_size(settings, system)
    return system


def _note_factor(parts: Assembled, linearised: Linearised, log: RunLog, of: str = "") -> None:
    """Log lines on a factor; free K where memory is short and nothing else needs it.  Collective."""
    for note in (*linearised.factor.info["messages"], factor_in_words(linearised.factor.info)):
        _note_once(log, note)
    if linearised.factor.n_rigid:
        motions_owned = linearised.system.rigid_owned
        log.note(of + rigid_in_words(linearised.factor.n_rigid, None if motions_owned is None else motions_owned.shape[1]))
    alone = parts.scene.cyclic is None and parts.reference is None
    if linearised.factor.info.get("out_of_core") and alone and keeps_to_K_L(reduction_settings(parts.scene)):
        linearised.let_K_go()


def _note_once(log: RunLog, text: str) -> None:
    """Log a line unless another nodal diameter has logged it.  Local."""
    if text not in log.notes:
        log.note(text)


def stuck_structure(parts: Assembled, log: RunLog) -> Structure:
    """Return the factored structure at rest with its static response and its modes.  Collective.

    For a disc this is the structure of harmonic 1; other nodal diameters are computed when they are first needed.

    Raises
    ------
    CaseError, ResourceError : on every rank
    """
    cyclic = parts.scene.cyclic
    _refuse_coriolis(parts.scene)
    if cyclic is None:
        return _stuck(parts, log)
    if cyclic.whole:
        factors = factors_of_sectors(parts.scene, parts.rest.system.comm)
        return whole_disc(tuned_disc(parts, factors.changes_blades, log), parts.scene, factors, log)
    groups: PerGroup[Structure] = PerGroup(
        lambda d: of_diameter(parts, d, groups, log),  # type: ignore[arg-type]  # its groups are whole numbers
        cyclic.diameter,
        cyclic.diameters,
    )
    return groups.of(1)


def _refuse_coriolis(scene: Scene) -> None:
    if scene.statics is not None and scene.statics.coriolis:
        raise CaseError(
            f"{scene.path}: [statics] coriolis = true: only `microslip modes` takes Coriolis forces in; for the forced "
            "response state false, and compare the frequencies of `microslip modes` with and without them"
        )


def conjugate_of(d: int, n_sectors: int) -> int | None:
    """Return the sector index with the conjugate matrices; None for nodal diameters 0 and N / 2, which are real.  Local."""
    return None if 2 * d % n_sectors == 0 else n_sectors - d


def of_diameter(parts: Assembled, d: int, groups: PerGroup[Structure], log: RunLog) -> Structure:
    """Return the structure of a disc at the sector index d, 0 to sectors - 1.  Collective where it is new.

    Raises
    ------
    CaseError, ResourceError : on every rank
    """
    _refuse_coriolis(parts.scene)
    system = parts.rest.system
    assert system.sectors is not None, "a disc"
    n = system.sectors.n_sectors
    if 2 * d > n:
        return groups.of_group(n - d).of_conjugate(d)
    log.note(f"nodal diameter {d}")
    parts = at_diameter(parts, d)
    linearised = factor_of(parts, log)
    with log.stage("modes"):
        structure, notes = _with_modes(parts, linearised, groups=groups, group=d, conjugate=conjugate_of(d, n))
    for note in notes:
        log.note(note)
    return structure


def at_diameter(parts: Assembled, d: int, explicit: bool = True) -> Assembled:
    """Return the parts at a nodal diameter, up to half of the sectors.  Collective.

    K and M of half of the sectors have entries only if ``explicit``.
    """
    system = parts.rest.system
    assert system.sectors is not None, "a disc"
    return parts if d == 0 else replace(parts, rest=replace(parts.rest, system=system.sectors.system(d, explicit)))


def factors_of_sectors(scene: Scene, comm: MPI.Comm) -> SectorFactors:
    """Return the values of each sector of a disc relative to the model, for a scene completed by its model file.  Collective.

    Raises
    ------
    CaseError : of the table or the scatter, of what takes part in the state of rest, or of Coriolis forces; on every rank
    """
    assert scene.cyclic is not None, "a disc"
    _refuse_coriolis(scene)
    factors = on_root(comm, factors_of, scene.cyclic, scene.path)
    if scene.statics is not None and factors.contact_that_differs:
        raise CaseError(
            f"{scene.path}: [cyclic] with [statics]: the state of rest is that of alike sectors, and "
            f"{factors.contact_that_differs} of a sector takes part in it; leave [statics] out and state preload in Pa, or let "
            "stiffness, density and load differ"
        )
    return factors


def tuned_disc(parts: Assembled, changes_blades: bool, log: RunLog) -> list[Structure]:
    """Return the structures of a disc of identical sectors, of the nodal diameters 0, 1, ..., N // 2.  Collective.

    If ``changes_blades``, with static shapes as last modes and with :class:`BladeForms` among the results of diameter 0.

    Raises
    ------
    CaseError, ResourceError : on every rank
    """
    cyclic, sectors = parts.scene.cyclic, parts.rest.system.sectors
    assert cyclic is not None, "a disc"
    tuned = [replace(each, groups=None) for each in _alike(parts, cyclic, log)]  # memory of the modes that shapes replace
    if not changes_blades or sectors is None or sectors.blades is None:
        return tuned
    n_modes = [each.n_modes for each in tuned]
    with log.stage("static shapes of blades that differ"):
        for d, each in enumerate(tuned):
            tuned[d] = with_static_shapes(each, sectors.blades)
    with log.stage("matrices of blades that differ"):
        forms = blade_forms(tuned, Waves(cyclic.sectors), sectors.blades, n_modes)
    tuned[0].results[FORMS, tuned[0].projected] = forms
    free(*sectors.blades)
    return tuned


def whole_disc(tuned: Sequence[Structure], scene: Scene, factors: SectorFactors, log: RunLog) -> WholeStructure:
    """Return the structure of a disc whose sectors may differ, from the disc of identical sectors.  Collective.

    The modes of each diameter are chosen as if the loads excited it.

    Raises
    ------
    CaseError, ResourceError : on every rank
    """
    cyclic, first = scene.cyclic, tuned[0]
    assert cyclic is not None, "a disc"
    for note in on_root(first.comm, notes_on_sectors, cyclic, scene.path):
        log.note(note)
    forms: BladeForms | None = first.results.get((FORMS, first.projected))
    wave = cyclic.with_keys(whole=False, sector=(), table=None, scatter=None, blades=None)

    def of_index(d: int) -> Structure:
        of_diameter = tuned[min(d, cyclic.sectors - d)]
        if forms is not None:
            of_diameter = with_first_modes(of_diameter, int(forms.n_modes[min(d, cyclic.sectors - d)]))
        structure = replace(of_diameter, groups=one_sector)
        return structure.of_conjugate(d) if 2 * d > cyclic.sectors else structure

    make: Callable = of_index
    one_sector: PerGroup[StuckStructure] = PerGroup(make, wave.diameter, wave.diameters)
    tuned = [replace(each, groups=one_sector) for each in tuned]
    numbers = first.comm.bcast(first.numbers)
    assert numbers is not None, "of a mesh"
    pairs = pairs_of_all_sectors(first.pairs, len(numbers), cyclic, factors, scene.path)
    leads = np.array([load.harmonic * cyclic.wave_number for load in scene.loads for _ in load.phases])
    with log.stage("static columns of all sectors"):
        fields = of_all_sectors(tuned, pairs, leads, factors.load)
    if forms is not None:
        with log.stage("modes of blades that differ"):
            fields = with_other_blades(fields, tuned, forms, (factors.stiffness, factors.density))
    forget_all_faces(tuned)  # memory of the response
    gc.collect()  # of the structures before, which refer to each other
    give_back()
    return WholeStructure(
        **fields,
        alike=replace(of_index(wave.diameter(1)), scene=scene.with_keys(cyclic=wave)),
        turns=turns(cyclic),
        diameter=min(cyclic.diameter(1), cyclic.diameter(-1)),
        scene=scene,
        has_mesh=first.has_mesh,
        numbers=whole_numbers(numbers, cyclic.sectors) if first.comm.rank == 0 else None,
    )


def all_diameters(parts: Assembled) -> list[Assembled]:
    """Return the parts at the nodal diameters 0, 1, ..., N // 2 of a disc whose sectors may differ.  Collective."""
    assert parts.scene.cyclic is not None, "a disc"
    return [at_diameter(parts, d, explicit=False) for d in range(parts.scene.cyclic.sectors // 2 + 1)]


def factors_of_diameters(of_diameters: Sequence[Assembled], log: RunLog) -> list[Linearised]:
    """Return the stuck structures of all nodal diameters, factored.  Collective.

    Raises
    ------
    CaseError, ResourceError : on every rank
    """
    systems, pairs = [_to_factor(each, log) for each in of_diameters], of_diameters[0].rest.pairs
    with log.stage("factor of the stuck structure"):  # one pass over the factor of the sector tests all of them
        factored = in_lockstep([partial(linearise, system, pairs, str(of_diameters[0].scene.path)) for system in systems])
    for d, (parts, linearised) in enumerate(zip(of_diameters, factored)):
        _note_factor(parts, linearised, log, f"nodal diameter {d}: ")
    return factored


def _alike(parts: Assembled, cyclic: Cyclic, log: RunLog) -> list[Structure]:
    """Return the structures of a disc of identical sectors, of the diameters 0, 1, ..., N // 2.

    Collective.  The modes of several diameters are computed in lockstep.
    """
    N, sectors = cyclic.sectors, parts.rest.system.sectors
    notes: dict[int, list[str]] = {}
    waves = [cyclic.with_keys(engine_order=d, nodal_diameter=None, wave=None, whole=False) for d in range(N // 2 + 1)]
    of_waves = [replace(each, scene=parts.scene.with_keys(cyclic=w)) for each, w in zip(all_diameters(parts), waves)]
    factored = factors_of_diameters(of_waves, log)

    def alike(d: int) -> Structure:
        if 2 * d > N:
            return diameters.of_group(N - d).of_conjugate(d)
        groups = PerGroup(diameters.of_group, waves[d].diameter, waves[d].diameters)
        structure, notes[d] = _with_modes(of_waves[d], factored[d], groups=groups, group=d, conjugate=conjugate_of(d, N))
        return structure

    diameters: PerGroup[Structure] = PerGroup(alike)  # type: ignore[arg-type]  # its groups are whole numbers
    assert isinstance(sectors, Sectors), "a disc"
    n_modes = reduction_settings(parts.scene).modes or PICKED
    together = diameters_together(memory_of_diameter(sectors, n_modes, parts.rest.system.n_dof), log.comm)
    tuned: list[Structure] = []
    with log.stage("modes of all nodal diameters"):
        while len(tuned) <= N // 2:
            some = range(len(tuned), N // 2 + 1)[:together]
            tuned += in_lockstep([partial(diameters.of_group, d) for d in some])
    for d in range(N // 2 + 1):
        for note in notes[d]:
            log.note(f"nodal diameter {d}: {note}")
    return tuned


def _stuck(parts: Assembled, log: RunLog) -> Structure:
    """Return the structure of all harmonics.  Collective."""
    linearised = factor_of(parts, log)
    with log.stage("modes"):
        structure, notes = _with_modes(parts, linearised)
    for note in notes:
        log.note(note)
    return structure


def _with_modes(parts: Assembled, linearised: Linearised, **of_group: Any) -> tuple[Structure, list[str]]:
    """Return the structure of one group of harmonics with its static response and its modes, and notes.

    Collective, in lockstep with others.
    """
    settings, rest = reduction_settings(parts.scene), parts.rest
    refuse_modes(linearised.K_L, linearised.factor, settings)
    structure = Structure.of(
        linearised,
        rest.pairs,
        static_response(linearised),
        mesh=parts.mesh,
        scene=parts.scene,
        has_mesh=linearised.maps.dof is not None,
        numbers=None if parts.mesh is None else parts.mesh.numbers,
        bolts=rest.bolts,
        balance=rest.balance,
        reference=parts.reference,
        **of_group,
    )
    structure, why = choose_modes(structure, settings)
    if correct_soft_modes(linearised, structure.modes, parts.scene):
        structure, why = choose_modes(replace(structure, statics=static_response(linearised)), settings)
    free_if_dropped(structure.comm, linearised.factor)
    return structure, [*filter(None, (*structure.modes.info.get("messages", ()), why))]


def correct_soft_modes(linearised: Linearised, modes: Modes, scene: Scene) -> bool:
    """Make static solutions exact in the modes far below the range of the response; return whether there are any.  Collective."""
    lowest = frequency_band(reduction_settings(scene).band, modes.omega_n)[0] if len(modes.omega_n) else 0.0
    of_system, omega_n, phi_owned = (linearised.system.comm, linearised.M), modes.omega_n, modes.phi_owned
    if linearised.maps.is_complex:
        omega_n, phi_owned = np.tile(omega_n, 2), np.hstack([real_columns(phi_owned), real_columns(1j * phi_owned)])
    linearised.factor.soft_modes = SoftModes.of(*of_system, omega_n, phi_owned, 2.0 * np.pi * lowest)
    return linearised.factor.soft_modes is not None


def rigid_in_words(n: int, n_motions: int | None) -> str:
    """Return the line of a log on n rigid-body modes, where supports leave ``n_motions`` free; None: matrices.  Local."""
    start = "no supports" if n_motions in (None, 6) else "supports leave rigid-body motion free"
    fewer = f"; WARNING: {n_motions} are free of supports; other parts hold the rest" if n_motions not in (None, n) else ""
    return f"{start}: {n} rigid-body mode{'s' * (n > 1)}, exact; mode 1 is the first elastic one{fewer}"


def factor_in_words(info: dict[str, Any]) -> str:
    """Return a line on the factor: its memory and time, compared with the forecast.  Local."""
    memory = info.get("memory")
    if memory is None:
        return f"factor by {info['package']}, which PETSc calls"
    by = f" by {info['interface']}'s interface to MUMPS" if "interface" in info else ""
    if "restored_from" in info:
        size = gigabytes(1e6 * info["memory_MB"])
        return f"factor: that of an earlier run, {info['entries']} entries, {size} in {info['restored_from']}"
    foreseen = memory.out_of_core if info["out_of_core"] else memory.in_core
    shared = (
        "" if "face" not in info else f"; that of one sector, for all nodal diameters, each with {info['face']} rows of a face"
    )
    return (
        f"factor{by}: {info['entries']} entries, ordered by {info['ordering']}; memory {info['memory_MB']} MB on all ranks, "
        f"{info['memory_max_MB']} MB on the largest (foreseen on rank 0: {foreseen / 1e6:.0f} MB){shared}"
    )


def at_another_rest(structure: Structure, scene: Scene, pairs: ContactPairs) -> tuple[Structure, tuple[str, ...]]:
    """Return a structure at rest with other ``pairs``, as ``scene`` states them, and the notes of its log.

    Collective.  The last such structure is stored, and the factor of the one before is freed.  Mesh, matrices and constant forces
    are reused; factor and static columns of the reference structure are computed for the first other rest and stored.  If the
    stiffness and the springs are those of ``structure``, its factor, modes and the results of these are reused.

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : on every rank
    """
    assert structure.reference is not None, "a structure that keeps it"
    if scene.cyclic is not None:
        raise CaseError(
            f"{scene.path}: [cyclic] with [statics]: another friction or preload is another state of rest, and of a disc the one "
            "built is known; build the structure of a scene that states it"
        )
    structure.refuse_closed()
    key, of_scene = ((each.mu.tobytes(), each.N0.tobytes()) for each in (pairs, structure.reference.pairs))
    if key == of_scene:
        return structure, ()
    if structure.results.get(_OTHER_REST, (None,))[0] != key:
        free_other_rest(structure)
        free_dropped(structure.comm)
        linearised, log = structure.linearised, RunLog(structure.comm, screen=False)
        rest = find_rest(structure.reference, pairs, linearised.system)
        if rest.system.K is linearised.system.K and np.array_equal(joint_stiffness(rest.pairs), joint_stiffness(structure.pairs)):
            linearised = replace(linearised, system=replace(linearised.system, rest_owned=rest.system.rest_owned))
            factored = OnDemand.of(replace(structure.factored(), linearised=linearised))
            other = replace(structure, factored=factored, pairs=rest.pairs, scene=scene, bolts=rest.bolts, balance=rest.balance)
        else:
            other = stuck_structure(Assembled(scene, structure.mesh, rest), log)
        structure.results[_OTHER_REST] = key, other, (*rest.messages, *log.notes)
    _, other, notes = structure.results[_OTHER_REST]
    return other, notes


def free_other_rest(structure: Structure) -> None:
    """Free the factor and the stiffness of the structure at another rest, unless shared with ``structure``.  Collective."""
    other = structure.results.pop(_OTHER_REST, None)
    if other is None or other[1].linearised.factor is structure.linearised.factor:
        return
    assert structure.reference is not None, "a structure that keeps it"
    at_rest, reference = other[1].linearised, structure.reference.system
    at_rest.destroy()
    if at_rest.system.K is not reference.K:
        at_rest.system.destroy(structure.linearised.system)


def from_mesh(
    scene: Scene, file: FileModel | None, comm: MPI.Comm, log: RunLog, explicit: bool = True
) -> tuple[Mesh | None, AtRest, ReferenceState | None]:
    """Return mesh (on rank 0) and structure of a scene with a mesh, whose file rank 0 has read.  Collective.

    With [statics] this is the structure at rest, with the reference state; without, ``explicit`` is as in :func:`assembled`.
    """
    with log.stage("mesh and contact pairs"):
        mesh = on_root(comm, read_mesh, scene, file, share=False)
        pairs = on_root(comm, pair_contacts, mesh, scene.joints, scene.cyclic)
    for note in (*on_root(comm, lambda: mesh.notes), *pairs.notes):
        log.note(note)
    with log.stage("partition"):
        shares = distribute(mesh, scene, comm)
    with log.stage("assembly"):
        system = assemble(shares, mesh, pairs, scene, explicit or scene.statics is not None)
    for note in (*(system.constraints.notes if system.constraints is not None else ()), *system.notes):
        log.note(note)
    if scene.statics is None:
        return mesh, AtRest(system, pairs), None
    with log.stage("statics"):
        reference = ReferenceState.of(system, shares, mesh, pairs, scene, str(scene.path))
        rest = find_rest(reference, reference.pairs)
        reference.close(rest.system)
    for line in rest.messages:
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
