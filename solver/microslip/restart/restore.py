"""A structure made ready for its responses from what was kept of it, and built again only where its factor is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..continuation.checkpoint import under
from ..continuation.levels import ResponseProblem
from ..library.build import Known, Structure, build
from ..library.prepare import Outline, Prepared, reduced, response_of
from ..library.settings import reduction_settings
from ..linear.factor import KnownFactor
from ..linear.joint_springs import Linearised
from ..mesh.data import ContactPairs
from ..modes.eigen import Modes, lowest_modes
from ..modes.user_order import from_user_order
from ..observe.log import RunLog
from ..parallel.agree import on_root
from ..parallel.ownership import split_evenly
from ..receptance.motions import ActingForces
from ..receptance.per_group import PerGroup
from ..receptance.receptance import Receptance
from ..receptance.reduced_model import ReducedModel
from ..receptance.reduced_structure import ReducedStructure
from ..receptance.static_columns import StaticColumns
from ..receptance.static_response import StaticResponse
from ..receptance.truncated_modes import EnrichedModel
from ..reduction.galerkin import structure_of_modes
from ..reduction.reduction import Reduction
from .kept_columns import KeptColumns
from .records import Arrays
from .setup import STATICS, left_out_of, modes_of, observed_of, outline_of, pairs_of, selection_of

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..scene.schema import Scene


class Rebuilt:
    """The structure of a scene, built when it is asked for, with the modes that were kept.  Collective where it is built."""

    def __init__(
        self,
        scene: Scene,
        comm: MPI.Comm,
        log: RunLog,
        omega_n: np.ndarray,
        read_modes: Callable[[], np.ndarray | None],
        known_factor: KnownFactor | None = None,
    ):
        self.scene, self.comm, self.log = scene, comm, log
        self.omega_n, self._read_modes, self._known_factor = omega_n, read_modes, known_factor

    def keep_first(self, n_modes: int) -> np.ndarray:
        """Leave the modes beyond the first ``n_modes`` out, and return the frequencies of those [rad/s].  Local."""
        self.omega_n = self.omega_n[:n_modes]
        return self.omega_n

    @cached_property
    def structure(self) -> Structure:
        self.log.note("the structure is assembled again, its modes are known")
        return build(self.scene, self.comm, self.log, Known(self._modes, self._known_factor), keeps_reference=False)

    def _modes(self, linearised: Linearised) -> Modes:
        """Return the modes that were kept, the first of those in their file; found anew where that is damaged."""
        whole = on_root(self.comm, self._read_modes, share=False)
        if not self.comm.bcast(whole is not None):
            return lowest_modes(linearised, len(self.omega_n))
        first = None if whole is None else whole[:, : len(self.omega_n)]
        return Modes(self.omega_n, from_user_order(linearised, first))

    @cached_property
    def reduction(self) -> Reduction:
        return reduced(self.structure, reduction_settings(self.structure.scene))

    def solve(self, pairs: np.ndarray) -> np.ndarray:
        """Return the static columns of further pairs, as StaticColumns asks for them."""
        return self.structure.statics.G_static.solve(pairs)

    def displacements(self, model: ReducedModel, points: Sequence[ActingForces]) -> list[np.ndarray]:
        """Return full displacements, as a Reduction does."""
        return self.reduction.displacements(model, points)

    def built(self) -> Structure | None:
        """Return the structure, if it is there.  Local."""
        return vars(self).get("structure")

    def close(self) -> None:
        """Free the factor, if there is one."""
        if self.built() is not None:
            self.structure.close()

    def prepared(self, outline: Outline, pairs: ContactPairs, reduction: Reduction, response: ResponseProblem) -> Prepared:
        """Return the scene made ready, with the structure behind it.  Local."""
        return Prepared(self.scene, lambda: self.structure, outline, pairs, reduction, response, 0.0, self.close, self.built)


@dataclass(frozen=True)
class KeptSetup:
    """A set-up as it was kept: arrays and texts, on every rank, and what reads the rest."""

    arrays: Arrays
    texts: Mapping[str, Any]
    columns: KeptColumns
    read_modes: Callable[[], np.ndarray | None]
    factor: KnownFactor | None = None


def restored(kept: KeptSetup, scene: Scene, log: RunLog) -> Prepared:
    """Return what was prepared when a set-up was kept.  Collective on the ranks of its columns."""
    arrays, texts, columns = kept.arrays, kept.texts, kept.columns
    comm, outline = columns.comm, outline_of(arrays, texts)
    rebuilt = Rebuilt(scene, comm, log, outline.omega_n, kept.read_modes, kept.factor)
    pairs = pairs_of(arrays, texts)
    exact = texts["leaves_out"] == "modes"
    if exact:
        structure = exact_structure(under("model", arrays), comm, rebuilt.solve)
    else:
        structure = structure_of_modes(comm, modes_of(under("model", arrays)), observed_of(under("model", arrays)))
    reduction = Reduction(structure, selection_of(texts), rebuilt.displacements, texts["leaves_out"])
    better = None
    if texts["has_bars"]:
        other = under("better", arrays)
        compared_with = exact_structure(other, comm, rebuilt.solve) if other else structure
        better = EnrichedModel(compared_with, PerGroup.single(left_out_of(arrays)), is_solved=not other)
    known = exact_columns(reduction, better)
    if known is not None:
        columns.restore(known, structure.owned_rows)
    response = response_of(scene, pairs, reduction, outline.omega_n, better)
    return rebuilt.prepared(outline, pairs, reduction, response)


def exact_structure(arrays: Mapping[str, Any], comm: MPI.Comm, solve: Callable[[np.ndarray], np.ndarray]) -> ReducedStructure:
    """Return a structure with the exact static response, its columns to be solved for by ``solve``.  Local."""
    modes, static = modes_of(arrays), {name: arrays[name] for name in STATICS}
    n_pairs = len(modes.R_phi) // 3
    columns = StaticColumns(n_pairs, int(np.diff(split_evenly(n_pairs, comm.size))[comm.rank]), solve)
    receptance = Receptance(modes, StaticResponse(G_static=columns, **static))
    return ReducedStructure(
        comm=comm, n_pairs=n_pairs, n_outputs=len(modes.o), receptances=PerGroup.single(receptance), observed=observed_of(arrays)
    )


def exact_columns(reduction: Reduction, better: EnrichedModel | None) -> StaticColumns | None:
    """Return the static columns that were solved for with the factor; None where the modes of a basis give them.  Local."""
    if reduction.leaves_out == "modes":
        return reduction.structure.receptance_of(1).static.G_static
    return None if better is None or better.is_solved else better.structure.receptance_of(1).static.G_static
