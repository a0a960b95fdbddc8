"""Checks of a disc that is computed from one sector."""

import math
from collections.abc import Sequence

from ...messages.words import hint, listed
from ...tables.cyclic import Cyclic
from ...tables.table import any_of
from ..schema import Scene
from .structure import numbered

OF_DISCS = ("receptance", "adaptive", "adaptive-energy")  # methods with the basis of the stuck structure


def of_disc(scene: Scene) -> list[str]:
    """Return mistakes: tables and keys that a disc computed from one sector cannot have."""
    cyclic, mistakes = scene.cyclic, []
    if cyclic is None:
        return [
            f"{where} next_sector: there is no table [cyclic], which states the position of the next sector"
            for where, joint in numbered(scene, "joints")
            if joint.next_sector
        ]
    if scene.is_static:
        mistakes.append("[cyclic]: [solver] harmonics = 0 is a static equilibrium without waves; state at least 1")
    if scene.statics is not None and scene.statics.rotation_speed > 0.0 and scene.model.axis is not None:
        mistakes += _other_axis(cyclic, scene.model.axis, scene.model.axis_point)
    if scene.solver.method not in OF_DISCS:
        mistakes.append(
            f'[solver] method = "{scene.solver.method}": with [cyclic] each nodal diameter has its own complex matrices, '
            f"which this method does not support; take {any_of(OF_DISCS)}"
        )
    for where, load in numbered(scene, "loads"):
        if load.base_acceleration is not None:
            mistakes.append(
                f"{where} base_acceleration: a moving base is not a wave of the sectors of [cyclic]; state forces or a pressure"
            )
    if cyclic.faces is None and not any(joint.next_sector for joint in scene.joints):
        mistakes.append(
            f"[cyclic] faces is missing: expected {type(cyclic).model_fields['faces'].description}, and no joint has next_sector"
        )
    mistakes += _whole_disc(scene) if cyclic.whole else []
    loaded = {min(d := cyclic.diameter(load.harmonic), cyclic.sectors - d) for load in scene.loads}
    if len(loaded) > 1 and scene.solver.modes is None:
        mistakes.append(
            f"[solver] modes is missing: the loads excite the nodal diameters {listed(map(str, sorted(loaded)))} of [cyclic], "
            "but accuracy chooses the modes of only one; state a number"
        )
    return mistakes


def _other_axis(cyclic: Cyclic, axis: Sequence[float], point: Sequence[float]) -> list[str]:
    """Return a mistake where an axis of rotation is another line than the axis of a disc."""
    x, y, z = (component / math.hypot(*cyclic.axis) for component in cyclic.axis)

    def across(v: Sequence[float]) -> float:
        return math.hypot(y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0])

    offset = [a - b for a, b in zip(point, cyclic.axis_point)]
    if across(axis) <= 1e-6 * math.hypot(*axis) and across(offset) <= 1e-6 * max(1.0, math.hypot(*cyclic.axis_point)):
        return []
    return ["[model] axis: a disc turns about the axis of [cyclic], and this is another line; leave axis and axis_point out"]


def _whole_disc(scene: Scene) -> list[str]:
    """Return mistakes: keys that a disc with the pairs of all sectors cannot have."""
    cyclic, damping, mistakes = scene.cyclic, scene.damping, []
    unknown = [name for name in cyclic.blades or () if name not in scene.bodies and not scene.awaits_file]
    if unknown:
        mistakes.append(f"[cyclic] blades: there is no body {unknown[0]!r}{hint(unknown[0], scene.bodies)}")
    if scene.solver.method != "receptance":
        mistakes.append(f'[solver] method = "{scene.solver.method}": with [cyclic] whole = true take "receptance"')
    if damping is not None and (damping.ratios or damping.modes or damping.structural):
        key = next(key for key in ("ratios", "modes", "structural") if getattr(damping, key))
        mistakes.append(
            f"[damping] {key}: with [cyclic] whole = true the modes of all nodal diameters are those of one disc; state ratio, "
            "or rayleigh"
        )
    names = [output.name for output in scene.outputs]
    of_sectors = {f"{name} {sector}" for name in names for sector in range(cyclic.sectors)}
    mistakes += [
        f"[[outputs]] name = {name!r}: with [cyclic] whole = true an output of that name belongs to a sector: outputs have its "
        "number after their name; state another one"
        for name in names
        if name in of_sectors
    ]
    if scene.solver.modes is None and any(load.harmonic != 1 for load in scene.loads):
        mistakes.append(
            "[solver] modes is missing: with [cyclic] whole = true accuracy chooses modes only for loads in "
            "harmonic 1; state a number of modes per nodal diameter"
        )
    return mistakes
