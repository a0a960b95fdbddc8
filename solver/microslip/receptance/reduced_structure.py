"""What a reduction makes of a structure: the receptance of its pairs, loads and outputs, whatever acts on it and how fast.

That of harmonic n between any two of them with modal participations x, y is (docs/theory.md, eq. (4.1))

    A_n(omega) = A_static + x c_n(omega) y^T,

with c_n of the modal family of the harmonic (receptance/damping.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .family import ModalFamily
from .observed import Observed
from .static_columns import StaticColumns

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedStructure:
    """Modal families and static residuals, seen from pairs, loads and outputs: docs/theory.md, eq. (4.1).

    Everything is replicated except the columns of ``G_static``, whose rows live with their pairs.
    """

    comm: MPI.Comm
    pair_ranges: np.ndarray  # (size + 1,) rank r owns pairs pair_ranges[r]:pair_ranges[r + 1]
    families: tuple[ModalFamily, ...]  # exactly one of them serves a harmonic
    G_static: StaticColumns  # columns of R K_L^-1 R^T, solved for on demand; rows of this rank's pairs
    du_static: np.ndarray  # (3 n_pairs, n_loads) R K_L^-1 f
    out_static: np.ndarray  # (n_outputs, n_loads) o K_L^-1 f
    out_R: np.ndarray  # (n_outputs, 3 n_pairs) o K_L^-1 R^T
    load_static: np.ndarray  # (n_loads, n_loads) f^T K_L^-1 f
    observed: Observed | None = None  # what makes outputs of their rows; None: they are displacements

    @property
    def n_pairs(self) -> int:
        return len(self.du_static) // 3

    @property
    def n_outputs(self) -> int:
        return len(self.out_static)

    @property
    def omega_n(self) -> np.ndarray:
        """Natural frequencies of all families, one after the other, (n,) [rad/s]."""
        return np.concatenate([family.omega_n for family in self.families])

    @property
    def zeta(self) -> np.ndarray:
        """Damping ratios of the same modes, (n,) [-]."""
        return np.concatenate([family.zeta for family in self.families])

    @property
    def n_modes(self) -> int:
        """Modes that a harmonic has, at most."""
        return max(len(family.omega_n) for family in self.families)

    @property
    def one_family(self) -> ModalFamily:
        """The family of every harmonic, for what knows modes of one kind alone; there must be no other."""
        (family,) = self.families
        return family

    @cached_property
    def owned(self) -> slice:
        """The pairs of this rank."""
        return slice(self.pair_ranges[self.comm.rank], self.pair_ranges[self.comm.rank + 1])

    @cached_property
    def owned_rows(self) -> slice:
        """Rows of the pairs of this rank."""
        return slice(3 * self.owned.start, 3 * self.owned.stop)

    def output_factors(self, n_omega: float) -> np.ndarray | float:
        """Return what the rows of the outputs are multiplied by at n omega, in size: 1 of displacements, (n_outputs,).  Local."""
        return 1.0 if self.observed is None else self.observed.factors(n_omega)
