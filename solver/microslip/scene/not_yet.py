"""What the scene file knows and this version does not do: a line each, deleted when it comes."""

from __future__ import annotations

from .schema import Scene

_STATICS = "this version has no static solution yet; give each joint its preload in Pa, and leave out [statics] and axis"


def not_yet(scene: Scene) -> list[str]:
    """Return what of the scene this version cannot do, a text each.  Local."""
    found = [(scene.model.axis is not None, "[model] axis", _STATICS), (scene.statics is not None, "[statics]", _STATICS)]
    for number, joint in enumerate(scene.joints, 1):
        found.append((joint.preload == "static", f'[[joints]] {number} ("{joint.name}") preload = "static"', _STATICS))
    return [f"{where}: {what}" for applies, where, what in found if applies]
