"""The reference state, before the constant loads act, and the state of rest under them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from mpi4py.MPI import MAX

from ..assembly.large_displacements import tangent_about
from ..assembly.moved import moved_supports
from ..assembly.prestress import Seen, constant_forces, stiffness_at_rest
from ..assembly.pretension import Bolts, pretension
from ..assembly.reactions import acting_at_rest
from ..assembly.sectors import Sectors
from ..assembly.spin import stated_statics
from ..assembly.system import System
from ..mesh.data import ContactPairs, DistributedMesh, Mesh
from ..mesh.surface import stretched
from ..messages.errors import CaseError, ConvergenceError
from ..messages.words import counted, place
from ..parallel.agree import on_root
from ..parallel.ownership import summed
from ..tables.structure_tables import StructureTables
from .balance import Balance, balance_of
from .bolts import BoltsAtRest, Cuts
from .contact_check import check_contact
from .equilibrium import Flexibility, Rest, equilibrium, stuck_forces
from .large_displacements import About, LargeProblem, large_equilibrium
from .loaded import Loaded
from .rest import at_approximate_pressure, at_rest, in_words, starts_unpressed, with_area_ratio
from .rigid_bodies import freely_moved_bodies

_BALANCED = 1e-6  # of the sum of all forces and of their moments: smaller imbalances are rounding

SAME = 1e-10  # relative difference of displacements below which states of rest are the same


@dataclass(frozen=True, eq=False)
class ReferenceState:
    """A structure before its constant loads act, with all data to compute its rest."""

    system: System
    shares: DistributedMesh
    mesh: Mesh | None  # rank 0 only
    pairs: ContactPairs  # as the scene states them
    settings: StructureTables  # with statics
    forces_owned: np.ndarray  # (n_dof_owned,) N, this rank's rows of the constant forces
    bolts: Bolts | None
    where: str  # the scene file, for messages

    @classmethod
    def of(
        cls,
        system: System,
        shares: DistributedMesh,
        mesh: Mesh | None,
        pairs: ContactPairs,
        settings: StructureTables,
        where: str,
    ) -> ReferenceState:
        """Return a structure with its constant forces and bolts.  Collective.

        Rough surfaces without initial pressure get the springs of the approximate pressure under the loads, which needs one more
        factorisation.

        Raises
        ------
        MeshError : places or groups without nodes, bolts without a cut, moved nodes that are not supported; on every rank
        CaseError : loads that are not in balance on a structure without supports; on every rank
        """
        system = replace(system, moved=moved_supports(mesh, settings, system))
        forces, bolts = constant_forces(shares, mesh, settings, system), pretension(shares, mesh, settings, system)
        check_unsupported(system, settings, forces, where)
        reference = cls(system, shares, mesh, pairs, settings, forces, bolts, where)
        if not starts_unpressed(pairs).any():
            return reference
        N = stuck_forces(reference.flexibility, pairs, forces, reference.cuts)
        reference.close()
        return replace(reference, pairs=at_approximate_pressure(pairs, N))

    @cached_property
    def flexibility(self) -> Flexibility:
        """The flexibility of the stuck structure with its factor; independent of friction and preload.  Collective."""
        return Flexibility.of(self.system, self.pairs, self.where)

    @cached_property
    def cuts(self) -> Cuts | None:
        """The cuts of the bolts in the stuck structure; None without bolts.  Collective: one solve per bolt.

        Raises
        ------
        CaseError : a bolt that clamps nothing; on every rank
        """
        return None if self.bolts is None else self.flexibility.cuts(self.bolts, self.where)

    def close(self, other: System | None = None) -> None:
        """Free the factor, if there is one, and results that need it; they are computed again when needed.  Collective.

        That of the sector of a disc stays if the ``other`` system has the same K.
        """
        vars(self).pop("cuts", None)
        flexibility = vars(self).pop("flexibility", None)
        if flexibility is not None:
            flexibility.destroy()
        sectors, others = self.system.sectors, None if other is None else other.sectors
        if isinstance(sectors, Sectors) and not (isinstance(others, Sectors) and others.shared is sectors.shared):
            sectors.free_shared()


@dataclass(frozen=True, eq=False)
class AtRest:
    """A structure at rest, about which it vibrates; without constant loads the structure as assembled."""

    system: System
    pairs: ContactPairs
    bolts: BoltsAtRest | None = None
    balance: Balance | None = None
    messages: tuple[str, ...] = ()  # lines on the rest for the log


def find_rest(reference: ReferenceState, pairs: ContactPairs, known: System | None = None) -> AtRest:
    """Return the structure at rest under the constant loads, about which it vibrates.

    Collective.  ``pairs``: before the loads act; they may differ from the structure's pairs in friction and preload.
    ``known`` is the structure at an earlier rest, whose K is reused if the displacement at rest is the same.

    Raises
    ------
    CaseError, ConvergenceError, MeshError, ResourceError : on every rank
    """
    system, settings, forces, where = reference.system, reference.settings, reference.forces_owned, reference.where
    statics = stated_statics(settings)
    assert statics is not None, "a scene with [statics]"
    loaded = Loaded(system, reference.mesh, pairs, forces, settings.body_of, where, settings.cyclic)
    free = partial(freely_moved_bodies, loaded)
    messages: list[str] = []
    if statics.large_displacements:
        large_problem = LargeProblem(system, partial(_about, reference, pairs), forces, statics.steps, free, where)
        rest, about, n_steps = large_equilibrium(large_problem)
        about_rest, pairs = about.system, about.pairs
        loaded = replace(loaded, pairs=pairs)
        messages = _messages_of_large(reference, pairs, rest, n_steps)
    else:
        rest = _rest(reference, pairs, free)
        about_rest = _stiffness(reference, rest, known)
    check_contact(loaded, rest)
    acting = acting_at_rest(
        reference.shares, reference.mesh, settings, system, rest.u_owned, _motions_above_cuts(reference, rest)
    )
    balance = balance_of(loaded, rest, acting)
    moduli = [material.modulus for material in settings.materials.values() if material.modulus]
    messages += in_words(pairs, rest, balance, min(moduli, default=None))
    if isinstance(about_rest.sectors, Sectors):
        about_rest = replace(about_rest, sectors=about_rest.sectors.at_rest(rest.u_owned, system.moved))
    about_rest = replace(about_rest, rest_owned=rest.u_owned)
    return AtRest(about_rest, at_rest(pairs, rest), rest.bolts, balance, tuple(messages))


def _rest(reference: ReferenceState, pairs: ContactPairs, free: Callable[[], str]) -> Rest:
    """Return the rest with small displacements.  Collective; ConvergenceError names the scene."""
    steps = stated_statics(reference.settings).steps
    try:
        return equilibrium(reference.flexibility, pairs, reference.forces_owned, steps, reference.cuts, free)
    except ConvergenceError as problem:
        raise ConvergenceError(f"{reference.where}: {problem}") from problem


def _about(reference: ReferenceState, pairs: ContactPairs, u_owned: np.ndarray, fraction: float, is_stressed: bool) -> About:
    """Return the structure about a displacement, this rank's rows, under a fraction of the load.  Collective."""
    about, forces = tangent_about(reference.shares, reference.settings, reference.system, u_owned, fraction, is_stressed)
    if not pairs.n_pairs:
        return About(about, forces, pairs)
    ratio, _ = _stretched(reference, pairs, u_owned, fraction)
    return About(about, forces, with_area_ratio(pairs, ratio))


