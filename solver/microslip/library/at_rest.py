"""A structure before its constant loads act, and the rest that it comes to with one friction and preload or another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from mpi4py.MPI import MAX

from ..assembly.prestress import constant_forces, stiffness_at_rest
from ..assembly.pretension import Bolts, pretension
from ..assembly.system import System
from ..linear.joint_springs import linearise
from ..mesh.data import ContactPairs, DistributedMesh, Mesh
from ..mesh.settings import MeshSettings
from ..statics.bolts import BoltsAtRest
from ..statics.equilibrium import Flexibility, equilibrium, stuck_forces
from ..statics.flight import which_flies
from ..statics.pressed import check_pressed
from ..statics.rest import at_rest, in_words, referred_to, touches_from_none

SAME = 1e-10  # of the largest displacement: two rests that differ by less are one


@dataclass(frozen=True, eq=False)
class Unloaded:
    """A structure before its constant loads act, with all that the search for its rest needs."""

    system: System
    shares: DistributedMesh
    mesh: Mesh | None  # rank 0 only
    pairs: ContactPairs  # as the scene states them
    settings: MeshSettings  # with statics
    forces_owned: np.ndarray  # (n_dof_owned,) N, this rank's rows of the constant forces
    bolts: Bolts | None
    where: str  # the scene file, for messages

    @classmethod
    def of(
        cls, system: System, shares: DistributedMesh, mesh: Mesh | None, pairs: ContactPairs, settings: MeshSettings, where: str
    ) -> Unloaded:
        """Return a structure with its constant forces and bolts.  Collective.

        Rough surfaces that nothing presses at first get the springs of about the pressure that the loads will make, which takes
        a factor of its own.

        Raises
        ------
        MeshError : places or groups without nodes, bolts without a cut; on every rank
        """
        forces, bolts = constant_forces(shares, mesh, settings, system), pretension(shares, mesh, settings, system)
        found = cls(system, shares, mesh, pairs, settings, forces, bolts, where)
        if not touches_from_none(pairs).any():
            return found
        N = stuck_forces(found.flexibility, pairs, forces, bolts, where)
        found.close()
        return replace(found, pairs=referred_to(pairs, N))

    @cached_property
    def flexibility(self) -> Flexibility:
        """That of the pairs, all of them stuck, with the factor; friction and preload are no part of it.  Collective."""
        return Flexibility(linearise(self.system, self.pairs, self.where))

    def close(self) -> None:
        """Free the factor, if there is one; it is made again where it is needed.  Collective."""
        known = vars(self).pop("flexibility", None)
        if known is not None:
            known.linearised.destroy()


@dataclass(frozen=True, eq=False)
class AtRest:
    """A structure as it vibrates about its rest."""

    system: System
    pairs: ContactPairs
    bolts: BoltsAtRest | None
    said: tuple[str, ...]  # of the rest, for the log


def brought_to_rest(unloaded: Unloaded, pairs: ContactPairs, known: System | None = None) -> AtRest:
    """Return the structure as it vibrates about its rest under the constant loads.

    Collective.  ``pairs`` are those before the loads act; they may differ from the structure's own in friction and preload.
    ``known`` is the structure at a rest that was found before: where this one is the same, so is its K.

    Raises
    ------
    CaseError, ConvergenceError, MeshError, ResourceError : on every rank
    """
    system, mesh, settings, forces = unloaded.system, unloaded.mesh, unloaded.settings, unloaded.forces_owned
    statics, bolts, body_of = settings.statics, unloaded.bolts, settings.body_of
    assert statics is not None, "a scene with [statics]"
    flies = partial(which_flies, system, mesh, pairs, forces, body_of)
    rest = equilibrium(unloaded.flexibility, pairs, forces, statics.steps, bolts, flies, unloaded.where)
    check_pressed(system, mesh, pairs, rest, forces, body_of, unloaded.where)
    K = system.K
    if known is not None and _is_same(known, rest.u_owned):
        K = known.K
    elif statics.stiffens:
        seen = None if bolts is None or rest.bolts is None else partial(bolts.overlap.seen, shortening=rest.bolts.shortening)
        K = stiffness_at_rest(unloaded.shares, settings, system, rest.u_owned, seen)
    said = in_words(system, mesh, pairs, rest, forces, body_of)
    return AtRest(replace(system, K=K, rest_owned=rest.u_owned), at_rest(pairs, rest), rest.bolts, tuple(said))


def _is_same(known: System, u_owned: np.ndarray) -> bool:
    """Return whether a displacement at rest is that of a known rest.  Collective."""
    was = known.rest_owned
    assert was is not None, "a structure at rest"
    sizes = np.array([np.abs(u_owned - was).max(initial=0.0), np.abs(was).max(initial=0.0)])
    known.comm.Allreduce(sizes.copy(), sizes, op=MAX)
    return bool(sizes[0] <= SAME * sizes[1])
