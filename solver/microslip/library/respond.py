"""Responses of a structure built once, with other levels, friction, preload, harmonics or method."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

import numpy as np

from ..contact.laws import LAWS
from ..mesh.data import ContactPairs
from ..messages.errors import CaseError
from ..messages.words import counted, hint
from ..modes.limits import refuse_too_many
from ..observe.observer import Observer
from ..receptance.per_group import PerGroup
from ..reduction.choose_modes import choose_modes
from ..reduction.settings import ReductionSettings
from ..reduction.stuck import OnDemand
from ..reduction.whole_disc import WholeDisc
from ..scene import solution
from ..scene.read import changed
from ..scene.schema import Scene
from ..tables.table import Table
from ..tables.vibration import Damping
from .arguments import refuse_no_structure, whole_number
from .build import Structure, at_another_rest
from .follow_response import follow
from .prepare import Prepared, prepare
from .response import Response
from .settings import reduction_settings

if TYPE_CHECKING:
    from numpy.typing import ArrayLike  # slow import

    OfJoints = ArrayLike | Mapping[str, ArrayLike]

TABLES: dict[str, type[Table]] = {
    "response": solution.Response,
    "solver": solution.Solver,
    "continuation": solution.Continuation,
    "damping": Damping,
}
INSTEAD_OF = {
    "frequencies": ("mode", "span"),
    "mode": ("frequencies",),
    "ratio": ("rayleigh", "ratios", "modes"),
    "ratios": ("rayleigh", "ratio", "modes"),
    "rayleigh": ("ratio", "ratios", "modes"),
}


class Keys(TypedDict, total=False):
    """Keys of [response], [solver], [continuation] and [damping] that replace those of the scene."""

    levels: float | Sequence[float]
    frequencies: tuple[float, float] | None
    mode: int | None
    span: tuple[float, float] | None
    points: int
    at: float | Sequence[float]
    direction: Literal["up", "down"]
    peaks: bool
    stability: bool
    sensitivities: bool
    fields: bool
    method: str
    accuracy: float | None
    accuracy_of: Literal["amplitude", "corrected"]
    modes: int | None
    harmonics: int | Sequence[int]
    samples: int
    between_samples: Literal["path", "return-map"]
    energy_tolerance: float
    tolerance: float
    condensed: bool
    interface_modes: int
    in_point_check: bool
    error_bars: bool
    verify_modes: bool
    ds: float | None
    ds_min: float | None
    ds_max: float | None
    ratio: float | None
    rayleigh: tuple[float, float] | None
    ratios: Sequence[float] | None
    structural: float | None


def respond(
    structure: Structure,
    *,
    friction: OfJoints | None = None,
    preload: OfJoints | None = None,
    observers: Iterable[Observer] = (),
    n_groups: int = 1,
    divides: bool = False,
    **keys: Unpack[Keys],
) -> Response:
    """Return the response of a structure: with the settings of its scene, except those given.

    Collective on ``structure.comm``; the same on every rank.  The factor, the static columns and the modes are reused.  If
    ``modes``, ``accuracy`` or the range are given, the modes are chosen again with the same factor; otherwise they are those
    chosen for the levels, friction, preload and damping of the scene.

    With [statics], another friction or preload (before the loads act) leads to another state of rest.  It is computed from the
    mesh, the matrices and the forces of the structure, with a factor of the reference structure that the first such call makes
    and the structure stores.  Where the stiffness at rest changes, with the stress in the structure or the closed pairs, the
    factor, static columns and modes are computed again; otherwise they are reused.  The structure stores the last such rest:
    fields of an earlier one compute theirs again.

    Parameters
    ----------
    friction : coefficient [-] of all joints, or of some by name; a number, or one for each pair of the joint
    preload : contact pressure at rest [Pa] of the same, with [statics] before its loads act; of pairs from a CSV file their
        forces [N]
    observers : are notified of levels and points on rank 0, as they are computed
    n_groups : groups of ranks that follow levels in parallel
    divides : whether each level is divided into parts, which the groups follow at the same time
    keys : of [response], [solver], [continuation] and [damping], as in a scene: those of :class:`Keys`

    Raises
    ------
    CaseError : a value that no scene may have, or a closed structure; on every rank
    ConvergenceError : no rest with this friction and preload; on every rank
    ResourceError : not enough memory; on every rank
    """
    n_groups = whole_number(n_groups, 1, "respond: n_groups")
    prepared, notes = prepared_with(structure, {"friction": friction, "preload": preload}, keys)
    return Response(prepared, follow(prepared.response, observers, n_groups, divides=divides), notes)


def prepared_with(
    structure: Structure,
    of_joints: Mapping[str, OfJoints | None],
    keys: Mapping[str, Any],
    has_bars: bool | None = None,
    has_curve: bool = True,
) -> tuple[Prepared, tuple[str, ...]]:
    """Return a structure prepared with other keys, friction and preload, and notes.  Collective; :func:`respond`."""
    refuse_no_structure(structure, "respond")
    if "over" in keys:
        raise CaseError(
            "respond: over: a response has no peaks over a number; call microslip.peaks(structure, over={key: (a, b)})"
        )
    scene = scene_with(structure.scene, keys, of_joints)
    if structure.scene.statics is None or all(values is None for values in of_joints.values()):
        pairs = pairs_with(structure.pairs, of_joints)
        of_scene, why = with_modes_for(structure, reduction_settings(scene), pairs)
        notes = [why]
    else:
        of_scene, notes = at_rest_with(structure, scene, of_joints)
    return prepare(of_scene, scene, has_bars, has_curve=has_curve), tuple(filter(None, notes))


def at_rest_with(structure: Structure, scene: Scene, of_joints: Mapping[str, OfJoints | None]) -> tuple[Structure, list[str]]:
    """Return the structure at rest with other friction and preload, with the modes for ``scene``, and notes.

    Collective.  Its large parts are those of the last other rest; if another one replaced them, they are computed again.

    Raises
    ------
    CaseError, ConvergenceError, ResourceError : on every rank
    """
    reference = structure.reference
    if reference is None:
        raise CaseError("respond: friction and preload take part in the statics; ask the structure that was built of the scene")
    at_rest_scene, pairs = scene_with(structure.scene, {}, of_joints), pairs_with(reference.pairs, of_joints)

    def find() -> tuple[Structure, list[str]]:
        at_rest, notes = at_another_rest(structure, at_rest_scene, pairs)
        at_rest, why = with_modes_for(at_rest, reduction_settings(scene), at_rest.pairs)
        return at_rest, [*notes, why]

    at_rest, notes = find()
    if at_rest is structure:
        return structure, notes
    return replace(at_rest, factored=OnDemand(lambda: find()[0].factored(), is_stored=False)), notes


def scene_with(scene: Scene, keys: Mapping[str, Any], of_joints: Mapping[str, OfJoints | None]) -> Scene:
    """Return a scene with other keys and, for joints of surfaces with a single value, other friction and preload.  Local.

    Raises
    ------
    CaseError : an unknown key, or a value that no scene may hold
    """
    tables: dict[str, dict[str, Any]] = {}
    for key, value in keys.items():
        table = next((name for name, kind in TABLES.items() if key in kind.model_fields), None)
        if table is None:
            known = [known for kind in TABLES.values() for known in kind.model_fields]
            raise CaseError(f"respond: unknown key {key!r}{hint(key, known)}")
        rivals = {rival: None for rival in INSTEAD_OF.get(key, ()) if rival not in keys}
        listed = (value,) if key in ("levels", "at") and np.ndim(value) == 0 else value
        tables.setdefault(table, {}).update({key: listed, **rivals})
    joints: dict[str, dict[str, float]] = {joint.name: {} for joint in scene.joints if joint.surfaces is not None}
    for key, values in of_joints.items():
        for name, value in _by_joint(values, joints).items():
            if name in joints and np.ndim(value) == 0:
                joints[name][key] = float(_numbers(value, f"respond: {key} of joint {name!r}"))
    return changed(scene, tables, joints) if tables or any(joints.values()) else scene


def pairs_with(pairs: ContactPairs, of_joints: Mapping[str, OfJoints | None]) -> ContactPairs:
    """Return the pairs with other friction and preload.  Local.

    Raises
    ------
    CaseError : an unknown joint, a wrong number of values, or negative values
    """
    by_joint = pairs.by_joint()
    columns = {"friction": pairs.mu.copy(), "preload": pairs.N0.copy()}
    for key, values in of_joints.items():
        for name, value in _by_joint(values, tuple(by_joint)).items():
            where = f"respond: {key} of joint {name!r}"
            if name not in by_joint:
                raise CaseError(f"{where}: there is no such joint{hint(name, by_joint)}")
            of_joint = by_joint[name]
            numbers = _numbers(value, where)
            if numbers.shape not in ((), (len(of_joint),)) or not np.all(np.isfinite(numbers) & (numbers >= 0.0)):
                raise CaseError(
                    f"{where}: a number of at least 0 is expected, or one for each of its {counted(len(of_joint), 'pair')}"
                )
            _check_law(key, pairs, of_joint, where)
            if key == "preload" and np.any(pairs.N0[of_joint] < 0.0):
                raise CaseError(f"{where}: it has a gap, and an open pair carries no preload")
            area = np.nan_to_num(pairs.area[of_joint], nan=1.0) if key == "preload" else 1.0
            columns[key][of_joint] = numbers * area
    return replace(pairs, mu=columns["friction"], N0=columns["preload"])


def _check_law(key: str, pairs: ContactPairs, of_joint: np.ndarray, where: str) -> None:
    """Raise CaseError if a joint's law does not have this value, has several, or a stiffness that depends on it."""
    law = pairs.laws[of_joint[0]]
    if key not in LAWS[law].limits:
        raise CaseError(f'{where}: its law, "{law}", has none, or its stiffness follows from it; change the scene and rebuild')
    if key == "friction" and not np.isnan(pairs.law_columns.get("mu_y", np.full(pairs.n_pairs, np.nan))[of_joint]).all():
        raise CaseError(f"{where}: it has a coefficient for each direction; change them in the scene and build again")


