"""A bifurcation: a point of a curve where its stability changes, or where it turns back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from .quantities import Quantity, declared, hertz

FOLD, PERIOD_DOUBLING, NEIMARK_SACKER, BRANCHING = KINDS = ("fold", "period doubling", "Neimark-Sacker", "branch point")
_KINDS = ", ".join(f"{i} {kind}" for i, kind in enumerate(KINDS))
_WITHIN = "width of the interval that contains it; that of the neighbouring points where it was not solved for"


@dataclass(frozen=True, eq=False)
class Bifurcation:
    """A fold, or a place where multipliers cross the unit circle.  The same on all ranks."""

    kind: Annotated[str, Quantity("kind", "", "1", _KINDS, "u1", stored=KINDS.index)]
    omega: Annotated[float, Quantity("frequency_Hz", "", "Hz", "frequency of the excitation", stored=hertz)]  # rad/s
    amplitude: Annotated[np.ndarray, Quantity("amplitude", "outputs", "m", "harmonic 1")]  # (n_outputs,)
    multiplier: Annotated[
        complex,
        Quantity("multiplier_real", "", "1", "the multiplier on the unit circle", stored=np.real),
        Quantity("multiplier_imaginary", "", "1", "the multiplier on the unit circle", stored=np.imag),
    ]
    within: Annotated[float, Quantity("within_Hz", "", "Hz", _WITHIN, stored=hertz)]  # rad/s
    after: Annotated[int, Quantity("after", "", "1", "number of the point before it on the curve, from 0", "i8")]


BIFURCATION_QUANTITIES = declared(Bifurcation)
