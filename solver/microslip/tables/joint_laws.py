"""Which keys of a joint belong to which contact law."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any

from ..contact.keys import ELASTIC_COULOMB, KEYS, ROUGH

LAWS_OF_KEY = {key: tuple(law for law in KEYS if key in KEYS[law].all) for keys in KEYS.values() for key in keys.all}
OF_FILE = {key for keys in KEYS.values() for key in keys.of_file}  # keys whose place a CSV file of pairs takes
OWN = tuple(key for key, laws in LAWS_OF_KEY.items() if ELASTIC_COULOMB not in laws)  # beside what every joint has


def check_law(joint: Mapping[str, Any], stated: Set[str]) -> None:
    """Raise ValueError where a key of a joint belongs to another law, or its law does not take a value.  Local.

    ``joint`` has the values of all keys, ``stated`` are those that the scene states.
    """
    law = joint["law"]
    for key, laws in LAWS_OF_KEY.items():
        if key in stated and law not in laws:
            raise ValueError(f"{key} belongs to law = {' or '.join(map(_quoted, laws))}; this joint has law = {_quoted(law)}")
    for key in ("friction", "tangential_stiffness"):
        if isinstance(joint[key], tuple):
            _check_directions(joint, key)
    if law == ROUGH and joint["pairs"] is None:
        _check_rough(joint)


def _check_directions(joint: Mapping[str, Any], key: str) -> None:
    """Raise ValueError where a joint states two numbers of a key that its law takes for both directions alike."""
    if joint["law"] != ELASTIC_COULOMB:
        raise ValueError(f"{key}: law = {_quoted(joint['law'])} takes one number for both directions")
    if joint["friction_limit"] != "separate":
        raise ValueError(f'{key} = [x, y] needs friction_limit = "separate": a friction circle has one number for both')
    if joint["parameters"] is not None or joint["fields"]:
        given = "parameters, a file" if joint["parameters"] is not None else "fields, a table"
        raise ValueError(f"{key} = [x, y] with {given} of values for each point: state one number")


def _check_rough(joint: Mapping[str, Any]) -> None:
    """Raise ValueError where rough surfaces carry nothing at rest, or their power is half stated."""
    if joint["preload"] == "static" and joint["exponent"] is None:
        raise ValueError(
            f'preload = "static": the exponential of law = {_quoted(ROUGH)} has no approach at which nothing presses; state '
            "in Pa the pressure at which the surfaces lie as the mesh has them, from which [statics] starts; or a power, "
            "exponent and roughness_pressure, which begins without any"
        )
    if joint["preload"] == 0.0:
        raise ValueError(f"preload = 0: rough surfaces that carry nothing have no stiffness, law = {_quoted(ROUGH)} needs some")
    if (joint["exponent"] is None) != (joint["roughness_pressure"] is None):
        there, missing = ("exponent", "roughness_pressure")[:: 1 if joint["roughness_pressure"] is None else -1]
        raise ValueError(f"{there} without {missing}: a power takes both, the exponential neither")


def _quoted(word: str) -> str:
    return f'"{word}"'
