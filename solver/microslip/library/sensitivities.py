"""Sensitivities by the numbers of a scene: sums over the sensitivities by the values of its pairs."""

from __future__ import annotations

import numpy as np

from ..contact.iwan import limit
from ..contact.keys import IWAN, KEYS
from ..mesh.data import ContactPairs
from ..results.sensitivities import Varied
from ..scene.overrides import words_of
from ..scene.schema import Scene
from .settings import units_of

LAW_NAMES = {"friction": "mu", "preload": "N0", "gap": "gap", "tangential_stiffness": "k_t", "normal_stiffness": "k_n"}
UNITS = {
    "friction": "1",
    "preload": "Pa",
    "gap": "m",
    "tangential_stiffness": "N/m3",
    "normal_stiffness": "N/m3",
    "slip_force": "N",
}
OF_TABLES = {("materials", "young"): "Pa", ("materials", "density"): "kg/m3", ("damping", "ratio"): "1"}
IN_FORCES = {"preload": "N", "tangential_stiffness": "N/m", "normal_stiffness": "N/m"}  # of pairs without an area
FACTOR = "times the scene's values"  # the unit of a number that differs from pair to pair, or that a law or a file gives
NUMBER_OF = LAW_NAMES | {"slip_force": "slip_force"}
AT_REST = ("preload", "gap")  # computed by [statics]: a factor of the values of the pairs at rest


def unit_of_key(scene: Scene, key: str) -> str:
    """Return the unit of a number of a scene; "" where it is not known.  Local."""
    first, *_, last = words_of(key) or [""]
    if first == "joints":
        of_surfaces = any(joint.name == words_of(key)[1] and joint.surfaces is not None for joint in scene.joints)
        return UNITS.get(last, "") if of_surfaces else ""
    return OF_TABLES.get((first, last), "")


def varied_numbers(scene: Scene, pairs: ContactPairs) -> list[Varied]:
    """Return the numbers of joints, loads and damping by which there are derivatives, in the order of the scene.  Local."""
    of_joints = [each for name in pairs.by_joint() for key in NUMBER_OF for each in _of_joint(scene, pairs, name, key)]
    level = Varied("level", units_of(scene).level, None, "level", np.zeros(0, dtype=int), np.array(1.0))
    return [*of_joints, level, *_damping(scene)]


def numbers_of_law(law: str) -> tuple[str, ...]:
    """Return the numbers that joints of a law state.  Local."""
    return *KEYS[law].needed, *KEYS[law].further


def _of_joint(scene: Scene, pairs: ContactPairs, name: str, key: str) -> list[Varied]:
    """Return a number of a joint; none where its law, or its pairs, do not have it."""
    of = pairs.of_joint(name)
    law, joint = pairs.laws[of[0]], next((joint for joint in scene.joints if joint.name == name), None)
    if key not in numbers_of_law(law):
        return []
    column = np.maximum(np.nan_to_num(column_of(pairs, key)[of]), 0.0)
    if not column.any():
        return []
    stated, unit, value = getattr(joint, key), FACTOR, 1.0
    if isinstance(stated, float) and stated > 0.0 and not (scene.statics is not None and key in AT_REST):
        unit, value = unit_of_pairs(pairs, of, key), stated
    weights = column / value
    if key == "gap":
        return [Varied(f"joints.{name}.gap", unit, value, "N0", of, -pairs.k_n[of] * weights)]
    return [Varied(f"joints.{name}.{key}", unit, value, NUMBER_OF[key], of, weights)]


def unit_of_pairs(pairs: ContactPairs, numbers: np.ndarray, key: str) -> str:
    """Return the unit of a number stated for all pairs of a joint: per area if these have one.  Local."""
    return UNITS[key] if np.isfinite(pairs.area[numbers]).all() else IN_FORCES.get(key, UNITS[key])


def column_of(pairs: ContactPairs, key: str) -> np.ndarray:
    """Return a number of the pairs, (n_pairs,).  Local."""
    if key == "slip_force":
        stated = pairs.law_columns.get("slip_force", np.full(pairs.n_pairs, np.nan))
        return np.where(pairs.laws == IWAN, limit({"mu": pairs.mu, "N0": pairs.N0, "slip_force": stated}), 0.0)
    gap = np.divide(-pairs.N0, pairs.k_n, out=np.zeros_like(pairs.k_n), where=pairs.k_n > 0.0)
    columns = {"friction": pairs.mu, "preload": pairs.N0, "gap": gap, "tangential_stiffness": pairs.k_t}
    return columns.get(key, pairs.k_n)


def damping_key(scene: Scene) -> str:
    """Return the key of the damping that varies: of a ratio alone, or of all damping.  Local."""
    return _damping(scene)[0].key


def _damping(scene: Scene) -> list[Varied]:
    """Return the ratio of all modes if this is the only damping; otherwise a factor of all their damping."""
    damping, none = scene.damping, np.zeros(0, dtype=int)
    stated = {} if damping is None else {key: value for key, value in damping if value}
    if set(stated) == {"ratio"}:
        return [Varied("damping.ratio", "1", float(stated["ratio"]), "damping", none, np.array(1.0 / stated["ratio"]))]
    return [Varied("damping", FACTOR, 1.0, "damping", none, np.array(1.0))]
