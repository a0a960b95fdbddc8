"""Which files a model file includes, found without reading it as a model."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

_BLOCK, _LONGEST = 2**20, 2**13  # bytes: read at a time, and the longest keyword with its parameters
_DEEPEST = 100  # files within each other
_KEYWORD = rb"^[ \t]*\*(?!\*)(?:[^\n]*,[ \t]*\r?\n){0,20}"  # a comma at the end of its line continues it
_ABAQUS = re.compile(
    _KEYWORD + rb'[^\n]*?(?<=[,\n])[ \t]*INPUT[ \t]*=[ \t]*("[^"\n]*"|[^,\r\n]*)(?=[,\r\n])', re.IGNORECASE | re.MULTILINE
)
_NASTRAN = re.compile(rb"^[ \t]*INCLUDE[ \t]*([^\r\n$]*)(?=[\r\n$])", re.IGNORECASE | re.MULTILINE)
_OF_ENDING = {".inp": (b"INPUT", _ABAQUS), **dict.fromkeys((".bdf", ".nas", ".fem", ".dat"), (b"INCLUDE", _NASTRAN))}


def included_files(path: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the files that a model file includes, and those that these include, each once and in their order.  Local.

    What is not there, or outside of the file's folder, is left out: the readers refuse it, each in its words.  Of a file that is
    large only a block at a time is in memory.

    Raises
    ------
    OSError : a file cannot be read
    """
    path = Path(os.path.realpath(path))
    if path.suffix.lower() not in _OF_ENDING:
        return ()
    found: dict[Path, None] = {}
    _follow(path, path.parent, *_OF_ENDING[path.suffix.lower()], found)
    found.pop(path, None)
    return tuple(found)


def _follow(path: Path, folder: Path, word: bytes, pattern: re.Pattern[bytes], found: dict[Path, None], depth: int = 0) -> None:
    """Add what a file includes, in depth, unless it is known; the readers refuse what lies deeper than here."""
    for name in _names(path, word, pattern):
        beside = [Path(os.path.realpath(place / name)) for place in (path.parent, folder)]
        inner = next((one for one in beside if one.is_file() and one.is_relative_to(folder)), None)
        if inner is not None and inner not in found and depth < _DEEPEST:
            found[inner] = None
            _follow(inner, folder, word, pattern, found, depth + 1)


def _names(path: Path, word: bytes, pattern: re.Pattern[bytes]) -> Iterator[str]:
    """Yield the names of the files that a file includes, some maybe twice."""
    with open(path, "rb") as file:
        tail = b""
        while block := file.read(_BLOCK):
            text = tail + block + (b"" if len(block) == _BLOCK else b"\n")
            if word in text.upper():
                for match in pattern.finditer(text):
                    name = match[1].decode("utf-8", "replace").replace("\0", "").strip().strip("'\"").strip()
                    if name:
                        yield name
            tail = text[-_LONGEST:]
