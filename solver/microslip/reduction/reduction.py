"""The result of a reduction: the model for harmonic balance, the set B, and the expansion to full fields."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..points.selection import Selection
from ..receptance.modes import ProjectedModes
from ..receptance.motions import ActingForces
from ..receptance.reduced_model import ReducedModel
from ..receptance.reduced_structure import ReducedStructure

Expansion = Callable[[ReducedModel, Sequence[ActingForces]], list[np.ndarray]]  # collective; u of each point, owned rows


@dataclass(frozen=True, eq=False)
class Basis:
    """The modes in the span of a basis, which are the complete model of a Galerkin method."""

    modes: ProjectedModes
    unknowns: int  # reported number per harmonic coefficient
    leaves_out: Literal["basis", "nothing"]


@dataclass(frozen=True)
class Reduction:
    """A structure, reduced by one method."""

    structure: ReducedStructure
    selection: Selection
    displacements: Expansion
    leaves_out: Literal[
        "modes", "basis", "nothing"
    ]  # parts of the error: "modes" (dynamics of truncated modes), "basis" (motions outside its span)
    basis: Basis | None = None  # of a Galerkin method
    phi_owned: np.ndarray | None = None  # (n_owned, m) the modes of the basis, if they were computed
