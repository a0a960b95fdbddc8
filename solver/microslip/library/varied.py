"""Numbers of a scene that vary from sample to sample, and which parts of a structure remain valid for each.

level                                               the operating point alone
joints.NAME.friction, preload, gap                  the contact law; with [statics] friction and preload make another rest
joints.NAME.tangential_stiffness, normal_stiffness  the structure is built again; where its modes are to stay, and for numbers
                                                    in a file, the update (4.7) of the receptance, without a factor
[damping], [solver], [response], [continuation]     the reduced model
loads.N.scale, pressure, phase                      the coefficients of the loads
any other number                                    all of it: the structure is built again
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..contact.laws import LAWS
from ..messages.errors import CaseError
from ..messages.words import hint
from ..scene.overrides import words_of
from ..scene.read import with_settings
from ..scene.schema import Scene
from .fitted_numbers import IN_FILE
from .peak_curves import LAW_NAMES
from .respond import TABLES
from .settings import n_sectors_of

Kind = Literal["level", "law", "rest", "settings", "load", "build"]
LEVELS = ("level", "response.level", "response.levels")
OF_LOADS = ("scale", "pressure", "phase")
STIFFNESS = ("tangential_stiffness", "normal_stiffness")
_AT_REST = ("friction", "preload")  # of a joint, before the loads of [statics] act


@dataclass(frozen=True, eq=False)
class Varied:
    """The numbers of a scene that vary.  All methods are local and the same on every rank."""

    scene: Scene
    keys: tuple[str, ...]
    kinds: tuple[Kind, ...]
    nominal: np.ndarray  # (n_keys,) the numbers of the scene; NaN where it states none, 1 of factors
    is_factor: np.ndarray  # (n_keys,) bool, times numbers that a file gives

    @classmethod
    def of(cls, scene: Scene, keys: Sequence[str], keep_modes: bool = False) -> Varied:
        """Return the numbers with these keys; ``keep_modes`` of the structure under another contact stiffness.

        Raises
        ------
        CaseError : a key twice, or one that names no number of the scene
        """
        twice = next((key for i, key in enumerate(keys) if key in keys[:i]), None)
        if twice is not None:
            raise CaseError(f"{scene.source}: sweep: {twice} is stated twice; each number has one list, range or scatter")
        nominal, factors = zip(*(_number(scene, key) for key in keys)) if keys else ((), ())
        kinds = tuple(_kind(scene, key, keep_modes) for key in keys)
        return cls(scene, tuple(keys), kinds, np.array(nominal, dtype=float), np.array(factors, dtype=bool))

    def having(self, *kinds: Kind) -> list[int]:
        """Return the places of the keys of some kinds."""
        return [i for i, kind in enumerate(self.kinds) if kind in kinds]

    def from_the_scene(self, values: np.ndarray, spread: np.ndarray) -> list[int]:
        """Return the samples (n, n_keys) by their distance from the scene: each then has solved ones near by.

        Those of one structure follow each other.
        """
        away = (values - np.where(np.isfinite(self.nominal), self.nominal, values.mean(axis=0))) / np.where(
            spread > 0.0, spread, 1.0
        )
        by_structure: dict[tuple, list[int]] = {}
        for i in np.argsort(np.linalg.norm(away, axis=1), kind="stable"):
            by_structure.setdefault(self.items(values[i], "build"), []).append(int(i))
        return [i for of_one in by_structure.values() for i in of_one]

    def items(self, values: Sequence[float], *kinds: Kind) -> tuple[tuple[str, float], ...]:
        """Return key and value of the numbers of some kinds."""
        return tuple((self.keys[i], float(values[i])) for i in self.having(*kinds))

    def scene_at(self, values: Sequence[float], *kinds: Kind) -> Scene:
        """Return the scene with the numbers of a sample, or with those of some kinds; factors leave it as it is.

        Raises
        ------
        CaseError : the scene, or the file of a joint, does not allow a value
        """
        for i in np.flatnonzero(self.is_factor):
            _check_factor(self.scene, self.keys[i], float(values[i]))
        chosen = [i for i in (self.having(*kinds) if kinds else range(len(self.keys))) if not self.is_factor[i]]
        return with_settings(self.scene, [setting(self.keys[i], values[i]) for i in chosen]) if chosen else self.scene


def setting(key: str, value: float) -> str:
    """Return KEY=VALUE of a number, whole numbers without a point, as some keys of a scene require.  Local."""
    text = str(int(value)) if float(value).is_integer() and abs(value) < 1e15 else repr(float(value))
    return f"response.levels=[{text}]" if key in LEVELS else f"{key}={text}"


def as_keys(items: Sequence[tuple[str, float]]) -> dict[str, Any]:
    """Return numbers of [damping], [solver], ... as the keys of ``respond``.  Local."""
    return {key.split(".")[-1]: int(value) if float(value).is_integer() else value for key, value in items}


def of_joints(items: Sequence[tuple[str, float]]) -> dict[str, dict[str, float]]:
    """Return friction and preload by joint, as ``respond`` takes them.  Local."""
    values: dict[str, dict[str, float]] = {}
    for key, value in items:
        _, name, number = words_of(key)
        values.setdefault(number, {})[name] = value
    return values


def load_factors(scene: Scene, other: Scene) -> np.ndarray:
    """Return the factor of each shape of the loads of ``other`` over those of ``scene``, (n_loads,).  Local.

    Raises
    ------
    CaseError : a load of the scene is 0 and cannot be scaled
    """
    n_shapes = 2 if n_sectors_of(scene) > 1 else 1
    factors = []
    for before, after in zip(scene.loads, other.loads):
        was, now = ((load.pressure if load.pressure is not None else load.scale) for load in (before, after))
        if was == 0.0:
            raise CaseError(f"{scene.source}: [[loads]] scale = 0 has no other values; state the load with another number")
        factors += [now / was] * (len(after.phases) * n_shapes)
    return np.array(factors)


def _kind(scene: Scene, key: str, keep_modes: bool) -> Kind:
    """Return the kind of a number."""
    if key in LEVELS:
        return "level"
    words = words_of(key)
    first, last = words[0], words[-1]
    if first == "joints" and len(words) == 3 and last in LAW_NAMES:
        if scene.statics is not None:
            return "rest" if last in _AT_REST else "build"
        is_other_law = (keep_modes or last not in STIFFNESS) and (_stated(scene, words[1], last) or 0.0) > 0.0
        return "law" if is_other_law or _is_of_file(scene, words) else "build"
    if first == "loads" and len(words) == 3 and last in OF_LOADS:
        return "load"
    return "settings" if len(words) == 2 and first in TABLES else "build"


def _number(scene: Scene, key: str) -> tuple[float, bool]:
    """Return the number of a scene at a key, NaN where none is stated, and whether it is a factor of numbers in a file.

    Raises
    ------
    CaseError : the scene cannot have such a key, or it is no number
    """
    if key in LEVELS:
        return max(scene.response.levels), False
    words, of_file = words_of(key), False
    if len(words) < 2:
        raise CaseError(f"{scene.source}: sweep: {key!r} is not a key; expected for example joints.dovetail.friction, or level")
    try:
        with_settings(scene, [f"{key}=1"])
    except CaseError as problem:
        of_file = _is_of_file(scene, words)
        if not of_file and ("unknown key" in str(problem) or "there is no" in str(problem) or "which [[" in str(problem)):
            more = "" if "nearest is" in str(problem) else _near(scene, key)
            raise CaseError(f"{scene.source}: sweep: {key}: {str(problem).split(': ', 1)[-1]}{more}") from None
    if of_file:
        return 1.0, True
    value: Any = scene.model_dump()
    for word in words:
        if isinstance(value, list | tuple):
            named = [i for i, entry in enumerate(value) if isinstance(entry, Mapping) and entry.get("name") == word]
            value = value[named[0]] if named else value[int(word) - 1] if word.isdecimal() and int(word) <= len(value) else None
        else:
            value = value.get(word) if isinstance(value, Mapping) else None
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value), False
    if value is not None:
        raise CaseError(f"{scene.source}: sweep: {key} is no number in this scene, and only numbers vary")
    return float("nan"), False


def _is_of_file(scene: Scene, words: list[str]) -> bool:
    """Return whether a key is a number of a joint whose pairs have theirs from a file."""
    if words[0] != "joints" or len(words) != 3 or words[2] not in LAW_NAMES or scene.statics is not None:
        return False
    joint = next((joint for joint in scene.joints if joint.name == words[1]), None)
    return joint is not None and joint.pairs is not None


def _check_factor(scene: Scene, key: str, value: float) -> None:
    """Raise CaseError for a factor with which the numbers in the file of a joint are not allowed there.  Local."""
    _, name, number = words_of(key)
    joint = next(joint for joint in scene.joints if joint.name == name)
    is_above_0 = number == "preload" or IN_FILE[number] in LAWS[joint.law].above_0
    if value < 0.0 or (value == 0.0 and is_above_0):
        must = "must be above 0" if is_above_0 else "must not be negative"
        raise CaseError(f"{scene.source}: {key} = {value:g}: the factor of {IN_FILE[number]} in {joint.pairs} {must}")


def _stated(scene: Scene, name: str, number: str) -> float | None:
    """Return the number of a joint for all of its pairs; None where there is none, or a file has others for some."""
    values = [getattr(joint, number) for joint in scene.joints if joint.name == name and joint.parameters is None]
    return float(values[0]) if values and isinstance(values[0], float | int) else None


def _near(scene: Scene, key: str) -> str:
    """Return the number of a joint that was probably meant."""
    return hint(key, ["level", *(f"joints.{joint.name}.{name}" for joint in scene.joints for name in LAW_NAMES)])
