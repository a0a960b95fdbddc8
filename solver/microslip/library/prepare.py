"""From the structure to the problem of each level: reduction, contact law, range, linear curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from ..continuation.levels import ResponseProblem, response_problem
from ..mesh.data import ContactPairs
from ..points.band import Band
from ..receptance.excitation import Excitation
from ..receptance.motions import ActingForces
from ..receptance.reduced_model import ReducedModel
from ..reduction.enriched_model import enriched_model_of
from ..reduction.galerkin import reduction_of_basis
from ..reduction.methods import METHODS, reduce_by_method
from ..reduction.reduction import Basis, Reduction
from ..reduction.settings import ReductionSettings
from ..scene.schema import Scene
from .build import Structure
from .settings import excitation, has_error_bars, reduction_settings, response_settings

_REDUCED = "reduction"  # key of the cached reduction, the last one, with its inputs


@dataclass(frozen=True, eq=False)
class Prepared:
    """A structure prepared for the responses of one scene."""

    scene: Scene
    structure: Structure
    reduction: Reduction
    response: ResponseProblem
    seconds: float  # of the reduction; nearly none where it was known

    @property
    def pairs(self) -> ContactPairs:
        """The pairs with the friction and preload of these responses."""
        return self.structure.pairs

    @property
    def model(self) -> ReducedModel:
        """The reduced model."""
        return self.response.model

    def close(self) -> None:
        """Free the factor, if there is one.  Collective."""
        self.structure.close()


def prepare(
    structure: Structure,
    scene: Scene | None = None,
    has_bars: bool | None = None,
    load_factors: np.ndarray | None = None,
    has_curve: bool = True,
) -> Prepared:
    """Return a structure prepared for the responses of ``scene``, by default its own; with error bars if that has them.

    Collective on ``structure.comm``.  Results of an earlier call are reused if they still apply.

    Parameters
    ----------
    load_factors : (n_loads,) of each shape of a load, for loads that are others than those the structure was built with
    has_curve : whether the linear curve is computed, which levels need and a nonlinear mode does not

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : on every rank
    """
    scene = scene or structure.scene
    settings, start = reduction_settings(scene), perf_counter()
    reduction = reduced(structure, settings)
    seconds = perf_counter() - start
    has_bars = has_error_bars(scene) if has_bars is None else has_bars
    enriched = enriched_model_of(structure, reduction, settings) if has_bars else None
    model = ReducedModel.of(reduction.structure, excitation(scene), settings.damping)
    if load_factors is not None:
        model = replace(model, f=load_factors[:, None] * model.f)
    of_response = response_settings(scene)
    law = structure.pairs.law.followed(of_response.follows_path)
    response = response_problem(of_response, model, law, reduction.selection, structure.excited.omega_n, enriched, has_curve)
    return Prepared(scene, structure, reduction, response, seconds)


def reduced(structure: Structure, settings: ReductionSettings) -> Reduction:
    """Return the reduction by a method; the last one is stored, for other harmonics too.  Collective.

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : the method cannot be used here; on every rank
    """
    key = _key(structure, settings)
    if structure.results.get(_REDUCED, (None,))[0] != key:
        structure.results.pop(_REDUCED, None)  # its memory first
        structure.results[_REDUCED] = key, reduce_by_method(structure, settings)
    return structure.results[_REDUCED][1]


def put_basis(structure: Structure, basis: Basis) -> None:
    """Give a structure a reduction on a stored basis.  Local; full fields compute the basis again."""
    settings = reduction_settings(structure.scene)

    def displacements(model: ReducedModel, points: Sequence[ActingForces]) -> list[np.ndarray]:
        return reduce_by_method(structure, settings).displacements(model, points)

    reduction = reduction_of_basis(structure, basis, settings, displacements)
    structure.results[_REDUCED] = _key(structure, settings), reduction


def _key(structure: Structure, settings: ReductionSettings) -> tuple:
    """Return the inputs of a basis; for some methods these include the range and its harmonics."""
    if not METHODS[settings.method].FACTS.knows_range:
        settings = replace(settings, excitation=Excitation(), band=Band())
    of_basis = replace(settings, modes=None, accuracy=1.0, insists=False, level=1.0, where="")
    return structure.projected, structure.n_modes, of_basis
