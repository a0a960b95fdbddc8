"""The scene of a result file written back as a scene file that can be run."""

from __future__ import annotations

import hashlib
import os
import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..messages.errors import CaseError
from ..messages.words import is_deeply_nested
from ..system.files import atomic_write
from .origin import InputFile
from .record import ResultFile

SAME, CHANGED, GONE = "unchanged", "changed since", "missing"


def write_scene(results: ResultFile, folder: Path) -> Path:
    """Write NAME.toml and return it.  Local.

    Its first lines state the command of the run and the state of its input files; paths are relative to the new place.

    Raises
    ------
    CaseError : there is another file of this name, or it cannot be written
    ResourceError : the disk is full
    """
    path = folder / f"{Path(results.name).name}.toml"
    text = "\n".join([*(f"# {line}" for line in summary_of_run(results)), "", relocated(results, path.parent)])
    if path.exists() and path.read_bytes() != text.encode():
        raise CaseError(f"{path}: there is a file of this name already; choose another folder with --out")
    with atomic_write(str(path)) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        file.write(text)
    return path


def summary_of_run(results: ResultFile) -> list[str]:
    """Return lines on how results were computed, and whether the input files are unchanged.  Local."""
    origin = results.origin
    versions = ", ".join(f"{name} {version}" for name, version in results.versions.items())
    lines = [f"from {Path(results.path).name}; computed by {versions}"]
    if origin is not None:
        ranks = f"{origin.n_ranks} rank{'s' if origin.n_ranks > 1 else ''} in {origin.n_groups} groups"
        lines.append(f"{origin.started}, {ranks.removesuffix(' in 1 groups')}: {origin.command}")
        lines += [f"{entry.key}: {entry.size} bytes, SHA-256 {entry.sha256}, {state_of_input(entry)}" for entry in origin.inputs]
    if results.options:
        lines.append(f"PETSc options: -- {shlex.join(results.options)}")
    return [" ".join("".join(c if c.isprintable() else " " for c in line).split()) for line in lines]


def state_of_input(file: InputFile) -> str:
    """Return the state of a file since it was read: SAME, CHANGED or GONE.  Local."""
    try:
        if not os.path.isfile(file.path):  # a path of a file from anywhere: a pipe would not end
            return GONE
        if os.path.getsize(file.path) != file.size:
            return CHANGED
        with open(file.path, "rb") as content:
            return SAME if hashlib.file_digest(content, "sha256").hexdigest() == file.sha256 else CHANGED
    except (OSError, ValueError):
        return GONE


def relocated(results: ResultFile, folder: Path) -> str:
    """Return the scene's text with the paths of its files relative to another folder.  Local.

    Paths are replaced in the text, so that comments remain.  If the result does not parse to the same tables with new paths, the
    text is returned unchanged.
    """
    text, origin = results.scene_text, results.origin
    if origin is None:
        return text
    home = Path(origin.scene_path).parent
    known = {os.path.normpath(entry.path) for entry in origin.inputs}

    def moved(stated: str) -> str:
        """Return a path of the scene, or a matrix in a file, relative to the new folder; other texts unchanged."""
        for path, name in ((stated, ""), (stated.rpartition(":")[0], ":" + stated.rpartition(":")[2])):
            if path and not os.path.isabs(path) and os.path.normpath(home / path) in known:
                return os.path.relpath(home / path, folder.absolute()) + name
        return stated

    if is_deeply_nested(text):
        return text
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError):
        return text
    written = re.sub(r"""(=\s*)(["'])([^"'\n\\]+)\2""", lambda match: f"{match[1]}{match[2]}{moved(match[3])}{match[2]}", text)
    return written if _reads_as(written, _with_paths(tables, moved)) else text


def _with_paths(value: Any, moved: Callable[[str], str]) -> Any:
    """Return tables with each text mapped by ``moved``."""
    if isinstance(value, dict):
        return {key: _with_paths(entry, moved) for key, entry in value.items()}
    if isinstance(value, list):
        return [_with_paths(entry, moved) for entry in value]
    return moved(value) if isinstance(value, str) else value


def _reads_as(text: str, tables: dict[str, Any]) -> bool:
    try:
        return tomllib.loads(text) == tables
    except (ValueError, RecursionError):
        return False
