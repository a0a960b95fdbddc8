"""From the structure to what is solved at each level: the reduction by a method, the law, the range, the linear curve."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

from ..continuation.levels import ResponseProblem, response_problem
from ..error_estimate.better_model import better_model_of
from ..fourier.harmonics import Harmonics
from ..mesh.data import ContactPairs
from ..modes.band import Band
from ..receptance.model import ReducedModel
from ..reduction.build import load_coefficients
from ..reduction.methods import check_size, reduce_by_method
from ..reduction.reduction import Reduction
from ..reduction.settings import ReductionSettings
from ..scene.schema import Scene
from .build import Structure
from .settings import has_error_bars, reduction_settings, response_settings


@dataclass(frozen=True, eq=False)
class Prepared:
    """A structure made ready for the responses of one scene."""

    scene: Scene
    structure: Structure
    pairs: ContactPairs  # with the friction and preload of these responses
    reduction: Reduction
    response: ResponseProblem
    seconds: float  # of the reduction; nearly none where it was known

    @property
    def model(self) -> ReducedModel:
        return self.response.model


def prepare(
    structure: Structure, scene: Scene | None = None, pairs: ContactPairs | None = None, has_bars: bool | None = None
) -> Prepared:
    """Return a structure ready for its responses, by default those of its own scene, with error bars where that has them.

    Collective on ``structure.comm``.  ``pairs`` may differ from the structure's in what the stuck structure does not know of:
    friction and preload.  What an earlier call made is used again as far as it is the same.

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : on every rank
    """
    scene, pairs = scene or structure.scene, pairs or structure.pairs
    settings, start = reduction_settings(scene), perf_counter()
    reduction = reduced(structure, settings)
    seconds = perf_counter() - start
    has_bars = has_error_bars(scene) if has_bars is None else has_bars
    better = better_model_of(structure, reduction, settings) if has_bars else None
    omega_n = structure.modes.omega_n
    law = pairs.law.followed(scene.solver.between_samples == "path")
    response = response_problem(response_settings(scene), reduction.model, law, reduction.selection, omega_n, better)
    return Prepared(scene, structure, pairs, reduction, response, seconds)


def reduced(structure: Structure, settings: ReductionSettings) -> Reduction:
    """Return the reduction by a method; the last basis is kept, for other harmonics too.  Collective.

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : the method cannot be used here; on every rank
    """
    key = structure.modes, _of_basis(settings)
    if structure.kept.get("basis") != key:
        check_size(settings, structure.linearised.system)
        structure.kept.pop("reduction", None)  # its memory first
        structure.kept["reduction"] = reduce_by_method(structure, settings)
        structure.kept["basis"] = key
    found, harmonics = structure.kept["reduction"], Harmonics.up_to(settings.harmonics)
    return replace(found, model=replace(found.model, f=load_coefficients(settings.loads, harmonics), harmonics=harmonics))


def _of_basis(settings: ReductionSettings) -> ReductionSettings:
    """Return what of the settings a basis depends on; that of `full` on the range and its harmonics, too."""
    if settings.method != "full":
        settings = replace(settings, harmonics=0, band=Band())
    return replace(settings, modes=None, accuracy=1.0, insists=False, level=1.0, where="")
