"""What the scene file knows and this version does not do: a line each, deleted when it comes."""

from __future__ import annotations

from .schema import Scene

SUPPORTED = ("adaptive", "adaptive-energy", "receptance")     # names of the registry in reduction/
_METHOD = f"this version has no such method yet; it has {', '.join(SUPPORTED)}"
_MATRICES = "this version does not read scenes given as matrices yet; give [model] mesh"
_STATICS = "this version has no static solution yet; give each joint its preload in Pa, and leave out [statics] and axis"


def not_yet(scene: Scene) -> list[str]:
    """Return what of the scene this version cannot do, a text each.  Local."""
    found = [
        (scene.model.stiffness is not None, "[model] stiffness", _MATRICES),
        (scene.model.axis is not None, "[model] axis", _STATICS),
        (scene.statics is not None, "[statics]", _STATICS),
        (scene.solver.harmonics == 0, "[solver] harmonics = 0", "this version needs at least harmonic 1"),
        (scene.solver.method not in SUPPORTED, f'[solver] method = "{scene.solver.method}"', _METHOD),
    ]
    for number, joint in enumerate(scene.joints, 1):
        where = f'[[joints]] {number} ("{joint.name}")'
        found.append((joint.pairs is not None, f"{where} pairs", _MATRICES))
        found.append((joint.preload == "static", f'{where} preload = "static"', _STATICS))
    for number, entry in enumerate(scene.loads, 1):
        found.append((entry.dof is not None, f"[[loads]] {number} dof", _MATRICES))
    for number, output in enumerate(scene.outputs, 1):
        found.append((output.dof is not None, f"[[outputs]] {number} dof", _MATRICES))
    return [f"{where}: {what}" for applies, where, what in found if applies]

