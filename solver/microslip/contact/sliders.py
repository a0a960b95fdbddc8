"""Sliders of pairs, and the variation of their forces along a periodic motion: the internal variables in the map of one cycle.

docs/theory.md, section 16.  The internal variables of every law are the forces of elastic-Coulomb elements, one or more per pair.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ._return_map import SpringPairs, vary

MOST_PERIODS = 20  # after which the position of a slider that still drifts is used
_BY_MEMORY, _BY_FIRST, _BY_LAST = slice(0, 4), slice(4, 10), slice(10, 16)


@dataclass(frozen=True, eq=False)
class SliderVariation:
    """Derivatives of p_t of n sliders that slip in a cycle, by their own p_t and by the motion of their pairs, for each step.

    docs/theory.md, section 16.  The axis of length 3 has p_t (2,) at the end of a step, its mean over the step, and its mean
    weighted with the time in the step, 0 to 1.
    """

    pair: np.ndarray  # (n,) pair of each slider
    stiffness: np.ndarray  # (n, 2) [N/m]
    by_memory: np.ndarray  # (n, n_steps, 3, 2, 2) by p_t at the start of the step [-]
    by_first: np.ndarray  # (n, n_steps, 3, 2, 3) by the motion at the start [N/m]
    by_last: np.ndarray  # (n, n_steps, 3, 2, 3) by the motion at the end [N/m]
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
        M, sticks = np.zeros((n, n_steps, 3, _BY_LAST.stop)), np.zeros(n, dtype=np.uint8)
        if n > 0:
            pair, du = np.ascontiguousarray(self.pair, dtype=np.intp), np.ascontiguousarray(du)
            moves = np.empty(du.shape[1], dtype=np.uint8)
            vary(self.parameters, pair, du, du.shape[1] // n_steps, MOST_PERIODS, M, sticks, moves)
        slips = np.flatnonzero(sticks == 0)
        by_memory, by_first, by_last = (
            M[slips][..., part].reshape(len(slips), n_steps, 3, 2, (part.stop - part.start) // 2)
            for part in (_BY_MEMORY, _BY_FIRST, _BY_LAST)
        )
        return SliderVariation(self.pair[slips], self.stiffness[slips], by_memory, by_first, by_last, n - len(slips))
