"""Checks of the table [wear]."""

import math

from ...contact.keys import ELASTIC_COULOMB, ROUGH
from ...messages.words import hint
from ...tables.joint import Joint
from ..schema import Scene
from ..wear import ARCHARD, ENERGY, Wear


def of_wear(scene: Scene) -> list[str]:
    """Return mistakes of [wear]: joints and outputs that are not there, scenes that it does not support."""
    wear, mistakes = scene.wear, list[str]()
    if wear is None:
        return []
    names, outputs = [joint.name for joint in scene.joints], [output.name for output in scene.outputs]
    for key in ("coefficient", "area"):
        stated = getattr(wear, key)
        for name in stated if isinstance(stated, dict) and not scene.awaits_file else ():
            if name not in names:
                mistakes.append(f"[wear] {key}: there is no joint {name!r}{hint(name, names)}")
    mistakes += [mistake for joint in scene.joints for mistake in _worn_joint(scene, wear, joint)]
    if wear.output is not None and wear.output not in outputs:
        mistakes.append(f"[wear] output: there is no output {wear.output!r}{hint(wear.output, outputs)}")
    low, high = scene.response.frequencies or (0.0, math.inf)
    if wear.frequency is not None and not low <= wear.frequency <= high:
        mistakes.append(f"[wear] frequency = {wear.frequency:g} Hz: outside [response] frequencies = [{low:g}, {high:g}]")
    if scene.is_static:
        mistakes.append("[wear]: with harmonics = 0 nothing vibrates, and nothing slides; leave [wear] out")
    if scene.cyclic is not None:
        mistakes.append("[wear]: a disc is not supported: each sector would wear by its own response; leave [cyclic] out")
    if scene.solver.method in ("adaptive", "adaptive-energy"):
        mistakes.append(
            f'[wear]: method = "{scene.solver.method}" takes its pairs from the point before, and a jump of cycles has none; '
            'take "receptance"'
        )
    return mistakes


def _worn_joint(scene: Scene, wear: Wear, joint: Joint) -> list[str]:
    """Return mistakes: a joint without a coefficient, or that wear is not computed of."""
    where, coefficient = f"[wear] coefficient: joint {joint.name!r}", wear.coefficient_of(joint.name)
    if coefficient is None:
        return [f"{where} has none; state 0 if it does not wear"]
    if joint.law == ROUGH and scene.statics is None:
        return [
            f'[wear]: the springs of joint {joint.name!r}, law = "{ROUGH}", follow from a preload that wear changes; they are '
            "computed again with [statics] alone"
        ]
    if coefficient == 0.0:
        return []
    if joint.law != ELASTIC_COULOMB:
        return [
            f'{where} has law = "{joint.law}", whose limits do not follow from a worn shape; wear is computed with law = '
            f'"{ELASTIC_COULOMB}"; state 0 if it does not wear'
        ]
    if wear.law == ARCHARD and isinstance(joint.friction, tuple):
        return [
            f'[wear] law = "{ARCHARD}": joint {joint.name!r} has two friction coefficients, and its friction energy is no '
            f'multiple of normal force times slip distance; take law = "{ENERGY}"'
        ]
    if scene.statics is not None and isinstance(joint.preload, float) and joint.preload > 0.0:
        return [
            f"{where} states preload = {joint.preload:g} with [statics]: the cause of the pressure, and its change with "
            'wear, are unknown; state preload = "static" and the loads, or no [statics]'
        ]
    return []