def _stretched(
    reference: ReferenceState, pairs: ContactPairs, u_owned: np.ndarray, fraction: float
) -> tuple[np.ndarray, dict[str, float]]:
    """Return the areas of the pairs over their unloaded areas, (n_pairs,), and the rotations of joints [rad].  Collective."""
    system = reference.system
    u = system.at_nodes(np.concatenate(system.comm.allgather(u_owned)))
    u = u if system.moved is None else u + fraction * system.moved
    return on_root(system.comm, stretched, reference.mesh, reference.settings.joints, pairs, u)


def _messages_of_large(reference: ReferenceState, pairs: ContactPairs, rest: Rest, n_steps: int) -> list[str]:
    """Return lines on a rest with large displacements: steps, and rotations of the surfaces of joints.  Collective."""
    lines = [f"rest with large displacements found in {counted(n_steps, 'step')} of Newton's method"]
    turns = _stretched(reference, pairs, rest.u_owned, 1.0)[1] if pairs.n_pairs else {}
    return lines + [
        f"  {name}: its faces turn by up to {turn:.1e} rad under the loads; its pairs keep the frames of the reference mesh"
        for name, turn in turns.items()
    ]


def _stiffness(reference: ReferenceState, rest: Rest, known: System | None) -> System:
    """Return the structure with K about a rest with small displacements; that of a known rest if they are equal.  Collective."""
    system, settings = reference.system, reference.settings
    if known is not None and _is_same(known, rest.u_owned):
        return replace(system, K=known.K)
    if not stated_statics(settings).stress_stiffening:
        return system
    return stiffness_at_rest(reference.shares, settings, system, rest.u_owned, _motions_above_cuts(reference, rest))


