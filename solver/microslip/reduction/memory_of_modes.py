"""Memory of the modes and of the proof that none is missing, without the factor: forecast, and refused if not available."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from ..assembly.sectors import Sectors
from ..guards.memory import memory_left, refuse_beyond
from ..linear.analysis import FactorMemory
from ..linear.dense import entries_owned
from ..linear.factor import Factor
from ..linear.joint_springs import ANALYSED
from ..modes.shift_invert import basis_of_planes, basis_size
from .settings import ReductionSettings

if TYPE_CHECKING:
    from mpi4py import MPI

# bytes per entry of K, of the arrays in memory at the same time; M has a third of the entries
HELD = (1.0 + 1.0 / 3.0) * 12.0  # K and M in PETSc
ENTERED = 8.0  # one triangle of K_L - sigma M, passed to MUMPS with indices
PICKED = 24  # modes assumed if the program chooses their number
TOGETHER, SHARE = 13, 0.25  # nodal diameters in lockstep, and the part of the memory left that their searches may take
VECTORS = 3  # blocks of the modes' size in addition to the basis of the eigensolver


def memory_of_modes(K: PETSc.Mat, settings: ReductionSettings, factor: FactorMemory | None) -> float:
    """Return the memory of the modes and of the proof that none is missing on this rank, without the factor [bytes].  Local.

    The proof comes last and needs the fronts of another factorisation.  ``factor`` is None if its size is not known.
    """
    n_owned, n_dof = K.getLocalSize()[0], K.getSize()[0]
    n_modes = min(settings.modes or PICKED, n_dof)
    vectors = 8.0 * n_owned * (basis_size(n_modes, n_dof) + VECTORS * n_modes)
    entries = entries_owned(K)
    proof = 0.0 if factor is None or not settings.verify_modes else of_proof(entries, factor.out_of_core, K.comm.size)
    return vectors + max(proof, of_energies(n_dof, n_modes))


def refuse_modes(K_L: PETSc.Mat, factor: Factor, settings: ReductionSettings) -> None:
    """Raise ResourceError if the modes and their proof do not fit into memory with the factor, before they are computed.

    Collective.

    Raises
    ------
    ResourceError : on every rank
    """
    needed = memory_of_modes(K_L, settings, factor.info.get("memory"))
    advice = "state fewer [solver] modes, use more ranks on more machines, or a coarser mesh"
    if settings.verify_modes:
        advice += "; verify_modes = false leaves out the proof that no mode is missing, which takes a second factorisation"
    refuse_beyond(
        K_L.comm.tompi4py(), needed, f"{settings.where}: {min(settings.modes or PICKED, K_L.getSize()[0])} modes", advice
    )


def of_energies(n_dof: int, n_modes: int) -> float:
    """Return the memory of the modes of all ranks on one, for the eigenvalues: messages, parts and whole [bytes].  Local."""
    return 32.0 * n_dof * n_modes


def of_proof(entries: float, fronts: float, n_ranks: int) -> float:
    """Return the memory of the proof that no mode is missing: K_L - sigma M passed to MUMPS, with its graph or fronts.  Local."""
    return max(ANALYSED[n_ranks > 1] * entries, ENTERED * entries + fronts)


def memory_of_diameter(sectors: Sectors, n_modes: int, n_dof: int) -> float:
    """Return the memory of a nodal diameter during its eigenvalue search, on all ranks [bytes].  Local.

    The space of the search, in real form, and one triangle on the rows that a face depends on.
    """
    n_face = len(np.unique(sectors.unfolding.P[1].indices))
    return 16.0 * (n_dof * basis_of_planes(n_modes, n_dof) + 0.5 * n_face * (n_face + 1))


def diameters_together(of_one: float, comm: MPI.Comm) -> int:
    """Return the number of nodal diameters whose searches are in memory at once, ``of_one`` [bytes] each.  Collective."""
    return int(np.clip(SHARE * memory_left(comm) / of_one, 1, TOGETHER))
