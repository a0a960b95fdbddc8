"""The files that a run reads, and their fingerprints."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from ..formats.includes import included_files
from ..messages.errors import CaseError
from ..results.origin import InputFile
from ..scene.inputs import named_files
from ..scene.schema import Scene


def input_files(scene: Scene) -> tuple[tuple[str, Path], ...]:
    """Return the key that names each file of a scene, and its absolute path.  Local, rank 0.

    The scene file is not included: its text counts (``Scene.text``).

    Raises
    ------
    CaseError : a file cannot be read
    """
    files: list[tuple[str, Path]] = []
    for key, stated in named_files(scene):
        path = scene.folder / stated
        files.append((key, path))
        try:
            files += [(f"included by {path.name}", inner) for inner in included_files(path)]
        except OSError as problem:
            raise CaseError(f"{path}: {problem.strerror}") from None
        rows = path.with_suffix(".dof")  # CalculiX writes the nodes of its matrices there
        if path.suffix.lower() in (".sti", ".mas") and rows.is_file():
            files.append((f"beside {path.name}", rows))
    return tuple(files)


def fingerprint(files: Iterable[tuple[str, Path]]) -> tuple[InputFile, ...]:
    """Return size and SHA-256 hash of files, each read once, a block at a time.  Local, rank 0.

    Raises
    ------
    CaseError : a file cannot be read
    """
    known: dict[Path, tuple[int, str]] = {}
    hashed = []
    for key, path in files:
        if path not in known:
            known[path] = _size_and_hash(path)
        hashed.append(InputFile(key, str(path), *known[path]))
    return tuple(hashed)


def _size_and_hash(path: Path) -> tuple[int, str]:
    try:
        with open(path, "rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            return file.tell(), digest
    except OSError as problem:
        raise CaseError(f"{path}: {problem.strerror}") from None
