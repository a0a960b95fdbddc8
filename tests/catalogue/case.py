"""An entry of the catalogue, and the ways in which a sound file is spoiled."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

Spoil = Callable[[Path], None]


@dataclass(frozen=True)
class Case:
    """A bad input: sound files, of which one is spoiled, a command line, and what must come of it."""

    name: str
    line: str  # the command line, its paths relative to the folder of the files
    words: tuple[str, ...]  # that the message must hold
    spoil: Spoil | None = None  # called with the folder; None: the command line is at fault
    status: int = 2
    not_by_root: bool = False  # whom no permission stops


def edited(file: str, *changes: str) -> Spoil:
    """Return what replaces in a file the first of each pair of texts by the second."""

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
    """Return what puts other content into a file."""

    def spoil(folder: Path) -> None:
        (folder / file).write_bytes(content.encode() if isinstance(content, str) else content)

    return spoil


def cut(file: str, share: float = 0.5) -> Spoil:
    """Return what leaves only the first part of a file."""
    return lambda folder: os.truncate(folder / file, int(share * (folder / file).stat().st_size))


def removed(file: str) -> Spoil:
    return lambda folder: (folder / file).unlink()


def made_a_folder(file: str) -> Spoil:
    def spoil(folder: Path) -> None:
        (folder / file).unlink(missing_ok=True)
        (folder / file).mkdir()

    return spoil


def made_a_loop(file: str) -> Spoil:
    """Return what makes a file a symbolic link to itself."""

    def spoil(folder: Path) -> None:
        (folder / file).unlink(missing_ok=True)
        (folder / file).symlink_to(file)

    return spoil


def forbidden(file: str) -> Spoil:
    return lambda folder: (folder / file).chmod(0)


def all_of(*spoils: Spoil) -> Spoil:
    def spoil(folder: Path) -> None:
        for one in spoils:
            one(folder)

    return spoil


NOISE = bytes(range(256)) * 40
