"""The memory estimate of a run as text, by stage and rank; nothing is solved."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...assembly.assemble import read_off
from ...assembly.constraints import constrain
from ...assembly.coupling import Coupling, coupling_of_dofs, coupling_of_nodes
from ...assembly.matrices import GivenStructure
from ...guards.memory import Shortage, memory_left, shortage
from ...mesh.data import ContactPairs, DistributedMesh, Mesh
from ...parallel.agree import on_root
from ...scene.schema import Scene
from ...system.memory import gigabytes, peak_memory
from .memory_estimate import MemoryEstimate, estimate_memory
from .report import highest_harmonic

if TYPE_CHECKING:
    from mpi4py import MPI

_MIB = 1024.0**2


def memory_of_mesh(scene: Scene, dmesh: DistributedMesh, mesh: Mesh | None, pairs: ContactPairs, so_far: float) -> list[str]:
    """Return lines on the memory of a run of a scene with a mesh; peak so far ``so_far`` bytes on this rank.  Collective."""
    constraints = None
    if scene.ties or scene.points or scene.has_equations or scene.attached or scene.cyclic:
        whole = on_root(dmesh.comm, read_off, mesh, pairs, scene)
        is_fixed, links = whole.is_fixed, whole.links
        constraints = None if links.is_empty else constrain(dmesh, links, is_fixed, *whole.loose)
    return _lines(scene, coupling_of_nodes(dmesh, pairs, constraints), pairs.n_pairs, so_far, dmesh.comm)


def memory_of_matrices(scene: Scene, given: GivenStructure | None, comm: MPI.Comm) -> list[str]:
    """Return lines on the memory of a run of a scene given as matrices, on rank 0.  Collective."""
    so_far, n_pairs = peak_memory(), comm.bcast(0 if given is None else given.pairs.n_pairs)
    return _lines(scene, coupling_of_dofs(given, comm), n_pairs, so_far, comm)


def _lines(scene: Scene, coupling: Coupling, n_pairs: int, so_far: float, comm: MPI.Comm) -> list[str]:
    """Return the estimate as lines and free the coupling.  Collective."""
    estimate = estimate_memory(scene, coupling, n_pairs, so_far, highest_harmonic(scene))
    coupling.graph.destroy()
    left, lacks = memory_left(comm), shortage(comm, float(estimate.more[comm.rank]))
    return in_words(estimate, 72.0 * n_pairs**2, left, lacks, picked=not scene.solver.modes)


def in_words(estimate: MemoryEstimate, columns: float, left: float, lacks: Shortage | None, picked: bool) -> list[str]:
    """Return an estimate as lines.  Local.

    Parameters
    ----------
    columns : bytes of the static columns of all pairs, all ranks
    left : bytes available to all ranks
    lacks : the limit that is exceeded; None if the memory suffices
    picked : whether the program chooses the number of modes
    """
    assumed = f", with {estimate.modes} modes" if picked else ""
    lines = [f"memory     peak by the end of each stage, MiB: all ranks, largest{assumed}"]
    for stage in estimate.stages:
        how = " measured" if stage.is_measured else ""
        lines.append(f"           {stage.name:<30}{stage.peak.sum() / _MIB:>9.0f}{stage.peak.max() / _MIB:>9.0f}{how}")
    lines.append(f"           including {_factor(estimate)}; {gigabytes(columns)} for static columns if every pair slips")
    if lacks is not None:
        return [*lines, f"           WARNING: too much for this machine: {lacks}"]
    return [
        *lines,
        f"           this machine has {gigabytes(left)} available"
        if np.isfinite(left)
        else "           available memory unknown",
    ]


def _factor(estimate: MemoryEstimate) -> str:
    """Return the memory of the factor as text."""
    if estimate.factor is None:
        return "the factor, estimated from the number of DOF: this PETSc does not analyse without factoring"
    memory, on_disk = (sum(getattr(rank, name) for rank in estimate.factor) for name in ("in_core", "on_disk"))
    return f"{gigabytes(memory)} for the factor, less with {gigabytes(on_disk)} of it on disk"
