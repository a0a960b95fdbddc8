"""An iterate: a motion of the pairs, its harmonics, and the parameters of the problem."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..fourier.harmonics import Harmonics


@dataclass(frozen=True, eq=False)
class Iterate:
    """A motion of this rank's pairs and the parameters of the problem, unscaled."""

    U: np.ndarray  # (n_owned, 3, N_H) m
    parameters: tuple[float, ...]  # of the problem: a frequency rad/s, a level N, ...; the first is the one that is swept
    harmonics: Harmonics  # those of U

    @property
    def parameter(self) -> float:
        """The parameter that is swept."""
        return self.parameters[0]

    def at(self, parameter: float) -> Iterate:
        """Return the same motion at another value of the parameter that is swept.  Local."""
        return replace(self, parameters=(parameter, *self.parameters[1:]))

    def on(self, harmonics: Harmonics) -> Iterate:
        """Return the motion in another set of harmonics: missing ones zero, surplus ones dropped.  Local."""
        return (
            self if harmonics == self.harmonics else replace(self, U=self.harmonics.carry(self.U, harmonics), harmonics=harmonics)
        )


@dataclass(frozen=True, eq=False)
class PointState:
    """A converged point as the next step needs it."""

    iterate: Iterate
    selected: np.ndarray  # (n_pairs,) bool, B of the next point
    size: float  # |U| over all ranks [m]
    force: float  # |f_nl| over all ranks [N]
    sticks: bool  # no pair slips or opens: the point lies on the linear curve
    sliding: float  # share of the pairs that do not stick
    moved: float  # and of those whose p is not zero: whose sliders move or have moved
    amplitude: np.ndarray  # (n_outputs,) complex, of harmonic 1 [m]


def interpolate(a: Iterate, b: Iterate, parameter: float) -> Iterate:
    """Return the point of the chord from ``a`` to ``b``, in the same harmonics, at a value of the swept parameter.  Local."""
    share = (parameter - a.parameter) / (b.parameter - a.parameter)
    remaining = (p + share * (q - p) for p, q in zip(a.parameters[1:], b.parameters[1:]))
    return Iterate(a.U + share * (b.U - a.U), (parameter, *remaining), a.harmonics)


def parabola(before: Iterate | None, a: Iterate, b: Iterate, parameter: float) -> Iterate:
    """Return the point between ``a`` and ``b`` of the parabola through them and the one before, as :func:`interpolate` does.

    That of the chord where the swept parameter turns between the three, or there is none before.
    """
    chord = interpolate(a, b, parameter)
    if before is None or not (a.parameter - before.parameter) * (b.parameter - a.parameter) > 0.0:
        return chord
    before, x = before.on(a.harmonics), before.parameter
    share = (parameter - a.parameter) * (parameter - b.parameter) / ((x - a.parameter) * (x - b.parameter))
    on_chord = interpolate(a, b, x)
    remaining = (p + share * (q - r) for p, q, r in zip(chord.parameters[1:], before.parameters[1:], on_chord.parameters[1:]))
    return Iterate(chord.U + share * (before.U - on_chord.U), (parameter, *remaining), a.harmonics)
