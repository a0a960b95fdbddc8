"""The better model that error bars compare with: the stuck structure's receptance, and what is known of the modes left out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..receptance.model import ReducedModel
from ..receptance.on_group import model_on_group
from ..reduction.build import reduce_structure
from ..reduction.reduction import Reduction
from ..reduction.settings import ReductionSettings
from ..reduction.stuck import StuckStructure
from .modes_left_out import ModesLeftOut, sample_modes_left_out

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True)
class BetterModel:
    """The receptance with an exact static residual, and samples of the modes left out; None where none is."""

    model: ReducedModel
    left_out: ModesLeftOut | None
    is_solved: bool  # whether it is the very model that is solved

    def on_group(self, own: ReducedModel, comm: MPI.Comm) -> BetterModel:
        """Return the same for a group of ranks, which solves the model ``own``.  Collective on ``model.comm``."""
        return replace(self, model=own if self.is_solved else model_on_group(self.model, comm))


def better_model_of(stuck: StuckStructure, reduction: Reduction, settings: ReductionSettings) -> BetterModel:
    """Return the better model of a reduction.

    Collective on the system's communicator: the static solves of ``modes_left_out``.
    """
    if reduction.leaves_out == "nothing":
        return BetterModel(reduction.model, None, True)
    is_solved = reduction.leaves_out == "modes"
    model = reduction.model if is_solved else reduce_structure(stuck, settings)
    key = "modes left out", stuck.modes, settings.damping
    eta = 0.0 if settings.damping is None else settings.damping.structural
    left_out = stuck.once(key, lambda: sample_modes_left_out(stuck.linearised, stuck.modes, model, eta))
    return BetterModel(model, left_out, is_solved)