def _numbers(value: ArrayLike, where: str) -> np.ndarray:
    """Return an array of numbers; CaseError if the values are none."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise CaseError(f"{where}: expected numbers, found {value!r}") from None


def _by_joint(values: OfJoints | None, names: Iterable[str]) -> Mapping[str, ArrayLike]:
    """Return values by joint; a single value applies to every joint."""
    if values is None:
        return {}
    return values if isinstance(values, Mapping) else {name: values for name in names}


def with_modes_for(structure: Structure, settings: ReductionSettings, pairs: ContactPairs) -> tuple[Structure, str]:
    """Return the structure with other pairs and their modes, and the reason for the number of modes, "" if nothing changed.

    Collective.

    A choice by accuracy also depends on levels, damping and the limits of the pairs.
    """
    is_same = np.array_equal(pairs.mu, structure.pairs.mu) and np.array_equal(pairs.N0, structure.pairs.N0)
    with_pairs = structure if is_same else replace(structure, pairs=pairs)
    if _of_modes(settings) == _of_modes(reduction_settings(structure.scene)):
        return with_pairs, ""
    if isinstance(structure, WholeDisc):
        raise CaseError(
            "respond: the modes of a whole disc are chosen for each nodal diameter when it is built; change the scene and "
            "build again"
        )
    refuse_too_many(settings.modes, structure.n_dof, settings.where)
    key: tuple = ("modes", *_of_modes(settings))
    if settings.modes is None:
        limits = pairs.mu.tobytes(), pairs.N0.tobytes()
        key = (*key, settings.method, settings.excitation, settings.damping, settings.level, *limits)
    chosen, why = structure.once(key, lambda: _in_all_groups(*choose_modes(with_pairs, settings), settings))
    return chosen if is_same else replace(chosen, pairs=pairs), why


def _in_all_groups(structure: Structure, why: str, settings: ReductionSettings) -> tuple[Structure, str]:
    """Return a structure whose other harmonic groups choose their modes by the same settings, on demand.  Local."""
    others = structure.groups
    if others is None:
        return structure, why
    groups = PerGroup(lambda group: choose_modes(others.of_group(group), settings)[0], others.group_of, others.groups)
    return replace(structure, groups=groups), why


def _of_modes(settings: ReductionSettings) -> tuple:
    return settings.modes, settings.accuracy, settings.insists, settings.verify_modes, settings.band
