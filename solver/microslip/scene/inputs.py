"""The files that a scene names."""

from __future__ import annotations

from ..tables.matrix_names import KEYS, split_name
from .schema import Scene


def named_files(scene: Scene) -> list[tuple[str, str]]:
    """Return where the scene names each of its files, for messages, and the path as stated, relative to its folder.  Local."""
    model = scene.model
    named = [(f"[model] {key}", getattr(model, key)) for key in ("mesh", "dofs", "nodes", "recovery_dofs")]
    given = [(key, getattr(model, key)) for key in KEYS if getattr(model, key) is not None]
    named += [(f"[model] {key}", split_name(file, scene.folder)[0]) for key, file in given]
    named += [
        (f'[[joints]] {i} ("{joint.name}") {key}', getattr(joint, key))
        for i, joint in enumerate(scene.joints, 1)
        for key in ("pairs", "node_pairs", "parameters")
    ]
    named += [(f"[[loads]] {i} forces", load.forces) for i, load in enumerate(scene.loads, 1)]
    if scene.statics is not None:
        warm = enumerate(scene.statics.temperatures, 1)
        named += [(f"[[statics.temperatures]] {i} file", one.file) for i, one in warm]
    return [(where, file) for where, file in named if file is not None]
