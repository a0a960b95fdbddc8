"""Counts, peaks and segments of a curve.  NumPy only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..contact.law import OPEN, SLIP, STICK
from ..fourier.coefficients import amplitude


@dataclass(frozen=True)
class Shown:
    """The quantity that represents an output by one number."""

    name: str
    of: Callable[[np.ndarray], np.ndarray]  # of its coefficients, (..., N_H)
    largest: str  # name of its largest value on a curve
    heading: str  # the same above a column
    is_static: bool = False  # the same at every frequency: one point represents all
    unit: str = "m"  # of the output
    level_unit: str = "N"

    @property
    def per_level(self) -> str:
        """The suffix of a unit per unit of the level."""
        return "" if self.level_unit == "1" else f"/{self.level_unit}" if self.level_unit == "N" else f"/({self.level_unit})"

    def size(self, coefficients: np.ndarray) -> np.ndarray:
        """Return the magnitude of the quantity, (...), from coefficients (..., N_H)."""
        return np.abs(self.of(coefficients))

    def where(self, frequency: float, digits: int = 7) -> str:
        """Return the frequency of a point [Hz] as text; "" where the point represents every frequency."""
        return "" if self.is_static else f"{frequency:.{digits}g} Hz"

    def __str__(self) -> str:
        return f"{self.name}{'' if self.is_static else ' of harmonic 1'}"


AMPLITUDE = Shown("amplitude", amplitude, "peak", "peak amplitude")  # of harmonic 1
MEAN = Shown("mean", lambda coefficients: coefficients[..., 0], "displacement", "displacement", is_static=True)


def shown_with(harmonics: int, unit: str = "m", level_unit: str = "N") -> Shown:
    """Return the quantity shown of a response with these harmonics: the mean if there are none above it.  Local."""
    return replace(AMPLITUDE if harmonics else MEAN, unit=unit, level_unit=level_unit)


def counts(state: np.ndarray) -> np.ndarray:
    """Return how many pairs stick, slip and are open, (..., 3) of ``state`` (..., n_pairs).  Local."""
    return np.stack([(state == kind).sum(axis=-1) for kind in (STICK, SLIP, OPEN)], axis=-1)


def peak(response: np.ndarray, output: int = 0) -> int | None:
    """Return the index of the point with the largest amplitude of an output, of ``response`` (n, n_outputs, N_H).  Local.

    None where the curve has no point.
    """
    return int(np.argmax(amplitude(response[:, output]))) if len(response) else None


def segments(segment: np.ndarray) -> list[slice]:
    """Return the points of each segment of a curve, from the number of the segment at each point, (n,).  Local."""
    ends = [0, *(np.flatnonzero(np.diff(segment)) + 1).tolist(), len(segment)]
    return [slice(a, b) for a, b in zip(ends[:-1], ends[1:]) if b > a]
