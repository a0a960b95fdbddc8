"""Which contact pairs a method lets slip at the next frequency point (docs/theory.md, section 8).

Algorithm 1 of Yuan et al. (2020) starts with all pairs in the set B and updates B once a point, from the last solution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..contact.law import OPEN


class Selection(Protocol):
    """The set B of a method and the size of its reduced model, for continuation."""

    @property
    def checks_in_point(self) -> bool:
        """Whether all pairs are evaluated at each converged point, and pairs beyond their friction limit join B there."""

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

    def unknowns(self, selected: np.ndarray, moves: np.ndarray, n_modes: int, N_H: int) -> int:
        """Return the size of the reduced model at a point, with ``selected`` pairs in B and p not zero in those that move."""


@dataclass(frozen=True)
class NonStickingPairs:
    """`adaptive`: the pairs with dp != 0 in the last solution."""

    checks_in_point: bool = False

    def first(self, n_pairs: int) -> np.ndarray:
        """Return all pairs, (n_pairs,) bool.  Local."""
        return np.ones(n_pairs, dtype=bool)

    def update(self, moves: np.ndarray, state: np.ndarray, energy: np.ndarray) -> np.ndarray:
        """Return the pairs with p not zero, (n_pairs,) bool.  Local."""
        return moves

    def unknowns(self, selected: np.ndarray, moves: np.ndarray, n_modes: int, N_H: int) -> int:
        """Return N_H times the number of modes and of components of the selected pairs.  Local."""
        return (n_modes + 3 * int(selected.sum())) * N_H


@dataclass(frozen=True)
class DissipatingPairs(NonStickingPairs):
    """`adaptive-energy`: the pairs that dissipate more than ``energy_tolerance`` a cycle, and all that separate."""

    energy_tolerance: float = 0.0

    def update(self, moves: np.ndarray, state: np.ndarray, energy: np.ndarray) -> np.ndarray:
        """Return the pairs that dissipate more than the tolerance or are open, (n_pairs,) bool.  Local."""
        return (energy > self.energy_tolerance) | (state == OPEN)


@dataclass(frozen=True)
class AllPairs:
    """No pair is ever dropped.

    The unknowns are the ``coordinates`` of the reduced model, which are condensed exactly to du before anything is solved; None:
    the harmonics of du.  The motion of pairs with p = 0 follows from p of the others, du = du_lin - G p, without an equation to
    solve, so that only pairs with p not zero count.
    """

    checks_in_point: bool = False
    coordinates: int | None = None

    def first(self, n_pairs: int) -> np.ndarray:
        """Return all pairs, (n_pairs,) bool.  Local."""
        return np.ones(n_pairs, dtype=bool)

    def update(self, moves: np.ndarray, state: np.ndarray, energy: np.ndarray) -> np.ndarray:
        """Return all pairs, (n_pairs,) bool.  Local."""
        return np.ones(len(moves), dtype=bool)

    def unknowns(self, selected: np.ndarray, moves: np.ndarray, n_modes: int, N_H: int) -> int:
        """Return N_H times the number of coordinates, or of components of the pairs with p not zero.  Local."""
        return (3 * int(moves.sum()) if self.coordinates is None else self.coordinates) * N_H
