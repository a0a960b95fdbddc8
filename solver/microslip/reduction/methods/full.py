"""`full`: harmonic balance on the unreduced finite-element system, condensed to the pairs; the reference of small scenes.

docs/theory.md, eq. (8.7): V = [phi, Z_0, Z_1, .., Z_j], the lowest modes and the block Krylov space of the static response.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ...guards.memory import memory_left
from ...linear.dense import gram, multiply
from ...messages.errors import CaseError
from ...modes.eigen import Modes
from ...points.band import frequency_band
from ..facts import Facts
from ..galerkin import memory_of_basis, reduce_on_basis
from ..reduction import Reduction
from ..settings import ReductionSettings
from ..stuck import StuckStructure

if TYPE_CHECKING:
    from mpi4py import MPI

    from ...assembly.system import System

ALL_MODES = 1000  # DOFs up to which all modes are computed
MOST_WITH_C = 3000  # the same with a damping matrix: beyond it, `full` is refused
ACCURACY = 1e-13  # of the residual receptance
MOST_RATIO = 0.25  # largest kappa_max / omega_m^2: beyond it, more modes are computed
_LEAST_BLOCKS = 2

FACTS = Facts(lambda _, n: n.dof, knows_range=True)


def check(settings: ReductionSettings, system: System) -> None:
    """Refuse a structure too large for the memory, before any solve.

    Collective on ``system.comm``.

    Raises
    ------
    CaseError : too large for the memory, with the estimate, or for a damping matrix; on every rank
    """
    n_dof, has_C = system.n_dof, system.C is not None
    if has_C and n_dof > MOST_WITH_C:
        raise CaseError(
            f'{settings.where}: [solver] method = "full" with a damping matrix, [model] damping or dampers, needs all modes, '
            f'possible for at most {MOST_WITH_C} DOF; there are {n_dof}. Choose "receptance", or state [damping] in its place'
        )
    n_columns = n_dof if n_dof <= ALL_MODES or has_C else _LEAST_BLOCKS * (system.R.shape[0] + 2)
    _refuse_too_large(settings.where, n_dof, n_columns, system.comm)


def reduce(stuck: StuckStructure, settings: ReductionSettings) -> Reduction:
    """Return the reduction.  Collective: more modes if the range requires them, and the solves of the Krylov space.

    Raises
    ------
    CaseError : too large for the memory; on every rank
    """
    system = stuck.system
    Y = sp.hstack([system.R.T, system.loads, system.outputs.T], format="csc")
    all_modes = system.n_dof if system.n_dof <= ALL_MODES or system.C is not None else None
    if all_modes:
        modes, n_blocks = stuck.lowest_modes(all_modes, allows_fewer=True), 1
    else:
        modes, n_blocks = modes_beyond(stuck, settings)
    _refuse_too_large(settings.where, system.n_dof, len(modes.omega_n) + n_blocks * Y.shape[1], system.comm)
    blocks = krylov_blocks(stuck, modes, Y, n_blocks)
    return reduce_on_basis(stuck, np.hstack([modes.phi_owned, *blocks]), settings, unknowns=system.n_dof, leaves_out="nothing")


def modes_beyond(stuck: StuckStructure, settings: ReductionSettings) -> tuple[Modes, int]:
    """Return modes far enough beyond the range, and the necessary number of blocks of the Krylov space.  Collective."""
    n_dof, modes = stuck.n_dof, stuck.modes
    highest = max(settings.excitation.harmonics.highest, 1) * 2 * np.pi * frequency_band(settings.band, modes.omega_n)[1]
    while (ratio := (highest / modes.omega_n[-1]) ** 2) > MOST_RATIO and len(modes.omega_n) < n_dof:
        modes = stuck.lowest_modes(min(2 * len(modes.omega_n), n_dof), settings.verify_modes, allows_fewer=True)
    return modes, n_blocks_for(ratio)


def n_blocks_for(ratio: float) -> int:
    """Return the smallest number of blocks with ratio^(2 n_blocks) below ``ACCURACY``.  Local."""
    return max(_LEAST_BLOCKS, int(np.ceil(np.log(ACCURACY) / (2.0 * np.log(ratio)))))


def krylov_blocks(stuck: StuckStructure, modes: Modes, Y: sp.csc_matrix, n_blocks: int) -> list[np.ndarray]:
    """Return Z_0 .. Z_(n_blocks - 1) of eq. (8.7), this rank's rows (n_owned, m) each.  Collective: m solves per block."""
    comm, phi_owned = stuck.comm, modes.phi_owned

    def on_complement(Z_owned: np.ndarray) -> np.ndarray:
        return Z_owned - phi_owned @ gram(comm, phi_owned, multiply(stuck.M, Z_owned))

    blocks = [on_complement(stuck.factor.solve(Y))]
    while len(blocks) < n_blocks:
        blocks.append(on_complement(stuck.solve(multiply(stuck.M, blocks[-1]))))
    return blocks


def _refuse_too_large(where: str, n_dof: int, n_columns: int, comm: MPI.Comm) -> None:
    needed, available = memory_of_basis(n_dof, n_columns), memory_left(comm)
    if needed > available:
        raise CaseError(
            f'{where}: [solver] method = "full" needs about {needed / 1e9:.3g} GB for {n_columns} '
            f'columns of {n_dof} DOF, in addition to the factor; {available / 1e9:.3g} GB are free. Choose "receptance", a '
            "coarser mesh, or more memory"
        )
