"""Sliders of pairs, and the variation of their forces along a periodic motion: the internal variables in the map of one cycle.

docs/theory.md, section 16.  The internal variables of every law are the forces of elastic-Coulomb elements, one or more per pair.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ._return_map import SpringPairs, vary

MOST_PERIODS = 20  # after which the position of a slider that still drifts is used
_DERIVATIVES = 16  # of p_t (2,) by p_t (2,) and by the motion at both ends of a step (3,)


@dataclass(frozen=True, eq=False)
class SliderVariation:
    """Derivatives of p_t of n sliders that slip in a cycle, by their own p_t and by the motion of their pairs, for each step.

    docs/theory.md, section 16.  The axis of length 3 has p_t (2,) at the end of a step, and begin and end of the linear course
    that acts on the modes as p_t does.  The last axis: by p_t at the start of the step (2, 2) [-], by the motion at the start
    and at the end (2, 3) [N/m].
    """

    pair: np.ndarray  # (n,) pair of each slider
    stiffness: np.ndarray  # (n, 2) [N/m]
    derivatives: np.ndarray  # (n, n_steps, 3, 16)
    n_stuck: int  # number of sliders that never slip; the arrays omit them


@dataclass(frozen=True, eq=False)
class Sliders:
    """Elastic-Coulomb elements of pairs: p_t of a pair is the sum of their p_t and of a history-independent part."""

    parameters: SpringPairs  # for the compiled march
    stiffness: np.ndarray  # (n, 2) [N/m]
    pair: np.ndarray  # (n,) pair of each slider

    def of_pairs(self, pairs: np.ndarray) -> Sliders:
        """Return the same sliders with their pairs renumbered: new numbers ``pairs`` (n_pairs,).  Local."""
        return replace(self, pair=pairs[self.pair])

    def variation(self, du: np.ndarray, n_steps: int) -> SliderVariation:
        """Return how p_t varies in each of ``n_steps`` steps of a periodic motion ``du`` (n_pairs, n_samples, 3) [m].  Local.

        docs/theory.md, eq. (16.2).  A step consists of n_samples / n_steps samples, and places between two of them where
        the state of a pair changes; a variation of the motion is linear in it.
        """
        n = len(self.pair)
        M, sticks = np.zeros((n, n_steps, 3, _DERIVATIVES)), np.zeros(n, dtype=np.uint8)
        if n > 0:
            pair, du = np.ascontiguousarray(self.pair, dtype=np.intp), np.ascontiguousarray(du)
            moves = np.empty(du.shape[1], dtype=np.uint8)
            vary(self.parameters, pair, du, du.shape[1] // n_steps, MOST_PERIODS, M, sticks, moves)
        slips = np.flatnonzero(sticks == 0)
        return SliderVariation(self.pair[slips], self.stiffness[slips], M[slips], n - len(slips))
