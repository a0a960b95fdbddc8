"""The memory estimate of a run as text, by stage and rank; nothing is solved."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from ...assembly.assemble import ASSEMBLED, read_off
from ...assembly.constraints import constrain
from ...assembly.coupling import Coupling, coupling_of_dofs, coupling_of_nodes
from ...assembly.matrices import GivenStructure
from ...guards.memory import Shortage, memory_left, shortage
from ...library.settings import reduction_settings
from ...linear.analysis import FactorMemory
from ...linear.direct import foreseen
from ...linear.joint_springs import STORED, analysis_of
from ...mesh.data import ContactPairs, DistributedMesh, Mesh
from ...messages.words import counted
from ...modes.shift_invert import basis_size
from ...parallel.agree import on_root
from ...reduction.facts import Counts
from ...reduction.galerkin import memory_of_basis
from ...reduction.memory_of_modes import HELD, PICKED, VECTORS, of_energies, of_proof
from ...reduction.methods import METHODS
from ...scene.schema import Scene
from ...system.memory import gigabytes, peak_memory
from .report import highest_harmonic

FACTORED = STORED + 10.5  # bytes per entry of K: K_L, its triangle with indices for MUMPS, and the analysis
LIBRARIES = 16e6  # bytes of MUMPS, BLAS and SLEPc and their buffers, touched at first use
PICTURES = 30e6  # bytes of Matplotlib and its fonts, touched at first use
_FRONTS = 0.25  # memory of a factorisation that discards its factor, over the size of the factor
COLUMNS = 2.5e8  # bytes of a batch of static solutions on all ranks
_MIB = 1024.0**2


@dataclass(frozen=True)
class StageMemory:
    """The peak memory of the ranks up to the end of a stage, since the start of the program."""

    name: str  # as in run.log
    peak: np.ndarray  # (size,) bytes
    is_measured: bool = False


@dataclass(frozen=True)
class MemoryEstimate:
    """The memory of a run by stage, and of the factor, on all ranks."""

    stages: tuple[StageMemory, ...]
    factor: tuple[FactorMemory, ...] | None  # of each rank; None without MUMPS' analysis
    modes: int  # assumed number of modes

    @property
    def more(self) -> np.ndarray:
        """Memory that each rank will need in addition to its peak so far, (size,) bytes."""
        measured = np.max([stage.peak for stage in self.stages if stage.is_measured], axis=0)
        return np.max([stage.peak for stage in self.stages], axis=0) - measured


def estimate_memory(scene: Scene, coupling: Coupling, n_pairs: int, so_far: float, highest: int) -> MemoryEstimate:
    """Return the memory of a run of a scene after its mesh has been distributed, with a peak of ``so_far`` bytes on this rank.

    Collective on the graph's communicator; the same on every rank.  ``highest``: the highest harmonic of the points.
    """
    comm = coupling.graph.comm.tompi4py()
    factor = foreseen(coupling.graph, coupling.n_dof_each, coupling.entries_owned)
    names = _peaks(scene, coupling, n_pairs, so_far, highest, factor)
    by_rank = comm.allgather(list(names.values()))
    stages = tuple(
        StageMemory(name, np.array(peaks), is_measured=i == 0) for i, (name, peaks) in enumerate(zip(names, zip(*by_rank)))
    )
    return MemoryEstimate(stages, None if factor is None else tuple(comm.allgather(factor)), _n_modes(scene, coupling.n_dof))


def _peaks(
    scene: Scene, coupling: Coupling, n_pairs: int, so_far: float, highest: int, factor: FactorMemory | None
) -> dict[str, float]:
    """Return the peak of this rank up to the end of each stage [bytes].  Local."""
    comm, entries, n_owned, n_dof = coupling.graph.comm, coupling.entries_owned, coupling.dofs_owned, coupling.n_dof
    of_factor = FACTORED * entries + (factor.in_core if factor is not None else _by_size(n_dof) / comm.size)
    n_modes, solver = _n_modes(scene, n_dof), scene.solver
    settings = reduction_settings(scene)
    own_pairs, N_H = -(-n_pairs // comm.size), 2 * highest + 1
    held = so_far + HELD * entries
    if scene.model.mesh is None:  # rank 0 retains the matrices that it read
        stages = {"matrices and contact pairs": so_far, "assembly": so_far + HELD * entries}
    else:
        stages = {"partition": so_far, "assembly": so_far + ASSEMBLED * entries}
    if scene.statics is not None:
        stages["statics"] = held + of_factor + LIBRARIES
    before = held + analysis_of(entries, comm.size)
    held += of_factor + LIBRARIES
    stages["factor of the stuck structure"] = max(before, held)
    columns = min(8.0 * 128 * n_dof, COLUMNS) * (n_owned / max(n_dof, 1) + (comm.rank == 0))
    vectors = 8.0 * n_owned * (basis_size(n_modes, n_dof) + VECTORS * n_modes)
    fronts = factor.out_of_core if factor is not None else _FRONTS * _by_size(n_dof) / comm.size
    proof = of_proof(entries, fronts, comm.size) if solver.verify_modes else 0.0
    stages["modes"] = held + vectors + max(proof, of_energies(n_dof, n_modes), columns)
    held += 8.0 * n_owned * n_modes
    facts, counts = METHODS[solver.method].FACTS, Counts(n_modes, n_dof, n_pairs, len(settings.excitation.shapes))
    basis = memory_of_basis(n_owned, facts.coordinates(settings, counts)) if facts.makes_basis else columns
    stages["reduction"] = held + basis
    static = 72.0 * n_pairs * own_pairs
    a_point = 8.0 * (6 * n_pairs * N_H + 8 * n_pairs) + 4e3  # motion and forces of pairs, a few numbers of each and in all
    points = a_point * scene.response.points * (len(scene.response.levels) + 1) * (comm.rank == 0)
    stages["response"] = held + 2.5 * static + points
    stages["pictures"] = held + static + points + PICTURES
    return dict(zip(stages, np.maximum.accumulate(list(stages.values())).tolist()))  # the peak up to each


def _n_modes(scene: Scene, n_dof: int) -> int:
    return min(scene.solver.modes or PICKED, n_dof)


def _by_size(n_dof: int) -> float:
    """Return the memory of a factor of a solid mesh [bytes], as measured on a fan-blade sector of 122,124 DOF."""
    return 1.0e9 * (n_dof / 122_124) ** (4.0 / 3.0)


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
    assumed = f", with {counted(estimate.modes, 'mode')}" if picked else ""
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
