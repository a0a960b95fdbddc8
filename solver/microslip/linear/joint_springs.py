"""The structure with every contact pair stuck: K_L = K + R^T K_J R, and its factor."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from ..assembly.sectors import Sectors
from ..assembly.system import System
from ..assembly.wave_matrix import WaveMatrix
from ..guards.memory import refuse_beyond
from ..mesh.data import ContactPairs
from ..messages.errors import CaseError
from ..parallel.petsc import free
from .analysis import FactorMemory
from .dense import add_springs, add_to, entries_owned, frobenius_norm, wave_matrix
from .factor import Factor, FactorCache
from .mumps import ADVICE
from .sector_factor import DiameterFactor, SectorFactor, springs_of

STIFFEST = 1e9  # a spring of a joint over the norm of the stiffness matrix

# bytes an entry of K
STORED = 12.0  # K_L
ANALYSED = (14.0, 28.0)  # the half of it that is passed to MUMPS, and its graph, on one rank and on several


@dataclass(frozen=True)
class Linearised:
    """The stuck structure, ``M u'' + C u' + K_L u + R^T p = f_ex``, rows split as in ``system``: docs/theory.md, eq. (1.4).

    Complex matrices are all in real form, except ``maps``.
    """

    system: System
    K_L: PETSc.Mat  # (n_dof, n_dof) N/m, symmetric positive definite
    M: PETSc.Mat  # (n_dof, n_dof) kg
    factor: Factor  # of K_L
    springs: sp.csr_matrix | None = None  # R^T K_J R [N/m], the same on every rank; None: K_L is no sum with them

    @property
    def maps(self) -> System:
        """The system whose maps are those of the structure, complex where its matrices are in real form."""
        return self.system.maps

    def let_K_go(self) -> None:
        """Free ``system.K``, seldom needed once K_L exists: two fifths of the memory of the matrices.  Collective."""
        self.system.K.destroy()

    def bring_K_back(self) -> None:
        """Compute ``system.K`` again, if it was freed, as K_L - R^T K_J R.  Collective if it was."""
        if not self.system.K:
            assert self.springs is not None, "K_L as linearise() makes it"
            self.K_L.copy(result=self.system.K)
            add_to(self.system.K, -self.springs)
            self.system.K.setOption(PETSc.Mat.Option.SPD, False)

    def destroy(self) -> None:
        """Free K_L and its factor; K and M belong to the system.  Collective."""
        self.factor.destroy()
        free(self.K_L)


def linearise(
    system: System,
    pairs: ContactPairs,
    where: str = "",
    later: Callable[[FactorMemory], float] | None = None,
    cache: FactorCache | None = None,
) -> Linearised:
    """Return the structure with all pairs stuck, K_L of docs/theory.md, eq. (1.3), factored.

    Collective on ``system.comm``.  ``where`` is the scene file, for messages; ``later`` returns the memory needed besides the
    factor, ``cache`` has the factor of an earlier run: :class:`.factor.Factor`.

    Raises
    ------
    CaseError : a matrix or joint stiffness is not a finite number, or K_L is singular (the message names the part that
        moves freely); on every rank
    ResourceError : not enough memory for the factor
    """
    K_J = joint_stiffness(pairs)
    if len(K_J) != system.R.shape[0]:
        raise CaseError(f"R has {system.R.shape[0]} rows for {pairs.n_pairs} pairs; it needs three a pair")
    if system.is_complex:
        system, K_J = system.in_real_form, np.repeat(K_J, 2)
    size = {name: frobenius_norm(matrix) for name, matrix in (("stiffness", system.K), ("mass", system.M))}
    for name, norm in size.items():
        if not np.isfinite(norm):
            raise CaseError(f"the {name} matrix has entries that are not finite numbers; check the material data and the mesh")
    _refuse_too_stiff(pairs.law.stiffness.ravel(), pairs, size["stiffness"], where)
    if system.sectors is not None:
        return _at_diameter(system, joint_stiffness(pairs), where)
    refuse_beyond(system.comm, memory_before_factor(system.K), "K_L, the stiffness with all pairs stuck", ADVICE)
    springs = springs_of(system.R, K_J)
    K_L = add_springs(system.K, springs)
    try:
        factor = Factor(K_L, system, last=np.unique(system.R.indices), later=later, cache=cache, M=system.M)
        return Linearised(system, K_L, system.M, factor, springs)
    except CaseError as problem:
        K_L.destroy()
        raise CaseError(f"{where}: {problem}" if where else str(problem)) from problem


def _at_diameter(system: System, K_J: np.ndarray, where: str) -> Linearised:
    """Return the stuck structure of a nodal diameter, whose factor is that of the sector.  Collective; raises as linearise()."""
    sectors, maps = system.sectors, system.maps
    assert isinstance(sectors, Sectors), "a disc"
    key = "factor", K_J.tobytes()
    if key not in sectors.shared:
        sectors.shared[key] = SectorFactor(sectors, K_J)
    of_sector: SectorFactor = sectors.shared[key]
    if wave_matrix(system.K) is not None:
        K_L, springs = WaveMatrix.matrix(sectors.sector.K, sectors.unfolding, maps.phase, springs_of(maps.R, K_J)), None
    else:
        springs = springs_of(system.R, K_J)
        K_L = add_springs(system.K, springs)
    try:
        factor = Factor(K_L, system, M=system.M, direct=lambda: DiameterFactor.of(of_sector, maps))
    except CaseError as problem:
        K_L.destroy()
        raise CaseError(f"{where}: {problem}" if where else str(problem)) from problem
    return Linearised(system, K_L, system.M, factor, springs)


def memory_before_factor(K: PETSc.Mat) -> float:
    """Return the largest memory of K_L and the analysis of its factor on this rank [bytes].  Local."""
    return analysis_of(entries_owned(K), K.comm.size)


def analysis_of(entries_owned: float, n_ranks: int) -> float:
    """Return the same from this rank's entries of K.  Local."""
    return entries_owned * (STORED + ANALYSED[n_ranks > 1])


def joint_stiffness(pairs: ContactPairs) -> np.ndarray:
    """Return the diagonal of K_J, (3 n_pairs,) [N/m]: the springs of each pair that sticks, along x, y, z.  Local.

    Raises
    ------
    CaseError : a stiffness is negative or not a finite number
    """
    for k in (pairs.k_t, pairs.k_n):
        bad = np.flatnonzero(~(np.isfinite(k) & (k >= 0.0)))
        if len(bad):
            raise CaseError(
                f"[[joints]] {pairs.joint[bad[0]]!r}: contact stiffness {k[bad[0]]} N/m of pair {bad[0]}; "
                "it must be a finite number, not negative"
            )
    return pairs.law.stiffness.ravel()


def _refuse_too_stiff(K_J: np.ndarray, pairs: ContactPairs, size: float, where: str) -> None:
    """Raise CaseError for a spring so stiff that the structure is lost in rounding.  Local; the same on every rank."""
    worst = int(np.argmax(K_J)) if len(K_J) else 0
    if size > 0.0 and len(K_J) and K_J[worst] > STIFFEST * size:
        key = "normal_stiffness" if worst % 3 == 2 else "tangential_stiffness"
        raise CaseError(
            f"{where}: joint {pairs.joint[worst // 3]!r}: {key}: pair {worst // 3} has a spring of {K_J[worst]:.1e} N/m, the "
            f"structure's stiffness matrix a norm of {size:.1e} N/m: next to the spring it is lost in rounding; state at most "
            f"{STIFFEST * size / K_J[worst]:.0e} of that stiffness"
        )
