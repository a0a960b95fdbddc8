"""What a method makes of a structure: the model that harmonic balance solves, its set B, and the way back to full fields."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..points.selection import Selection
from ..receptance.model import ReducedModel


@dataclass(frozen=True)
class Reduction:
    """A structure, reduced by one method."""

    model: ReducedModel
    selection: Selection
    displacement: Callable[[float, float, np.ndarray], np.ndarray]  # collective; level, omega, p -> harmonics of u, owned rows
    leaves_out: Literal["modes", "basis", "nothing"]  # "modes": their dynamics, not their statics; "basis": what it lacks
    phi_owned: np.ndarray | None = None  # (n_owned, m) the modes that are the whole model of a Galerkin method; None of others
