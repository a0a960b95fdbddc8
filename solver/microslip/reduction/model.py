"""What a reduction hands to harmonic balance: the receptance of the pairs, loads and outputs in modal and static parts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class ReducedModel:
    """Modes of (K_L, M) and static residuals, seen from pairs, loads and outputs (docs/theory.md, section 4).

    Everything is replicated except ``G_static_owned``, whose rows live with their pairs.
    """

    comm: Any
    pair_ranges: np.ndarray     # (size + 1,) rank r owns pairs pair_ranges[r]:pair_ranges[r + 1]
    omega_n: np.ndarray         # (n_phi,) rad/s
    zeta: np.ndarray            # (n_phi,) -
    r: np.ndarray               # (3 n_pairs, n_phi) R phi
    b: np.ndarray               # (n_phi, n_loads) phi^T f
    o: np.ndarray               # (n_outputs, n_phi) output rows times phi
    G_static_owned: np.ndarray  # (3 n_pairs_owned, 3 n_pairs) R K_L^-1 R^T [m/N]
    du_static: np.ndarray       # (3 n_pairs, n_loads) R K_L^-1 f
    out_static: np.ndarray      # (n_outputs, n_loads) o K_L^-1 f
    out_R: np.ndarray           # (n_outputs, 3 n_pairs) o K_L^-1 R^T

    @property
    def n_pairs(self) -> int:
        return self.r.shape[0] // 3

    @property
    def owned(self) -> slice:
        """Rows of the pairs of this rank."""
        first, last = self.pair_ranges[self.comm.rank], self.pair_ranges[self.comm.rank + 1]
        return slice(3 * first, 3 * last)