def _motions_above_cuts(reference: ReferenceState, rest: Rest) -> Seen | None:
    """Return the motions of elements above the cuts of bolts in addition to those of their nodes; None without bolts.  Local."""
    if reference.bolts is None or rest.bolts is None:
        return None
    return partial(reference.bolts.overlap.motions_of, shortening=rest.bolts.shortening)


def _is_same(known: System, u_owned: np.ndarray) -> bool:
    """Return whether a displacement at rest equals the displacement of a known rest.  Collective."""
    before = known.rest_owned
    assert before is not None, "a structure at rest"
    sizes = np.array([np.abs(u_owned - before).max(initial=0.0), np.abs(before).max(initial=0.0)])
    known.comm.Allreduce(sizes.copy(), sizes, op=MAX)
    return bool(sizes[0] <= SAME * sizes[1])


def check_unsupported(system: System, settings: StructureTables, forces_owned: np.ndarray, where: str) -> None:
    """Raise CaseError on every rank for constant loads that are not in balance along free rigid-body motions.

    Collective: one sum.  ``forces_owned`` (n_dof_owned,) [N].
    """
    motions, statics = system.rigid_owned, stated_statics(settings)
    if motions is None or motions.shape[1] == 0 or statics is None:
        return
    start = f"{where}{': ' if where else ''}[statics]"
    for key, is_stated in (
        ("rotation_speed", statics.rotation_speed > 0.0),
        ("large_displacements = true", statics.large_displacements),
    ):
        if is_stated:
            lacks = "has none" if motions.shape[1] == 6 else "can still move as a rigid body"
            raise CaseError(f"{start} {key} needs [[supports]]: the structure {lacks}, and nothing holds its axis or its turn")
    resultant, size = summed(system.comm, np.stack([motions.T @ forces_owned, np.abs(motions).T @ np.abs(forces_owned)]))
    if motions.shape[1] < 6 and (np.abs(resultant) > _BALANCED * size).any():
        raise CaseError(
            f"{start}: constant loads must be in balance along the rigid-body motions that [[supports]] leave free, and push the "
            "structure along one of them; add [[supports]] that hold it, or what balances it"
        )
    if (np.abs(resultant) > _BALANCED * size).any():
        force, moment = np.where(np.abs(resultant) > _BALANCED * size, resultant, 0.0).reshape(2, 3)
        raise CaseError(
            f"{start}: constant loads on a structure without supports must be in balance: a force of {place(force)} N and a "
            f"moment of {place(moment)} N m about the middle of its nodes are left over; add [[supports]], or what balances it"
        )
