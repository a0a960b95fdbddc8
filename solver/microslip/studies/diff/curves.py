"""Distance of points from a curve through other points.  NumPy and SciPy only.

The space of a curve has the frequency, in half widths of the resonance, and the coefficients of an output over its peak as
coordinates.  Where a curve turns back in frequency (a fold), the nearest part is compared.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial import cKDTree

from ...results.measures import segments

FINE = 16  # interpolated positions between two points of a curve
_STEPS = 12  # Newton steps of the search for the nearest position
_NEAR = 5  # points on each side included: the interpolation error changes its sign and peaks at corners
_NEARBY = 8.0  # slope per interval with which the estimate increases from 0 at a point to its full value
_FEWEST = 5  # least points of a segment for an estimate from half of them


@dataclass(frozen=True)
class Foot:
    """The nearest positions on a curve to n points."""

    distance: np.ndarray  # (n,) [-]
    place: np.ndarray  # (n,) number of the preceding point of the curve plus the fraction of the way to the next one
    at: np.ndarray  # (n, n_coordinates) coordinates there


def half_width(frequency: np.ndarray, size: np.ndarray) -> float:
    """Return half of the frequency range [Hz] in which a curve is above the peak over the square root of 2.  Local.

    With too few points it is the range of all points.
    """
    high = np.flatnonzero(size >= size.max(initial=0.0) / np.sqrt(2.0))
    near = np.unique(np.clip([high - 1, high, high + 1], 0, len(size) - 1)) if len(high) else high
    for among in (high, near, np.arange(len(size))):
        width = 0.5 * float(np.ptp(frequency[among])) if len(among) else 0.0
        if width > 1e-9 * float(np.abs(frequency).max(initial=0.0)):
            return width
    return float(np.abs(frequency).max(initial=1.0)) or 1.0


class Curve:
    """A smooth line through points, with one piece per segment of a curve.

    Parameters
    ----------
    X : (n, n_coordinates) points in order [-]
    segment : (n,) number of the segment of each point
    """

    def __init__(self, X: np.ndarray, segment: np.ndarray):
        self.X = X
        self.pieces = [_Piece(X, part) for part in segments(segment)]
        self.n_segments = len(self.pieces)
        self._fine = [piece.fine for piece in self.pieces]
        self._of = np.concatenate([np.full(len(s), i) for i, s in enumerate(self._fine)])
        self._s = np.concatenate(self._fine)
        self.fine = np.concatenate([piece.at(s) for piece, s in zip(self.pieces, self._fine)])  # (n_fine, n_coordinates)
        self._tree = cKDTree(self.fine)

    def nearest(self, points: np.ndarray) -> Foot:
        """Return the nearest positions on the curve to ``points`` (n, n_coordinates)."""
        first = np.atleast_1d(self._tree.query(points)[1])
        foot = Foot(np.empty(len(points)), np.empty(len(points)), np.empty_like(points))
        for i, piece in enumerate(self.pieces):
            of_piece = self._of[first] == i
            if of_piece.any():
                s = piece.nearest(points[of_piece], self._s[first[of_piece]])
                foot.at[of_piece], foot.place[of_piece] = piece.at(s), piece.place(s)
                foot.distance[of_piece] = np.linalg.norm(foot.at[of_piece] - points[of_piece], axis=1)
        return foot

    def resolution(self, place: np.ndarray) -> np.ndarray:
        """Return an estimate of the interpolation error at positions between points, (n,) [-].

        The estimate is the error at the omitted points of a line through every second point, which exceeds the error of the line
        through all points.  At a point it is 0.
        """
        missed = np.zeros(len(self.X))
        for piece in self.pieces:
            missed[piece.part] = piece.missed()
        missed = np.max([np.roll(np.pad(missed, _NEAR), k) for k in range(-_NEAR, _NEAR + 1)], axis=0)[_NEAR:-_NEAR]
        before = np.minimum(place.astype(int), len(self.X) - 1)
        after = np.minimum(before + 1, len(self.X) - 1)
        t = place - before
        return np.minimum(_NEARBY * np.minimum(t, 1.0 - t), 1.0) * np.maximum(missed[before], missed[after])


class _Piece:
    """A cubic spline through the points of one segment, over the length of its chords."""

    def __init__(self, X: np.ndarray, part: slice):
        self.part, self.X = part, X[part]
        steps = np.linalg.norm(np.diff(self.X, axis=0), axis=1)
        self.index = np.flatnonzero(np.concatenate([[True], steps > 0.0]))  # coincident points are merged
        self.knots = np.concatenate([[0.0], np.cumsum(steps)])[self.index]
        points = self.X[self.index]
        self.line = None
        if len(points) > 1:
            slopes = np.gradient(points, self.knots, axis=0, edge_order=2 if len(points) > 2 else 1)
            self.line = CubicHermiteSpline(self.knots, points, slopes)
            self.slope, self.bend = self.line.derivative(), self.line.derivative(2)

    @property
    def fine(self) -> np.ndarray:
        """Return the knots and the interpolated positions between them, (n_fine,)."""
        between = np.arange(FINE) / FINE
        inner = self.knots[:-1, None] + np.diff(self.knots)[:, None] * between
        return np.append(inner.ravel(), self.knots[-1])

    def at(self, s: np.ndarray) -> np.ndarray:
        return np.repeat(self.X[:1], len(s), axis=0) if self.line is None else self.line(s)

    def nearest(self, points: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Return the nearest positions to ``points`` by Newton's method from ``s``, within one fine interval."""
        if self.line is None:
            return s
        best, least = s, np.linalg.norm(self.at(s) - points, axis=1)
        reach = np.diff(self.knots).max() / FINE
        for _ in range(_STEPS):
            offset, slope = self.at(s) - points, self.slope(s)
            square = (slope**2).sum(axis=1)
            curvature = square + (offset * self.bend(s)).sum(axis=1)
            step = (offset * slope).sum(axis=1) / np.where(curvature > 0.1 * square, curvature, square)
            s = np.clip(s - np.clip(step, -reach, reach), self.knots[0], self.knots[-1])
            distance = np.linalg.norm(self.at(s) - points, axis=1)
            best, least = np.where(distance < least, s, best), np.minimum(distance, least)
        return best

    def place(self, s: np.ndarray) -> np.ndarray:
        """Return the number of the preceding point over all segments plus the fraction of the way to the next one."""
        if self.line is None:
            return np.full(len(s), float(self.part.start))
        i = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.knots) - 2)
        share = (s - self.knots[i]) / (self.knots[i + 1] - self.knots[i])
        return self.part.start + np.where(share >= 1.0, self.index[i + 1], self.index[i] + np.minimum(share, 1.0 - 1e-15))

    def missed(self) -> np.ndarray:
        """Return the distance of each point from the line through every second point, (n,); ends as their neighbours."""
        n = len(self.X)
        missed = np.zeros(n)
        if n < _FEWEST:
            return missed
        for first in (0, 1):
            half = Curve(self.X[first::2], np.zeros(len(self.X[first::2])))
            missed[1 - first :: 2] = half.nearest(self.X[1 - first :: 2]).distance
        missed[[0, -1]] = missed[[1, -2]]
        return missed
