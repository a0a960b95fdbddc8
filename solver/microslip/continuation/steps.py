"""Step lengths: the arc-length norm, the length of the linear curve, growth and halving.

The norm of a step from (U, omega) is relative (docs/theory.md, section 7),

    ds^2 = |Delta U'|^2 / |U|^2 + (Delta omega / omega_scale)^2,

with U' the harmonics above the mean: equal steps are equal turns of phase and equal ratios of amplitude, a resonance is
resolved equally at every level and height, and a straight flank costs few points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..messages.errors import CaseError

if TYPE_CHECKING:
    from mpi4py import MPI

MANY_RESONANCES = 8  # in a range, beyond which the points of their grids are thinned
SHARPEST = 0.35  # rad between two steps at which a step selected by accuracy grows no further


@dataclass(frozen=True, kw_only=True)
class ArcLength:
    """Step lengths in the relative norm [-]."""

    ds: float
    ds_min: float
    ds_max: float
    turn: float = 0.12  # rad between two steps at which ds is unchanged: on a straighter branch it grows
    easy: int = 4  # Newton iterations at which ds is unchanged

    def __post_init__(self) -> None:
        if not 0.0 < self.ds_min <= self.ds <= self.ds_max:
            raise CaseError(
                f"[continuation] needs 0 < ds_min <= ds <= ds_max, got ds_min = {self.ds_min:g}, "
                f"ds = {self.ds:g}, ds_max = {self.ds_max:g}"
            )

    def next(self, ds: float, newton: int, turn: float) -> float:
        """Return the length of the next step after one that converged."""
        by_curve = self.turn / max(turn, 1e-3)
        by_newton = (self.easy / max(newton, 1)) ** 0.5
        factor = min(max(min(by_curve, by_newton), 0.5), 1.5)
        # the curve alone never needs less than ds: that length already resolves the linear resonance
        smallest = self.ds if by_newton >= 1.0 else self.ds_min
        return min(max(ds * factor, min(smallest, 1.5 * ds)), self.ds_max)

    def divided(self, number: int) -> ArcLength:
        """Return steps whose lengths are divided by a number.  Local."""
        return replace(self, ds=self.ds / number, ds_min=self.ds_min / number, ds_max=self.ds_max / number)

    def stretched(self, ds: float, newton: int, turn: float, stretch: float) -> float:
        """Return the length of the next step, ``stretch`` times the last one as far as turn and Newton's iterations allow."""
        by_newton = (self.easy / max(newton, 1)) ** 0.5
        by_turn = SHARPEST / max(turn, 1e-3)
        return min(max(ds * min(stretch, max(min(by_newton, by_turn), 0.5)), self.ds_min), self.ds_max)


@dataclass(frozen=True)
class LinearCurve:
    """The response with every pair stuck, at one newton of level."""

    omega: np.ndarray  # (n,) rad/s
    response: np.ndarray  # (n, n_outputs, N_H) m/N, the harmonics that are recorded
    s: np.ndarray  # (n,) its length up to each point, in the norm of the steps
    sticks_up_to: np.ndarray  # (n,) N, a level up to which no pair leaves sticking there; 0 where that is not known


def linear_frequencies(low: float, high: float, omega_n: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """Return frequencies [rad/s] between ``low`` and ``high`` that resolve every resonance in between.  Local."""
    grids, resonances = [np.linspace(low, high, 60)], []
    for w, z in zip(omega_n, zeta):
        if low < w < high:
            half = w * max(z, 1e-6)
            reach = np.arcsinh((high - low) / half)
            grids.append(w + half * np.sinh(np.linspace(-reach, reach, 240)))
            resonances.append((w, half, 2.0 * reach / 239.0))
    grid = np.unique(np.concatenate(grids))
    grid = grid[(grid >= low) & (grid <= high)]
    if len(resonances) <= MANY_RESONANCES:
        return grid
    return _thinned(grid, np.min([step * np.hypot(half, grid - w) for w, half, step in resonances], axis=0))


def _thinned(grid: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return the grid without points whose neighbours are no further from each other than ``distance`` there.  Local.

    The resonances of a blade family are so close that the grid of each covers all others.
    """
    chosen = [0]
    for i in range(1, len(grid) - 1):
        if grid[i + 1] - grid[chosen[-1]] > distance[i]:
            chosen.append(i)
    return grid[[*chosen, len(grid) - 1]]


def arc_lengths(comm: MPI.Comm, motions: list[np.ndarray], omegas: np.ndarray, omega_scale: float) -> np.ndarray:
    """Return the length of a sampled curve up to each of its points, (n,), in the relative norm, eq. (7.1).

    Collective on ``comm``.  ``motions`` holds this rank's rows at each of ``omegas``.

    Raises
    ------
    CaseError : the response is infinite at one of them: a resonance without damping; on every rank
    """
    squares = [[float(np.vdot(b - a, b - a)), float(np.vdot(b, b))] for a, b in zip(motions, motions[1:])]
    difference, size = comm.allreduce(np.array(squares)).T
    infinite = np.flatnonzero(~np.isfinite(difference + size))
    if len(infinite):
        i = infinite[0] + int(not np.isfinite(size[infinite[0]]))  # one of the two ends of the piece
        raise CaseError(
            f"[response] {omegas[i] / 2 / np.pi:.9g} Hz lies on a resonance of the stuck structure, which "
            "has no damping there: its linear response is infinite; state [damping], or begin away from the resonance"
        )
    relative = np.divide(difference, size, out=np.zeros_like(size), where=size > 0.0)
    pieces = np.sqrt(relative + (np.diff(omegas) / omega_scale) ** 2)
    return np.concatenate([[0.0], np.cumsum(pieces)])
