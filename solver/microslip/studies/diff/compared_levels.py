"""Comparison of a level of two results: curves, peaks, losses, states and error bars.  NumPy and SciPy only."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...points.error_parts import total
from ...results.measures import AMPLITUDE, Shown, counts
from ...results.record import COMPLETE, LevelResult
from .curves import Curve, Foot, half_width

SAME_POINT = 1e-9  # largest difference of the frequencies of one point, in half widths
_ENDS = 0.01  # of a step: a foot within this distance of an end of a curve is the end


@dataclass(frozen=True)
class OutputDifference:
    """The curves of one output."""

    name: str
    unit: str
    difference: float  # largest difference over the peak of A
    beyond: float  # the part of it beyond the resolution of the points
    at: float  # Hz, frequency of the largest difference
    inside_bars: bool | None  # whether harmonic 1 differs by less than both error bars everywhere; None: without bars
    peak: tuple[float, float]  # of A and B
    peak_at: tuple[float, float]  # Hz
    bar: tuple[float | None, float | None]  # at the peak


@dataclass(frozen=True)
class LevelDifference:
    """One level of two results, A and B."""

    level: float
    unit: str
    n_points: tuple[int, int]
    status: tuple[str, str]
    failure: tuple[str, str]
    same_points: bool
    ends: tuple[tuple[float, float], tuple[float, float]] | None  # Hz, if only parts of the curves were compared
    outputs: tuple[OutputDifference, ...]
    friction: tuple[float, float]  # J per cycle, where the first output is largest
    damping: tuple[float, float]
    slip: tuple[int, int]  # slipping pairs there
    open: tuple[int, int]
    n_other_state: int | None  # pairs in another state there; None for different pairs
    closes_to: float  # bound of the energy balance: the accuracy, if it chose the tolerance of the points

    @property
    def difference(self) -> float:
        """The largest difference of the outputs over their peaks [-]."""
        return max((output.difference for output in self.outputs), default=0.0)

    @property
    def beyond(self) -> float:
        """The largest part of it beyond the resolution of the points [-]."""
        return max((output.beyond for output in self.outputs), default=0.0)

    @property
    def inside_bars(self) -> bool:
        """Whether all outputs have bars and differ by less than them."""
        return bool(self.outputs) and all(output.inside_bars is True for output in self.outputs)

    @property
    def is_disjoint(self) -> bool:
        """Whether the frequency ranges have nothing in common."""
        return self.ends is not None and have_no_overlap(*self.ends)

    @property
    def is_whole(self) -> bool:
        """Whether both curves are complete and cover the same range."""
        return self.status == (COMPLETE, COMPLETE) and self.ends is None and min(self.n_points) > 0


def compare_level(
    a: LevelResult, b: LevelResult, outputs: Sequence[tuple[str, str, int, int]], same_pairs: bool, shown: Shown = AMPLITUDE
) -> LevelDifference:
    """Return the difference of a level.  Local.

    Parameters
    ----------
    outputs : name, unit, and number in A and B of the common outputs
    """
    n = len(a.frequency), len(b.frequency)
    differences: list[OutputDifference] = []
    same, is_whole = _has_same_points(a, b, shown), True
    if min(n) and have_no_overlap(_range(a), _range(b)):
        is_whole = False
    elif min(n):
        for name, unit, i, j in outputs:
            output, whole = _compare_output(_Output(a, i, shown), _Output(b, j, shown), same, name, unit)
            differences.append(output)
            is_whole = is_whole and whole
    first = (outputs[0][2], outputs[0][3]) if outputs else (0, 0)
    tops = [_Output(level, output, shown).top for level, output in zip((a, b), first)]
    states = [counts(level.state[top]) if len(level.frequency) else (0, 0, 0) for level, top in zip((a, b), tops)]
    friction, damping = ([_at(getattr(level, loss), top) for level, top in zip((a, b), tops)] for loss in ("friction", "damping"))
    return LevelDifference(
        level=a.level,
        unit=a.unit,
        n_points=n,
        status=(a.status, b.status),
        failure=(a.failure, b.failure),
        same_points=same,
        ends=None if is_whole else (_range(a), _range(b)),
        outputs=tuple(differences),
        friction=(friction[0], friction[1]),
        damping=(damping[0], damping[1]),
        slip=(int(states[0][1]), int(states[1][1])),
        open=(int(states[0][2]), int(states[1][2])),
        n_other_state=int(np.count_nonzero(a.state[tops[0]] != b.state[tops[1]])) if same_pairs and min(n) else None,
        closes_to=max(a.closes_to, b.closes_to),
    )


class _Output:
    """One output along a curve."""

    def __init__(self, level: LevelResult, number: int, shown: Shown):
        self.level, self.frequency = level, level.frequency
        self.response = level.response[:, number]  # (n, N_H)
        self.shown, self.size = shown, shown.size(self.response)
        self.bar = None if level.error is None else total(level.error[:, number])

    @property
    def top(self) -> int:
        """Return the index of the largest value; 0 for a curve without points."""
        return int(np.argmax(self.size)) if len(self.size) else 0

    @property
    def scale(self) -> float:
        """Return the largest amplitude of any harmonic, or mean, on the curve."""
        harmonics = np.hypot(self.response[:, 1::2], self.response[:, 2::2])
        return float(max(np.abs(self.response[:, 0]).max(initial=0.0), harmonics.max(initial=0.0)))


def _has_same_points(a: LevelResult, b: LevelResult, shown: Shown) -> bool:
    """Return whether two curves have the same frequencies in the same order."""
    if len(a.frequency) != len(b.frequency) or not np.array_equal(a.segment, b.segment):
        return False
    size = shown.size(a.response[:, 0])
    width = half_width(a.frequency, size) if len(size) else 1.0
    return bool(np.all(np.abs(a.frequency - b.frequency) <= SAME_POINT * width))


@dataclass(frozen=True)
class CurveDifference:
    """Differences of n points of one curve from the other curve, in the common range."""

    frequency: np.ndarray  # (n,) Hz
    segment: np.ndarray  # (n,)
    difference: np.ndarray  # (n,) difference over the peak of A
    beyond: np.ndarray  # (n,) the part of it beyond the resolution of the other curve's points
    inside_bars: bool | None
    is_whole: bool  # whether the other curve covers all points of this one


def difference_of(a: LevelResult, b: LevelResult, i: int, j: int, shown: Shown = AMPLITUDE) -> tuple[CurveDifference, ...]:
    """Return the differences of output ``i`` of A and ``j`` of B: one for common points, else one from each curve.  Local."""
    curve, other = _Output(a, i, shown), _Output(b, j, shown)
    return _difference(curve, other, _has_same_points(a, b, shown))[0]


def _difference(a: _Output, b: _Output, same_points: bool) -> tuple[tuple[CurveDifference, ...], list[Curve]]:
    """Return the differences as in ``difference_of``, and the two curves (none for common points)."""
    N_H = max(a.response.shape[1], b.response.shape[1])
    padded = [np.pad(output.response, [(0, 0), (0, N_H - output.response.shape[1])]) for output in (a, b)]
    scale = _scale(a, b)
    if same_points:
        delta = padded[0] - padded[1]
        difference = np.linalg.norm(delta, axis=1) / scale
        inside = _inside(np.hypot(*delta[:, 1:3].T), a.bar, b.bar, scale)
        return (CurveDifference(a.frequency, a.level.segment, difference, difference, inside, True),), []
    width = half_width(a.frequency, a.size)
    curves = [
        Curve(np.column_stack([output.frequency / width, x / scale]), output.level.segment) for output, x in zip((a, b), padded)
    ]
    feet = [curves[1].nearest(curves[0].X), curves[0].nearest(curves[1].X)]
    distances = []
    for i, (side, other) in enumerate(((a, b), (b, a))):
        foot, in_common = feet[i], _in_common_range(curves, feet, i)
        difference, place = foot.distance[in_common], foot.place[in_common]
        resolved = curves[1 - i].resolution(place)
        first = np.hypot(*(foot.at - curves[i].X)[in_common, 2:4].T)
        bars = None if side.bar is None else side.bar[in_common], None if other.bar is None else _between(other.bar, place)
        inside = _inside(scale * np.maximum(first - resolved, 0.0), *bars, scale)
        beyond = np.maximum(difference - resolved, 0.0)
        distances.append(
            CurveDifference(
                side.frequency[in_common], side.level.segment[in_common], difference, beyond, inside, bool(in_common.all())
            )
        )
    return tuple(distances), curves


def _scale(a: _Output, b: _Output) -> float:
    """Return the peak of A, or of B if A is 0."""
    return a.scale or b.scale or 1.0


def _inside(difference: np.ndarray, bar: np.ndarray | None, other: np.ndarray | None, scale: float) -> bool | None:
    """Return whether amplitudes differ by less than both error bars; None if a bar is missing."""
    return None if bar is None or other is None else bool(np.all(difference <= bar + other + 1e-12 * scale))


def _compare_output(a: _Output, b: _Output, same_points: bool, name: str, unit: str) -> tuple[OutputDifference, bool]:
    """Return the difference of an output, and whether both curves were compared completely."""
    sides, curves = _difference(a, b, same_points)
    difference, frequency = (np.concatenate([getattr(side, what) for side in sides]) for what in ("difference", "frequency"))
    worst = int(np.argmax(difference)) if len(difference) else None
    highest = [output.top for output in (a, b)]
    tops = [(float(output.frequency[i]), float(output.size[i])) for output, i in zip((a, b), highest)]
    if curves:
        tops = [
            _top_between(curve, output, half_width(a.frequency, a.size), _scale(a, b)) for curve, output in zip(curves, (a, b))
        ]
    bars = [None if output.bar is None else float(output.bar[i]) for output, i in zip((a, b), highest)]
    inside = [side.inside_bars for side in sides]
    result = OutputDifference(
        name=name,
        unit=unit,
        difference=0.0 if worst is None else float(difference[worst]),
        beyond=max(float(side.beyond.max(initial=0.0)) for side in sides),
        at=0.0 if worst is None else float(frequency[worst]),
        inside_bars=None if None in inside else all(inside),
        peak=(tops[0][1], tops[1][1]),
        peak_at=(tops[0][0], tops[1][0]),
        bar=(bars[0], bars[1]),
    )
    return result, all(side.is_whole for side in sides)


def _between(values: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return values at places between points."""
    return np.interp(place, np.arange(len(values)), values)


