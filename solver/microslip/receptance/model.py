"""What a reduction hands to harmonic balance: the receptance of the pairs, loads and outputs in modal and static parts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..fourier.harmonics import Harmonics
from ..parallel.errors import CaseError
from .static_columns import StaticColumns


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """Modes of (K_L, M) and static residuals, seen from pairs, loads and outputs (docs/theory.md, section 4).

    Everything is replicated except the columns of ``G_static``, whose rows live with their pairs.
    """

    comm: Any
    pair_ranges: np.ndarray  # (size + 1,) rank r owns pairs pair_ranges[r]:pair_ranges[r + 1]
    omega_n: np.ndarray  # (n_phi,) rad/s
    C: np.ndarray  # phi^T C phi [1/s]: (n_phi,) 2 zeta omega_n of modal damping, or the full (n_phi, n_phi)
    r: np.ndarray  # (3 n_pairs, n_phi) R phi
    b: np.ndarray  # (n_phi, n_loads) phi^T f
    o: np.ndarray  # (n_outputs, n_phi) output rows times phi
    G_static: StaticColumns  # columns of R K_L^-1 R^T, solved for on demand; rows of this rank's pairs
    du_static: np.ndarray  # (3 n_pairs, n_loads) R K_L^-1 f
    out_static: np.ndarray  # (n_outputs, n_loads) o K_L^-1 f
    out_R: np.ndarray  # (n_outputs, 3 n_pairs) o K_L^-1 R^T
    load_static: np.ndarray  # (n_loads, n_loads) f^T K_L^-1 f
    f: np.ndarray  # (n_loads, N_H) Fourier coefficients of the loads at unit level
    harmonics: Harmonics  # those of every motion and force, in whose order coefficients run
    H_recorded: int = 1  # results have the harmonics 0 to this one at least

    @property
    def n_pairs(self) -> int:
        return self.r.shape[0] // 3

    @property
    def n_modes(self) -> int:
        return len(self.omega_n)

    @property
    def zeta(self) -> np.ndarray:
        """Damping ratios, (n_phi,) [-]; of a full C its diagonal."""
        diagonal = self.C if self.C.ndim == 1 else np.diag(self.C)
        return diagonal / (2.0 * self.omega_n)

    @property
    def N_H(self) -> int:
        return self.harmonics.n_coefficients

    @property
    def recorded(self) -> Harmonics:
        """The full set 0, 1, ..., H of results: all harmonics ever used, and harmonic 1, zero where it is not."""
        return Harmonics.up_to(max(self.H_recorded, self.harmonics.highest))

    def with_harmonics(self, harmonics: Harmonics) -> ReducedModel:
        """Return the same model on another set of harmonics; all else is shared, the static columns too.  Local.

        Raises
        ------
        CaseError : a load acts in a harmonic that is not in the set
        """
        loaded = [n for n in self.harmonics.chosen if self.f[:, self.harmonics.columns(n)].any()]
        left_out = [n for n in loaded if n not in harmonics]
        if left_out:
            raise CaseError(f"[[loads]] acts in harmonic {left_out[0]}, which is not one of the harmonics {harmonics}")
        if harmonics == self.harmonics:
            return self
        f = self.harmonics.carry(self.f, harmonics)
        return replace(self, f=f, harmonics=harmonics, H_recorded=self.recorded.highest)

    def with_damping(self, sigma: float) -> ReducedModel:
        """Return the same model with sigma M [1/s] added to its damping matrix; all else is shared.  Local."""
        return replace(self, C=self.C + (sigma if self.C.ndim == 1 else sigma * np.eye(self.n_modes)))

    @property
    def owned(self) -> slice:
        """The pairs of this rank."""
        return slice(self.pair_ranges[self.comm.rank], self.pair_ranges[self.comm.rank + 1])

    @property
    def owned_rows(self) -> slice:
        """Rows of the pairs of this rank."""
        return slice(3 * self.owned.start, 3 * self.owned.stop)
