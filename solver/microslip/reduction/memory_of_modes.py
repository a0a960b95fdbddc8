"""Memory of the modes and of the proof that none is missing, without the factor: forecast, and refused if not available."""

from petsc4py import PETSc

from ..guards.memory import refuse_beyond
from ..linear.analysis import FactorMemory
from ..linear.dense import entries_owned
from ..linear.factor import Factor
from ..modes.shift_invert import basis_size
from .settings import ReductionSettings

# bytes per entry of K, of the arrays in memory at the same time; M has a third of the entries
HELD = (1.0 + 1.0 / 3.0) * 12.0  # K and M in PETSc
ENTERED = 8.0  # one triangle of K_L - sigma M, passed to MUMPS with indices
MERGED = HELD + ENTERED  # the same while it is assembled from rows of K_L and M
SHARPENED = 1e8  # bytes of some rows of K_L, copied and in extended precision, for the eigenvalues
PICKED = 24  # modes assumed if the program chooses their number
VECTORS = 3  # blocks of the modes' size in addition to the basis of the eigensolver


def memory_of_modes(K: PETSc.Mat, settings: ReductionSettings, factor: FactorMemory | None) -> float:
    """Return the memory of the modes and of the proof that none is missing on this rank, without the factor [bytes].  Local.

    The proof comes last and needs the fronts of another factorisation.  ``factor`` is None if its size is not known.
    """
    n_owned, n_dof = K.getLocalSize()[0], K.getSize()[0]
    n_modes = min(settings.modes or PICKED, n_dof)
    vectors = 8.0 * n_owned * (basis_size(n_modes, n_dof) + VECTORS * n_modes)
    entries = entries_owned(K)
    proof = 0.0 if factor is None or not settings.verify_modes else of_proof(entries, factor.out_of_core)
    return vectors + max(proof, SHARPENED)


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


def of_proof(entries: float, fronts: float) -> float:
    """Return the memory of the proof that no mode is missing: K_L - sigma M as passed to MUMPS, then with its fronts.  Local."""
    return max(MERGED * entries, ENTERED * entries + fronts)