def _top_between(curve: Curve, side: _Output, width: float, scale: float) -> tuple[float, float]:
    """Return frequency [Hz] and size of the maximum of a curve."""
    response = scale * curve.fine[:, 1:]
    size = side.shown.size(response)
    top = int(np.argmax(size))
    return width * float(curve.fine[top, 0]), float(size[top])


def _range(level: LevelResult) -> tuple[float, float]:
    return float(level.frequency.min()), float(level.frequency.max())


def have_no_overlap(a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Return whether two ranges have nothing in common.  Local."""
    return max(a[0], b[0]) > min(a[1], b[1])


def _at(values: np.ndarray, i: int) -> float:
    """Return an entry; 0 for a curve without points."""
    return float(values[i]) if len(values) else 0.0


def _in_common_range(curves: Sequence[Curve], feet: Sequence[Foot], i: int) -> np.ndarray:
    """Return which points of the i-th of two curves lie in the range of the other, (n,) bool.

    For curves in one piece these lie between the ends of the other; curves in several pieces are compared completely.
    """
    number = np.arange(len(curves[i].X))
    if any(curve.n_segments != 1 or len(curve.X) < 2 for curve in curves):
        return np.ones(len(number), dtype=bool)
    ends = np.sort(feet[1 - i].place[[0, -1]])  # ends of the other curve, on this one
    return (number >= ends[0] - _ENDS) & (number <= ends[1] + _ENDS)
