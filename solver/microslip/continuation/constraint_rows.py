"""Constraint rows beside the harmonic-balance equations: one for each parameter of the problem (docs/theory.md, section 7).

Unknowns are scaled: xi = U / its unit, nu = parameters / theirs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .iterate import Iterate


@dataclass(frozen=True, eq=False)
class Scaling:
    """Units of the unknowns in SNES and in the arc-length norm, and weights of the rows of the residual."""

    U: float  # m
    parameters: tuple[float, ...]  # rad/s, N, ...
    rows: np.ndarray | float = 1.0  # (n_owned, 3, 1) -, at least 1; see ``row_weights``
    weight: float = 1.0  # the largest of all ranks' rows


class Constraint(Protocol):
    """A scalar equation g(xi, nu) = 0.  What belongs to the motion is summed over the ranks before ``value`` is asked for."""

    def of_motion(self, U: np.ndarray, scaling: Scaling) -> float:
        """Return this rank's part of g, of its rows of the motion.  Local."""

    def value(self, of_motion: float, nu: np.ndarray, scaling: Scaling) -> float:
        """Return g, from the sum of the ranks' parts and the parameters nu (k,).  Local; the same on all ranks."""

    def gradient(self, U: np.ndarray, scaling: Scaling) -> tuple[np.ndarray, np.ndarray]:
        """Return d g / d xi (n_owned, 3, N_H) of this rank and d g / d nu (k,).  Local."""


@dataclass(frozen=True, eq=False)
class Plane:
    """n_U . (xi - xi_0) + n_nu . (nu - nu_0) = 0, eq. (7.2), linear, through the iterate ``about``."""

    about: Iterate
    n_U: np.ndarray  # (n_owned, 3, N_H) -
    n_nu: tuple[float, ...]  # (k,) -

    @classmethod
    def fixed_parameter(cls, about: Iterate) -> Plane:
        """Return the row that holds the first parameter at its value."""
        n_nu = np.zeros(len(about.parameters))
        n_nu[0] = 1.0
        return cls(about, np.zeros_like(about.U), tuple(n_nu))

    def of_motion(self, U: np.ndarray, scaling: Scaling) -> float:
        return float(np.vdot(self.n_U, U - self.about.U)) / scaling.U

    def value(self, of_motion: float, nu: np.ndarray, scaling: Scaling) -> float:
        terms = (n * (v - about / unit) for n, v, about, unit in zip(self.n_nu, nu, self.about.parameters, scaling.parameters))
        return of_motion + sum(terms)

    def gradient(self, U: np.ndarray, scaling: Scaling) -> tuple[np.ndarray, np.ndarray]:
        return self.n_U, np.array(self.n_nu)
