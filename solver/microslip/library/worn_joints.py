"""The wear of the joints of a structure over many cycles: the library's function for wear (docs/theory.md, section 18)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, TypedDict, Unpack

import numpy as np

from ..messages.errors import ConvergenceError
from ..parallel.agree import on_root
from ..points.error_parts import total
from ..results.record import Joint
from ..results.wear import WearHistory
from ..scene.read import changed
from ..scene.wear import UNITS
from .build import Structure
from .jumps import WornState
from .result_files import head_of
from .wear import WearCycle, WearingJoint


class WearKeys(TypedDict, total=False):
    """Keys of [wear] that replace those of the scene."""

    law: Literal["energy", "archard"]
    coefficient: float | Mapping[str, float]
    cycles: float
    level: float | None
    output: str | None
    frequency: float | None
    jump: float | None
    tolerance: float
    area: float | Mapping[str, float] | None


def wear(
    structure: Structure, *, on_jump: Callable[[WornState[WearCycle]], None] | None = None, **keys: Unpack[WearKeys]
) -> WearHistory:
    """Return the joints of a structure over their life, by the table [wear] of its scene or by ``keys`` in its place.

    Collective on ``structure.comm``; the same on every rank.  docs/theory.md, section 18.

    Parameters
    ----------
    on_jump : called after each jump of cycles, on every rank

    Returns
    -------
    WearHistory : arrays over n numbers of cycles, the first 0: ``cycles`` (n,), ``depth`` (n, n_pairs) [m], ``N0`` (n, n_pairs)
        [N], ``frequency`` (n,) [Hz], ``amplitude`` (n,) of the output in its unit, ``damping`` (n,), and ``records()`` as in
        wear.csv; ``failure`` has the reason of an end before the stated cycles

    Raises
    ------
    CaseError : no [wear] and no keys, keys that it does not have, or wear that this structure cannot have; on every rank
    ConvergenceError : no response of the new joint; on every rank
    """
    if keys:
        structure = replace(structure, scene=changed(structure.scene, {"wear": dict(keys)}))
    wearing, failure = WearingJoint(structure), ""
    states = [wearing.start()]
    try:
        for state in wearing.follow(states[0]):
            states.append(state)
            if on_jump is not None:
                on_jump(state)
    except ConvergenceError as problem:
        failure = str(problem)
    joint = head_of(wearing.prepared(states[0].depth)).joint
    return on_root(structure.comm, history_of, wearing, joint, states, failure)


def history_of(wearing: WearingJoint, joint: Joint, states: Sequence[WornState[WearCycle]], failure: str = "") -> WearHistory:
    """Return the arrays of a study; of the points rank 0 has them all.  Local."""
    points, k, wear = [state.cycle.point for state in states], wearing.output, wearing.wear
    scene, units = wearing.structure.scene, wearing.units
    stated = np.array([wear.area_of(name) or np.nan for name in joint.names])[joint.joint]
    bars = [point.error for point in points]
    return WearHistory(
        law=wear.law,
        unit=UNITS[wear.law],
        level=wearing.level,
        level_unit=units.level,
        output=scene.outputs[k].name,
        output_unit=units.outputs[k],
        frequency_stays=wear.frequency is not None,
        joint=joint,
        area=np.where(np.isfinite(joint.area), joint.area, stated),
        cycles=np.array([state.cycles for state in states]),
        depth=np.array([state.depth for state in states]),
        total=np.array([state.energy for state in states]),
        energy=np.array([state.cycle.energy for state in states]),
        N0=np.array([state.cycle.N0 for state in states]),
        state=np.array([point.state for point in points]),
        frequency=np.array([point.omega for point in points]) / (2.0 * np.pi),
        amplitude=np.array([np.hypot(*point.response[k, 1:3]) for point in points]),
        damping=np.array([state.cycle.damping for state in states]),
        error=np.array([np.nan if bar is None else total(bar[k]) for bar in bars]),
        jump_error=np.array([state.error for state in states]),
        failure=failure,
    )
