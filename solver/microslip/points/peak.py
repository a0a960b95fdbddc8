"""A peak: a maximum of an output on a curve, solved for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from .quantities import Quantity, declared, hertz

_WIDTH = "between the two places at 1 / √2 of the amplitude; NaN where the curve does not reach them"
_WITHIN = "width of the interval that contains the maximum; 0 where the slope of the curve is zero"
_DAMPING = "damping ratio of one mode of this half-power width, width / (2 frequency); NaN where that is not known"
_BY_PAIRS = "derivatives of amplitude, phase [rad] and frequency [Hz] of the peak by the numbers of each pair, as of a point"
_BY_COMMON = "derivatives by the level and a factor of the damping; the last column is 0"


@dataclass(frozen=True)
class Peak:
    """A maximum of the amplitude of harmonic 1 of one output along a branch.  The same on all ranks.

    The annotations declare its datasets, as in :class:`~microslip.points.branch.Point`; amplitudes are in the unit of the output.
    """

    output: Annotated[int, Quantity("output", "", "1", "number of the output, from 0", "i8")]
    omega: Annotated[float, Quantity("frequency_Hz", "", "Hz", "frequency of the excitation", stored=hertz)]  # rad/s
    amplitude: Annotated[  # of harmonic 1, cos - i sin
        complex,
        Quantity("amplitude", "", "m", "harmonic 1", stored=abs),
        Quantity("phase", "", "rad", "harmonic 1: u = amplitude · cos(ω t + phase)", stored=np.angle),
    ]
    width: Annotated[float, Quantity("half_power_width_Hz", "", "Hz", _WIDTH, stored=hertz)]  # rad/s
    within: Annotated[float, Quantity("within_Hz", "", "Hz", _WITHIN, stored=hertz)]  # rad/s
    slipping: Annotated[int, Quantity("slipping", "", "1", "pairs that slip or are open", "i8")]
    newton: Annotated[int, Quantity("newton", "", "1", "Newton iterations", "i8")]
    segment: Annotated[int, Quantity("segment", "", "1", "of the curve", "i8")] = 0
    by_pairs: Annotated[np.ndarray | None, Quantity("d_by_pairs", "of_peak numbers pairs", "m", _BY_PAIRS)] = None
    by_common: Annotated[np.ndarray | None, Quantity("d_by_common", "of_peak common", "m", _BY_COMMON)] = None

    @property
    def damping(self) -> float:
        """The damping ratio of one mode of this half-power width, width / (2 omega) [-]; NaN where that is not known."""
        return self.width / (2.0 * self.omega)


PEAK_QUANTITIES = (*declared(Peak), Quantity("damping", "", "1", _DAMPING, field="damping"))


def top_of_curve(omega: np.ndarray, amplitude: np.ndarray) -> tuple[float, float]:
    """Return frequency and amplitude at the top of a curve, from its highest point and its two neighbours.  Local.

    1 / amplitude^2 is taken as quadratic in omega^2, which is exact for one undisturbed resonance.  The highest point itself is
    returned at an end of the curve, where it turns back at its top, and where the top would be twice as high.
    """
    i = int(np.argmax(amplitude))
    if 0 < i < len(amplitude) - 1 and amplitude[i - 1 : i + 2].all():
        near = slice(i - 1, i + 2)
        x, y = (omega[near] / omega[i]) ** 2 - 1.0, (amplitude[i] / amplitude[near]) ** 2
        if x[0] * x[2] < 0.0 and y[0] + y[2] > 2.0:
            a, b, c = np.polyfit(x, y, 2)
            at, of_top = -0.5 * b / a, c - 0.25 * b**2 / a
            if of_top > 0.25:
                return float(omega[i] * np.sqrt(1.0 + at)), float(amplitude[i] / np.sqrt(of_top))
    return float(omega[i]), float(amplitude[i])
