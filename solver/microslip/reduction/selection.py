"""Which contact pairs a method lets slip at the next frequency point (docs/theory.md, section 8).

Algorithm 1 of Yuan et al. (2020) starts with all pairs in the set B and updates B once a point, from the last solution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..contact.law import OPEN


class Selection(Protocol):
    """What continuation needs of a method: its set B and the size of its reduced model."""

    @property
    def checks_in_point(self) -> bool:
        """Whether all pairs are evaluated at each converged point, and those that want to slip are let slip there."""

    def first(self, n_pairs: int) -> np.ndarray:
        """Return B of the first point, (n_pairs,) bool."""

    def update(self, moves: np.ndarray, state: np.ndarray, energy: np.ndarray) -> np.ndarray:
        """Return B of the next point from the last solution over all pairs.

        Parameters
        ----------
        moves : (n_pairs,) bool, p is not zero
        state : (n_pairs,) STICK, SLIP, OPEN
        energy : (n_pairs,) friction loss [J per cycle]
        """

    def unknowns(self, n_selected: int, n_modes: int, N_H: int) -> int:
        """Return the number of unknowns of the reduced model with ``n_selected`` pairs in B."""


@dataclass(frozen=True)
class NonStickingPairs:
    """`adaptive`: the pairs with dp != 0 in the last solution."""

    checks_in_point: bool = False

    def first(self, n_pairs: int) -> np.ndarray:
        return np.ones(n_pairs, dtype=bool)

    def update(self, moves: np.ndarray, state: np.ndarray, energy: np.ndarray) -> np.ndarray:
        return moves

    def unknowns(self, n_selected: int, n_modes: int, N_H: int) -> int:
        return (n_modes + 3 * n_selected) * N_H


@dataclass(frozen=True)
class DissipatingPairs(NonStickingPairs):
    """`adaptive-energy`: the pairs that dissipate more than ``energy_tolerance`` a cycle, and all that separate."""

    energy_tolerance: float = 0.0

    def update(self, moves: np.ndarray, state: np.ndarray, energy: np.ndarray) -> np.ndarray:
        return (energy > self.energy_tolerance) | (state == OPEN)


@dataclass(frozen=True)
class AllPairs:
    """No pair is ever dropped.

    The unknowns are the harmonics of du, or of the reduced model's ``coordinates``, if it has its own; these are condensed
    exactly to du before anything is solved.
    """

    checks_in_point: bool = False
    coordinates: int | None = None

    def first(self, n_pairs: int) -> np.ndarray:
        return np.ones(n_pairs, dtype=bool)

    def update(self, moves: np.ndarray, state: np.ndarray, energy: np.ndarray) -> np.ndarray:
        return np.ones(len(moves), dtype=bool)

    def unknowns(self, n_selected: int, n_modes: int, N_H: int) -> int:
        return (3 * n_selected if self.coordinates is None else self.coordinates) * N_H
