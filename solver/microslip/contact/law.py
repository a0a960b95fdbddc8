"""Parameters and states of contact pairs: two coupled Jenkins elements and a normal spring (docs/theory.md, section 3).

The compiled kernel of ``harmonic/aft.py`` marches their law through two periods, with derivatives; ``transient/return_map.py``
has it over a step of time.  Each Jenkins element is a spring ``k_t`` in series with a slider at position ``w``:
T = k_t (du_t - w).  In this form p_t = T - k_t du_t = -k_t w is exactly zero, free of roundoff, until the slider moves for the
first time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STICK, SLIP, OPEN = 0, 1, 2


@dataclass(frozen=True)
class ContactParameters:
    """Parameters of ``n`` contact pairs, contiguous arrays (n,); ValueError if one is negative or misshapen."""

    mu: np.ndarray  # friction coefficient [-]
    N0: np.ndarray  # normal preload [N]; negative states an initial gap -N0 / k_n
    k_t: np.ndarray  # tangential stiffness [N/m]
    k_n: np.ndarray  # normal stiffness [N/m]
    separate: np.ndarray  # bool: each tangential direction has its own friction limit

    def __post_init__(self):
        n = np.size(self.k_t)
        for name in ("mu", "N0", "k_t", "k_n", "separate"):
            kind = bool if name == "separate" else np.float64
            values = np.ascontiguousarray(getattr(self, name), dtype=kind)
            if values.shape != (n,):
                raise ValueError(f"{name} has shape {values.shape}, needs ({n},) like k_t")
            if name in ("mu", "k_t", "k_n") and np.any(values < 0.0):
                raise ValueError(f"{name} of pair {np.nanargmin(values)} is negative: {np.nanmin(values)}")
            object.__setattr__(self, name, values)

    @property
    def n_pairs(self) -> int:
        return len(self.k_t)

    @property
    def stiffness(self) -> np.ndarray:
        return np.stack([self.k_t, self.k_t, self.k_n], axis=1)

    def take(self, indices) -> ContactParameters:
        """Return the parameters of some pairs: an index array, a mask or a slice.  Local."""
        return ContactParameters(self.mu[indices], self.N0[indices], self.k_t[indices], self.k_n[indices], self.separate[indices])
