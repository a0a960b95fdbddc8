"""What the scene file knows and this version does not do: a line each, deleted when it comes."""

from __future__ import annotations

from .schema import Scene


def not_yet(scene: Scene) -> list[str]:
    """Return what of the scene this version cannot do, a text each.  Local."""
    found = [
        (
            scene.statics is not None and scene.model.mesh is None,
            "[statics]",
            "needs a mesh; pairs of matrices state their preload",
        )
    ]
    return [f"{where}: {what}" for applies, where, what in found if applies]
