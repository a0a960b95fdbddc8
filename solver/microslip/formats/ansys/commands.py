"""The commands of an archive, one by one with their lines; the blocks of nodes, elements and components are left to a library."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ...parallel.errors import MeshError

_BLOCKS = ("NBLOCK", "EBLOCK", "CMBLOCK", "RLBLOCK", "BFBLOCK", "SFEBLOCK", "SFLBLOCK", "BFEBLOCK", "SECBLOCK")


@dataclass(frozen=True)
class Command:
    """A command and its fields, upper case but for names; ``fields[0]`` follows the first comma."""

    word: str
    fields: tuple[str, ...]
    line: int  # from 1
    block: tuple[str, ...] = ()  # lines of a block that the library does not read, without its format

    @property
    def where(self) -> str:
        return f"line {self.line}"

    def field(self, i: int) -> str:
        """Return field i, empty where there is none."""
        return self.fields[i] if i < len(self.fields) else ""

    def number(self, i: int) -> float:
        """Return field i as a number, 0 where it is empty.

        Raises
        ------
        MeshError : it is no number
        """
        text = self.field(i)
        try:
            return float(text.upper().replace("D", "E")) if text else 0.0
        except ValueError:
            raise MeshError(f"{self.where}: {self.word}: {text!r} where a number is due") from None


def commands(path: str) -> Iterator[Command]:
    """Yield the commands of an archive.  Local."""
    with open(path, encoding="utf-8", errors="replace") as file:
        lines = enumerate(file, 1)
        for number, line in lines:
            text = line.partition("!")[0].strip()
            if not text or _is_data(text):
                continue
            for part in text.split("$"):
                word, *fields = (field.strip() for field in part.split(","))
                word = word.upper()
                if word in _BLOCKS:
                    yield Command(word, tuple(fields), number, _block(word, lines))
                elif word:
                    yield Command(word, tuple(fields), number)


def _is_data(text: str) -> bool:
    """Return whether a line belongs to a block: numbers, or the block's format."""
    return text[0] in "(-+.0123456789"


def _block(word: str, lines: Iterator[tuple[int, str]]) -> tuple[str, ...]:
    """Return the lines of a block of real constants after its format; those of the others are skipped as data."""
    if word != "RLBLOCK":
        return ()
    next(lines, None)
    found = []
    for _, line in lines:
        if not line.strip() or not line.strip()[0].isdigit():
            break
        found.append(line.rstrip("\n"))
    return tuple(found)
