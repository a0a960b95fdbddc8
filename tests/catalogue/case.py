"""An entry of the catalogue, and functions that spoil a sound file."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

Spoil = Callable[[Path], None]


@dataclass(frozen=True)
class Case:
    """A bad input: sound files, of which one is spoiled, a command line, and the expected outcome."""

    name: str
    line: str  # the command line, its paths relative to the folder of the files
    words: tuple[str, ...]  # which the message must contain
    spoil: Spoil | None = None  # called with the folder; None: the command line is at fault
    status: int = 2
    not_by_root: bool = False  # True: permissions are at fault, which do not apply to root


def edited(file: str, *changes: str) -> Spoil:
    """Return a function that replaces in a file the first of each pair of texts by the second."""

    def spoil(folder: Path) -> None:
        text = (folder / file).read_text()
        for old, new in zip(changes[::2], changes[1::2], strict=True):
            assert old in text, f"{file} holds no {old!r}"
            text = text.replace(old, new, 1)
        (folder / file).write_text(text)

    return spoil


def appended(file: str, text: str) -> Spoil:
    def spoil(folder: Path) -> None:
        with open(folder / file, "a") as handle:
            handle.write(text)

    return spoil


def written(file: str, content: str | bytes) -> Spoil:
    """Return a function that replaces the content of a file."""

    def spoil(folder: Path) -> None:
        (folder / file).write_bytes(content.encode() if isinstance(content, str) else content)

    return spoil


def cut(file: str, share: float = 0.5) -> Spoil:
    """Return a function that truncates a file."""
    return lambda folder: os.truncate(folder / file, int(share * (folder / file).stat().st_size))


def removed(file: str) -> Spoil:
    return lambda folder: (folder / file).unlink()


def made_a_folder(file: str) -> Spoil:
    def spoil(folder: Path) -> None:
        (folder / file).unlink(missing_ok=True)
        (folder / file).mkdir()

    return spoil


def made_a_loop(file: str) -> Spoil:
    """Return a function that makes a file a symbolic link to itself."""

    def spoil(folder: Path) -> None:
        (folder / file).unlink(missing_ok=True)
        (folder / file).symlink_to(file)

    return spoil


def forbidden(file: str) -> Spoil:
    return lambda folder: (folder / file).chmod(0)


def all_of(*spoils: Spoil) -> Spoil:
    def spoil(folder: Path) -> None:
        for each in spoils:
            each(folder)

    return spoil


NOISE = bytes(range(256)) * 40
