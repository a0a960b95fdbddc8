"""From the structure to what is solved at each level: the reduction by a method, the law, the range, the linear curve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from ..continuation.levels import ResponseProblem, response_problem
from ..mesh.data import ContactPairs
from ..points.band import Band
from ..receptance.excitation import Excitation
from ..receptance.reduced_model import ReducedModel
from ..receptance.truncated_modes import EnrichedModel
from ..reduction.enriched_model import enriched_model_of
from ..reduction.methods import METHODS, check_size, reduce_by_method
from ..reduction.reduction import Reduction
from ..reduction.settings import ReductionSettings
from ..scene.schema import Scene
from ..statics.balance import Balance
from ..statics.bolts import BoltsAtRest
from .build import Structure
from .settings import excitation, has_error_bars, reduction_settings, response_settings


@dataclass(frozen=True, eq=False)
class Outline:
    """What results say of a structure."""

    n_dof: int
    omega_n: np.ndarray  # (n_modes,) rad/s
    has_mesh: bool
    numbers: np.ndarray | None  # (n_nodes,) of Mesh.points, the user's; on rank 0 of a scene with a mesh
    bolts: BoltsAtRest | None
    balance: Balance | None = None  # with [statics]

    @classmethod
    def of(cls, structure: Structure) -> Outline:
        """Return that of a structure.  Local."""
        system, mesh = structure.system, structure.mesh
        numbers = None if mesh is None else mesh.numbers
        has_mesh, bolts = system.dof is not None, structure.bolts
        return cls(system.n_dof, structure.omega_n, has_mesh, numbers, bolts, structure.balance)


@dataclass(frozen=True, eq=False)
class Prepared:
    """A structure made ready for the responses of one scene."""

    scene: Scene
    whole: Callable[[], Structure]  # the structure; collective where it must be built first
    outline: Outline
    pairs: ContactPairs  # with the friction and preload of these responses
    reduction: Reduction
    response: ResponseProblem
    seconds: float  # of the reduction; nearly none where it was known
    close: Callable[[], None]  # frees the factor; collective
    built: Callable[[], Structure | None]  # the structure, if it is there

    @property
    def structure(self) -> Structure:
        """The structure; collective where it must be built first."""
        return self.whole()

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
    better = enriched_model_of(structure, reduction, settings) if has_bars else None
    response = response_of(scene, pairs, reduction, structure.omega_n, better)
    outline = Outline.of(structure)
    return Prepared(scene, lambda: structure, outline, pairs, reduction, response, seconds, structure.close, lambda: structure)


def response_of(
    scene: Scene, pairs: ContactPairs, reduction: Reduction, omega_n: np.ndarray, better: EnrichedModel | None
) -> ResponseProblem:
    """Return what is solved at every level, about the modes ``omega_n`` [rad/s].  Collective.

    Raises
    ------
    CaseError : the range cannot be followed; on every rank
    """
    settings, damping = response_settings(scene), reduction_settings(scene).damping
    model = ReducedModel.of(reduction.structure, excitation(scene), damping)
    law = pairs.law.followed(settings.follows_path)
    return response_problem(settings, model, law, reduction.selection, omega_n, better)


def reduced(structure: Structure, settings: ReductionSettings) -> Reduction:
    """Return the reduction by a method; the last basis is kept, for other harmonics too.  Collective.

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : the method cannot be used here; on every rank
    """
    key = structure.seen, structure.n_modes, _of_basis(settings)
    if structure.kept.get("basis") != key:
        check_size(settings, structure.system)
        structure.kept.pop("reduction", None)  # its memory first
        structure.kept["reduction"] = reduce_by_method(structure, settings)
        structure.kept["basis"] = key
    return structure.kept["reduction"]


def _of_basis(settings: ReductionSettings) -> ReductionSettings:
    """Return what of the settings a basis depends on; of some methods on the range and its harmonics, too."""
    if not METHODS[settings.method].FACTS.knows_range:
        settings = replace(settings, excitation=Excitation(), band=Band())
    return replace(settings, modes=None, accuracy=1.0, insists=False, level=1.0, where="")
