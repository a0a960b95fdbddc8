"""Files that a scene names and that are not there."""

import os
from pathlib import Path

from ...messages.words import hint
from ...system.files import NO_FILE
from ..inputs import named_files
from ..schema import Scene


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
