"""The numbers of a scene that an identification fits, and their bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..assembly.pair_file import COLUMNS
from ..formats.csv_table import read_table
from ..messages.errors import CaseError
from ..messages.words import hint, listed
from ..results.sensitivities import Varied
from .build import Structure
from .sensitivities import NUMBER_OF, damping_key, numbers_of_law, varied_numbers

AT_REST = ("friction", "preload", "gap")
IN_FILE = {  # the columns of a file of pairs
    "friction": "mu",
    "preload": "n0",
    "gap": "g0",
    "tangential_stiffness": "kt",
    "normal_stiffness": "kn",
    "slip_force": "mu",
}


@dataclass(frozen=True, eq=False)
class Fitted:
    """A number that is fitted: within bounds, over its logarithm where these are above 0."""

    varied: Varied
    low: float
    high: float

    @property
    def is_log(self) -> bool:
        """Whether the search takes the logarithm of the number."""
        return self.low > 0.0

    def x(self, value: float) -> float:
        """Return the variable of the search for a value."""
        return float(np.log(value)) if self.is_log else value

    def value(self, x: float) -> float:
        """Return the value for a variable of the search."""
        return float(np.exp(x)) if self.is_log else float(x)


def refuse_bounds(scene: Any, bounds: Mapping[str, tuple[float, float]]) -> None:
    """Refuse numbers and bounds that are wrong for the scene, before its structure is built.  Local; reads pair files.

    Raises
    ------
    CaseError : as :func:`identify`; joints and numbers of a model file are not known here
    """
    keys, joints = _offered(scene), {joint.name: joint for joint in scene.joints}
    if not bounds:
        raise CaseError(f"identify: numbers to fit are missing; there are {listed(keys)}")
    for key, ends in bounds.items():
        name, _, number = key.removeprefix("joints.").rpartition(".")
        if scene.statics is not None and number in AT_REST:
            raise CaseError(f"identify: {key} changes the state of rest with [statics]; fit stiffness and damping alone")
        is_of_file = scene.model.mesh is not None and key.startswith("joints.") and name not in joints and number in NUMBER_OF
        if key not in keys and not is_of_file:
            raise _no_number(key, keys)
        value = scene.damping.ratio if key == "damping.ratio" else getattr(joints.get(name), number, None)
        value = 1.0 if name in joints and joints[name].pairs is not None else value  # a factor
        _check_bounds(key, *ends, float(value) if isinstance(value, float) and value > 0.0 else None)
        if number == "gap" and f"joints.{name}.normal_stiffness" in bounds:
            raise CaseError(f"identify: {name}.gap and {name}.normal_stiffness: fit one of them, which the other depends on")


def _no_number(key: str, keys: Sequence[str]) -> CaseError:
    only = "; damping.ratio is a number where it is all damping there is" if key.startswith("damping") else ""
    return CaseError(f"identify: there is no number {key!r}{hint(key, list(keys))}; there are {listed(list(keys))}{only}")


def _offered(scene: Any) -> list[str]:
    """Return the numbers to fit that are above 0 in the scene."""
    of_joints = [
        f"joints.{joint.name}.{number}"
        for joint in scene.joints
        for number in NUMBER_OF
        if number in numbers_of_law(joint.law) and not (scene.statics is not None and number in AT_REST)
        if _states(scene, joint, number)
    ]
    return [*of_joints, *(key for key in [damping_key(scene)] if key == "damping.ratio")]


def _states(scene: Any, joint: Any, number: str) -> bool:
    """Return whether pairs of a joint have, or may have, more than 0 of a number."""
    if joint.pairs is not None:
        return bool((read_table(scene.folder / joint.pairs, COLUMNS, what="pair")[0][IN_FILE[number]] > 0.0).any())
    if joint.parameters is not None or number in joint.fields:
        return True
    return bool(getattr(joint, number)) or (number == "gap" and joint.has_gap_of_mesh)


def _check_bounds(key: str, low: float, high: float, value: float | None) -> None:
    """Raise CaseError unless bounds are of at least 0, rise, and hold the value of the scene where it is known."""
    if 0.0 <= low < high < np.inf and (value is None or low <= value <= high):
        return
    if 0.0 <= low < high < np.inf:
        raise CaseError(f"identify: {key} = {low:g}:{high:g}: the fit begins at the scene's value, {value:g}, not within")
    raise CaseError(f"identify: {key} = {low:g}:{high:g}: two bounds of at least 0 are expected, the lower one first")


def fitted_numbers(scene: Any, structure: Structure, bounds: Mapping[str, tuple[float, float]]) -> list[Fitted]:
    """Return the numbers to fit.  CaseError as :func:`identify`."""
    refuse_bounds(scene, bounds)
    known = {each.key: each for each in varied_numbers(scene, structure.pairs) if each.key not in ("level", "damping")}
    fitted = []
    for key, ends in bounds.items():
        if key not in known:
            raise _no_number(key, list(known))
        low, high = map(float, ends)
        value = known[key].value
        _check_bounds(key, low, high, value)
        fitted.append(Fitted(known[key], low, high))
    return fitted
