"""What runs of one stuck structure share on disk, and a set-up made of it for another friction, preload, range or accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..continuation.checkpoint import over, under
from ..library.build import Structure
from ..library.complete import read_completed
from ..library.prepare import Prepared, response_of
from ..library.settings import has_error_bars, reduction_settings
from ..mesh.data import ContactPairs
from ..mesh.pairing import pair_contacts
from ..mesh.read import read_mesh
from ..modes.eigen import Modes
from ..observe.log import RunLog
from ..parallel.agree import on_root
from ..receptance.per_group import PerGroup
from ..receptance.reduced_structure import ReducedStructure
from ..receptance.static_columns import StaticColumns
from ..receptance.truncated_modes import EnrichedModel
from ..reduction.choose_again import KnownStructure, choose_again, with_first
from ..reduction.left_out_again import OnRandom, left_out_again, on_random
from ..reduction.methods import SELECTIONS
from ..reduction.modal_structure import stuck_receptance
from ..reduction.reduction import Reduction
from ..reduction.settings import ModalDamping
from .records import Arrays
from .restore import KeptSetup, Rebuilt, exact_structure
from .setup import left_out_of, numbers_of, of_reduced, of_rest, outline_of, pairs_of, texts_of_pairs

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..scene.schema import Scene

WHY = "modes: "  # how the note begins that says why so many
_LIMITS = ("mu", "N0", "own/mu_y")  # of pairs: the stuck structure does not know of them


def is_shared(prepared: Prepared) -> bool:
    """Return whether a set-up is one that can be shared: modes of the structure and its exact statics.  Local."""
    return prepared.scene.solver.method in SELECTIONS and 0 < len(prepared.outline.omega_n) <= prepared.outline.n_dof


def all_found(structure: Structure) -> Modes:
    """Return all modes that were found with those of a structure.  Local."""
    return structure.modes.found or structure.modes


def shared_arrays(prepared: Prepared) -> tuple[Arrays, dict[str, Any]]:
    """Return the arrays and texts that runs of the structure share, without modes and static columns.

    Collective: sums.

    Raises
    ------
    CaseError : the damping matrix feeds energy into a mode that was found, but is not kept
    """
    structure, settings = prepared.structure, reduction_settings(prepared.scene)
    modes = all_found(structure)
    receptance = stuck_receptance(replace(structure, n_modes=len(modes.omega_n)), settings.damping)
    reduced = replace(prepared.reduction.structure, receptances=PerGroup.single(receptance))
    arrays = over("pairs", numbers_of(prepared.pairs)) | over("model", of_reduced(reduced))
    arrays |= over("outline", numbers_of(replace(prepared.outline, omega_n=modes.omega_n)))
    arrays |= over("random", numbers_of(on_random(structure, modes)))
    n_kept, better = structure.n_modes, prepared.response.better
    texts: dict[str, Any] = texts_of_pairs(prepared.pairs, prepared.outline) | {
        "joints": joints_of(prepared.scene),
        "is_at_rest": prepared.scene.statics is not None,  # the file may state it, and joints and dampers
        "damping": damping_of(prepared.scene) if any(spring.damping for spring in prepared.scene.springs) else None,
        "n_kept": n_kept,
        "n_proved": max(structure.modes.n_proved, n_kept if settings.verify_modes else 0),
        "has_bars": better is not None,
    }
    arrays |= of_rest(prepared.outline)
    left_out = None if better is None else better.truncated.of(1)
    if left_out is not None:
        arrays |= over("left_out", numbers_of(left_out))
    return arrays, texts


def joints_of(scene: Scene) -> list[dict[str, Any]]:
    """Return the joints of a scene as stated, as JSON has them.  Local."""
    return [joint.model_dump(mode="json", exclude_unset=True) for joint in scene.joints]


def damping_of(scene: Scene) -> dict[str, Any] | None:
    """Return [damping] of a scene as stated, as JSON has it.  Local."""
    return None if scene.damping is None else scene.damping.model_dump(mode="json")


def made_of(kept: KeptSetup, scene: Scene, log: RunLog) -> tuple[Prepared, str] | None:
    """Return a scene prepared from what runs of its structure share, and why so many modes; None if that takes a factor.

    Collective on the ranks of the columns kept.

    Raises
    ------
    CaseError, MeshError, ResourceError : as those who build a structure, on every rank
    """
    arrays, texts, columns = kept.arrays, kept.texts, kept.columns
    comm, settings, own = columns.comm, reduction_settings(scene), pairs_of(arrays, texts)
    pairs = own if texts["is_at_rest"] else pairs_for(scene, own, texts["joints"], comm)
    if pairs is None or settings.method not in SELECTIONS:
        return None
    if texts["damping"] is not None:  # what the dampers add is kept in one with it
        if settings.damping is None or damping_of(scene) != texts["damping"]:
            return None
        settings = replace(settings, damping=replace(settings.damping, is_alone=False))
    outline = outline_of(arrays, texts)
    rebuilt = Rebuilt(scene, comm, log, outline.omega_n, kept.read_modes, kept.factor)
    everything = exact_structure(under("model", arrays), comm, rebuilt.solve)
    columns.restore(everything.receptance_of(1).static.G_static, everything.owned_rows)
    known = KnownStructure(everything, outline.n_dof, texts["n_proved"])
    chosen = choose_again(known, pairs.law, settings)
    if chosen is None:
        return None
    n_modes, why = chosen
    receptance = with_first(everything, n_modes, settings.damping).receptance_of(1)
    static = replace(receptance.static, G_static=to_ask_for(receptance.static.G_static))
    reduced = replace(everything, receptances=PerGroup.single(replace(receptance, static=static)))
    better = None
    if has_error_bars(scene):
        better = _better(arrays, texts, reduced, known, settings.damping)
        if better is None:
            return None
    outline = replace(outline, omega_n=rebuilt.keep_first(n_modes))
    reduction = Reduction(reduced, SELECTIONS[settings.method](settings), rebuilt.displacements, "modes")
    response = response_of(scene, pairs, reduction, outline.omega_n, better)
    return rebuilt.prepared(outline, pairs, reduction, response), why


def to_ask_for(known: StaticColumns) -> StaticColumns:
    """Return columns of which none counts as known until it is asked for, as in a run of its own.  Local.

    How the response is solved, and so which points a curve has, depends on which columns are known.
    """
    n_pairs, n_owned = len(known.known), known.transposed(np.empty(0, dtype=int)).shape[1] // 3
    return StaticColumns(n_pairs, n_owned, lambda pairs: known.transposed(pairs).T)


def _better(
    arrays: Arrays, texts: Mapping[str, Any], reduced: ReducedStructure, known: KnownStructure, damping: ModalDamping | None
) -> EnrichedModel | None:
    """Return what error bars compare with; None where its samples are not known.  Local."""
    n, n_kept = len(reduced.receptance_of(1).modes.omega_n), texts["n_kept"]
    left_out = left_out_of(arrays)
    if n == known.n_dof:
        return EnrichedModel.of_all_modes(reduced)
    if left_out is None or (left_out.coupling is not None and n != n_kept):
        return None
    seen, receptance = OnRandom(**under("random", arrays)), reduced.receptance_of(1)
    again = left_out_again(left_out, n_kept, receptance, known.modes, seen, damping)
    return EnrichedModel(reduced, PerGroup.single(again), True)


def pairs_for(scene: Scene, kept: ContactPairs, joints: list[dict[str, Any]], comm: MPI.Comm) -> ContactPairs | None:
    """Return the contact pairs of a scene: those kept, or with limits of its own; None where more than these differs.

    Collective.
    """
    if joints == joints_of(scene):
        return kept
    if scene.model.mesh is None:
        return None
    file, whole, _ = read_completed(scene, comm)
    return on_root(comm, _paired, whole, file, kept)


def _paired(scene: Scene, file, kept: ContactPairs) -> ContactPairs | None:
    """Return the pairs of a scene as they are found, if they have the springs and places of those kept.  Rank 0."""
    pairs = pair_contacts(read_mesh(scene, file), scene.joints)
    one, other = ({k: v for k, v in numbers_of(which).items() if k not in _LIMITS} for which in (pairs, kept))
    same = one.keys() == other.keys() and all(np.array_equal(one[key], other[key], equal_nan=True) for key in one)
    same = same and pairs.joint == kept.joint and np.array_equal(pairs.laws, kept.laws)
    return pairs if same and np.array_equal(pairs.law.stiffness, kept.law.stiffness) else None
