"""A maximum of an output on a curve, solved for as a point of its own."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Peak:
    """A maximum of the amplitude of harmonic 1 of one output along a branch.  The same on all ranks."""

    output: int  # number of the output, from 0
    omega: float  # rad/s
    amplitude: complex  # of harmonic 1, cos - i sin, in the unit of the output
    width: float  # rad/s between the two places at 1 / sqrt 2 of the amplitude; NaN where the curve does not reach them
    within: float  # rad/s: the maximum lies in an interval of this width; 0 where the slope of the curve is zero
    slipping: int  # pairs that slip or are open
    newton: int  # iterations
    segment: int = 0  # of the curve

    @property
    def damping(self) -> float:
        """The damping ratio of one mode of this half-power width, width / (2 omega) [-]; NaN where that is not known."""
        return self.width / (2.0 * self.omega)
