"""The range of a parameter in which a branch is followed."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Sweep:
    """A range of the parameter, frequency [rad/s] or level [N], and the direction in which it is followed."""

    start: float
    stop: float  # below ``start`` for a sweep down
    at: tuple[float, ...] = ()  # values that must be points
    may_miss: bool = False  # a value in ``at`` where Newton's method fails becomes a note instead of the end of the branch

    @property
    def direction(self) -> float:
        """1 upward, -1 downward."""
        return 1.0 if self.stop > self.start else -1.0

    @property
    def scale(self) -> float:
        """The length of the range, in the unit of the parameter."""
        return abs(self.stop - self.start)

    @property
    def reverse(self) -> Sweep:
        """The same range from its other end."""
        return replace(self, start=self.stop, stop=self.start)

    def contains(self, other: Sweep) -> bool:
        """Return whether another range, followed in the same direction, lies within this one."""
        ends = self.start, other.start, other.stop, self.stop
        return other.direction == self.direction and list(ends) == sorted(ends, reverse=self.direction < 0.0)

    def until(self, stop: float) -> Sweep:
        """Return the range up to another end."""
        low, high = min(self.start, stop), max(self.start, stop)
        return replace(self, stop=stop, at=tuple(value for value in self.at if low <= value <= high))

    def beyond(self, parameter: float) -> bool:
        """Return whether a value is at the end of the range or beyond it.  Local."""
        return self.direction * (parameter - self.stop) >= 0.0

    def before(self, parameter: float) -> bool:
        """Return whether a value lies before the start of the range.  Local."""
        return self.direction * (parameter - self.start) < 0.0

    def requested_between(self, a: float, b: float) -> list[float]:
        """Return the requested values strictly between two points, in the order of travel from a to b."""
        low, high = min(a, b), max(a, b)
        return sorted((value for value in self.at if low < value < high), reverse=bool(b < a))
