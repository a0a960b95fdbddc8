"""The files named by a scene, and whether its matrices may have the nodes of their rows."""

import os
from pathlib import Path

from ..messages.words import hint
from ..system.files import NO_FILE
from ..tables.matrix_names import KEYS, split_name
from ..tables.structure import Model
from .schema import Scene

SECTOR_TABLE = "[cyclic] table"  # key of the table with the differences of sectors
_WITH_NODES = (".sti", ".mas", ".pch", ".dmig", ".bdf", ".full", ".sub")


def named_files(scene: Scene) -> list[tuple[str, str]]:
    """Return the key of each file of the scene, for messages, and its path relative to the folder of the scene.  Local."""
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
    if scene.cyclic is not None:
        named.append((SECTOR_TABLE, scene.cyclic.table))
    if scene.statics is not None:
        temperatures = enumerate(scene.statics.temperatures, 1)
        named += [(f"[[statics.temperatures]] {i} file", temperature.file) for i, temperature in temperatures]
    return [(where, file) for where, file in named if file is not None]


def may_know_nodes(model: Model, folder: Path) -> bool:
    """Return whether the rows may have nodes and directions: stated, or from the format of a matrix.  Local."""
    if model.dofs is not None or model.recovery is not None:
        return True
    for key in ("stiffness", "mass"):
        stated = getattr(model, key)
        path = folder / split_name(stated, folder)[0] if stated is not None else Path()
        if path.suffix.lower() in _WITH_NODES or (path.suffix.lower() == ".mtx" and not _is_matrix_market(path)):
            return True
    return False


def _is_matrix_market(path: Path) -> bool:
    """Return whether a file begins as Matrix Market or is unreadable; otherwise it may be from Abaqus."""
    try:
        if not path.is_file():
            return True
        with open(path, "rb") as file:
            return file.read(2) in (b"%%", b"")
    except (OSError, ValueError):
        return True


def missing_files(scene: Scene) -> list[str]:
    """Return the missing files of the scene, one text each.  Local."""
    return [mistake for where, file in named_files(scene) if (mistake := _missing(where, file, scene.folder))]


def _missing(where: str, file: str, folder: Path) -> str | None:
    path = folder / file
    try:
        if path.is_file():
            return None
        fault = "that is a folder; a file is expected" if path.is_dir() else NO_FILE if path.exists() else None
    except (OSError, ValueError) as problem:  # a name too long, or with a null character
        fault = str(problem)
    return f'{where} = "{file}": {fault or absent(path)}'


def absent(path: Path) -> str:
    """Return the message for a missing file, with a similar name in its folder.  Local."""
    folder = path.parent
    if path.is_symlink():
        return f"that is a symbolic link to {os.readlink(path)}, where there is no file"
    if not folder.is_dir():
        return f"there is no folder {folder}"
    try:
        near = hint(path.name, [entry.name for entry in folder.iterdir()])
    except OSError:
        near = ""
    return f"there is no such file in {folder}{near}"
