"""Files that a model file includes: a list of them without reading the model, and their order while it is read."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from ..messages.errors import MeshError

_BLOCK, _LONGEST = 2**20, 2**13  # bytes: per read; longest keyword with its parameters
_DEEPEST, _MOST_FILES = 50, 10_000  # depth of nested includes; number of files in all
_REPEATED, _OF_ANY = 8, 2**24  # total bytes read: times the total size, and bytes always allowed
_KEYWORD = rb"^[ \t]*\*(?!\*)(?:[^\n]*,[ \t]*\r?\n){0,20}"  # a comma at the end of a line continues the keyword
_ABAQUS = re.compile(
    _KEYWORD + rb'[^\n]*?(?<=[,\n])[ \t]*INPUT[ \t]*=[ \t]*("[^"\n]*"|[^,\r\n]*)(?=[,\r\n])', re.IGNORECASE | re.MULTILINE
)
_NASTRAN = re.compile(rb"^[ \t]*INCLUDE[ \t]*([^\r\n$]*)(?=[\r\n$])", re.IGNORECASE | re.MULTILINE)
_OF_ENDING = {".inp": (b"INPUT", _ABAQUS), **dict.fromkeys((".bdf", ".nas", ".fem", ".dat"), (b"INCLUDE", _NASTRAN))}


def place(file: str, line: int) -> str:
    """Return "line 12" or "bolts.inc, line 3"."""
    return f"{file}, line {line}" if file else f"line {line}"


class Includes:
    """The files of one model while they are read: all inside its folder, no cycles, a bounded number.  Local."""

    def __init__(self, path: str):
        self.path = os.path.realpath(path)
        self.folder = os.path.dirname(self.path)
        self.sizes: dict[str, int] = {}  # bytes of each file
        self.n_files = self.n_bytes = 0  # read so far

    def label(self, path: str) -> str:
        """Return the name of a file in messages: its path in the folder, "" for the model file itself."""
        return "" if path == self.path else os.path.relpath(path, self.folder)

    def read(self, path: str) -> bytes:
        """Return the content of a file.  Raises MeshError: files are included too often."""
        with open(path, "rb") as file:
            content = file.read()
        self.sizes[path] = len(content)
        self.n_files, self.n_bytes = self.n_files + 1, self.n_bytes + len(content)
        if self.n_files > _MOST_FILES or self.n_bytes > max(_OF_ANY, _REPEATED * sum(self.sizes.values())):
            what = f"{self.label(path)}: files are included again and again"
            raise MeshError(f"{what}, {self.n_files} files and {self.n_bytes} bytes in all")
        return content

    def find(self, name: str, within: tuple[str, ...], where: str) -> str:
        """Return the path of a file that the last file of ``within`` includes; ``where`` names the place in messages.

        Raises
        ------
        MeshError : the file does not exist, is outside the folder, is one of ``within``, or is nested too deeply
        """
        relative = os.path.realpath(os.path.join(os.path.dirname(within[-1]), name))
        path = relative if os.path.exists(relative) else os.path.realpath(os.path.join(self.folder, name))
        cause = ""
        if os.path.commonpath([path, self.folder]) != self.folder:
            cause = f"which lies outside of {self.folder}; copy it into the folder of the input file"
        elif not os.path.isfile(path):
            cause = "and there is no such file"
        elif path in within:
            cause = "which includes this file: the includes form a cycle"
        elif len(within) > _DEEPEST:
            cause = f"and more than {_DEEPEST} files are included within each other"
        if cause:
            raise MeshError(f"{where}: it includes {name!r}, {cause}")
        return path


def included_files(path: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the files that a model file includes, directly or through others, each once and in order.  Local.

    Missing files and files outside the folder are left out; the readers refuse them.  Files are scanned block by block.

    Raises
    ------
    OSError : a file cannot be read
    """
    path = Path(os.path.realpath(path))
    if path.suffix.lower() not in _OF_ENDING:
        return ()
    included: dict[Path, None] = {}
    _follow(path, path.parent, *_OF_ENDING[path.suffix.lower()], included)
    included.pop(path, None)
    return tuple(included)


def _follow(
    path: Path, folder: Path, word: bytes, pattern: re.Pattern[bytes], included: dict[Path, None], depth: int = 0
) -> None:
    """Add the files that a file includes, recursively and each once; the readers refuse deeper nesting."""
    for name in _names(path, word, pattern):
        tried = [Path(os.path.realpath(place / name)) for place in (path.parent, folder)]
        inner = next((place for place in tried if place.is_file() and place.is_relative_to(folder)), None)
        if inner is not None and inner not in included and depth < 2 * _DEEPEST:
            included[inner] = None
            _follow(inner, folder, word, pattern, included, depth + 1)


def _names(path: Path, word: bytes, pattern: re.Pattern[bytes]) -> Iterator[str]:
    """Yield the names of the files that a file includes, possibly with repetitions."""
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
