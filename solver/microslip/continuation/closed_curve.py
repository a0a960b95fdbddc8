"""Detection of a branch on a closed curve, which a long step has reached (docs/theory.md, section 7)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..points.branch import Point

ROUNDS, AGAIN = 3, 5  # points in a row on the steps of this number of earlier rounds: a single point may leave at the next corner
NEAR = 0.3  # of an earlier step: distance from it


def goes_round(points: Sequence[Point]) -> bool:
    """Return whether the last points of a branch lie on earlier steps, passed in the same direction.  Local, on rank 0."""
    last = range(len(points) - AGAIN, len(points))
    return last.start > ROUNDS * AGAIN and all(_rounds(points, k) >= ROUNDS for k in reversed(last))


def _rounds(points: Sequence[Point], k: int) -> int:
    """Return in how many earlier rounds the branch passed its ``k``-th point.  Local."""
    place, rounds, last = np.array([(point.parameters or (point.omega,))[0] for point in points[: k + 1]]), 0, -AGAIN
    steps, way = np.diff(place[:-1]), place[-1] - place[-2]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (place[-1] - place[:-2]) / steps
    for i in np.flatnonzero((share >= 0.0) & (share <= 1.0) & (steps * way > 0.0)):
        N_H = min(points[n].U.shape[-1] for n in (i, i + 1, k))  # points may differ in their harmonics
        first, second, here = (points[n].U[..., 1:N_H] for n in (i, i + 1, k))
        chord = second - first
        is_near = np.linalg.norm(here - first - share[i] * chord) <= NEAR * np.linalg.norm(chord)
        if is_near and i >= last + AGAIN:
            rounds, last = rounds + 1, i
    return rounds
