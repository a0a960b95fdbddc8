"""The result of a reduction: the receptance of pairs, loads and outputs, independent of loads and frequency."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..parallel.ownership import split_evenly
from .observed import Observed
from .per_group import PerGroup
from .receptance import Receptance
from .springs import SpringUpdate
from .static_columns import StaticColumns

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedStructure:
    """The receptance of each harmonic group, computed on demand.

    Everything is replicated except the columns of ``G_static``, whose rows are on the owners of the pairs.
    """

    comm: MPI.Comm
    n_pairs: int
    n_outputs: int
    receptances: PerGroup[Receptance]
    observed: Observed | None = None  # the map from rows to outputs; None: outputs are displacements
    spring_updates: PerGroup[SpringUpdate] | None = None  # updates to another contact stiffness
    n_sectors: int = 1  # of a disc whose sectors may differ; the pairs of a sector are consecutive, and as many in each

    def receptance_of(self, n: int) -> Receptance:
        """Return the receptance of harmonic n.  Collective if its group is not computed yet."""
        return self.receptances.of(n)

    @property
    def static_columns(self) -> list[StaticColumns]:
        """The static columns of the groups computed so far.  Local."""
        return [receptance.static.G_static for receptance in self.receptances.computed]

    @cached_property
    def pair_ranges(self) -> np.ndarray:
        """Rank r owns the pairs ``pair_ranges[r]`` to ``pair_ranges[r + 1]`` - 1, (size + 1,)."""
        return split_evenly(self.n_pairs, self.comm.size)

    @cached_property
    def owned(self) -> slice:
        """The pairs of this rank."""
        return slice(self.pair_ranges[self.comm.rank], self.pair_ranges[self.comm.rank + 1])

    @cached_property
    def owned_rows(self) -> slice:
        """Rows of the pairs of this rank."""
        return slice(3 * self.owned.start, 3 * self.owned.stop)

    def output_factors(self, n_omega: float) -> np.ndarray | float:
        """Return the magnitude of the factors of output rows at n omega: 1 for displacements, (n_outputs,).  Local."""
        return 1.0 if self.observed is None else self.observed.factors(n_omega)
