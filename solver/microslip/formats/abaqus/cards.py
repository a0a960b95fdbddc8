"""The cards of an input file and its included files: keyword, parameters, data lines."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ...messages.errors import MeshError
from ..includes import Includes, place
from ..numbers import numbers_of

_OTHER_INPUT = ("SUBMODEL", "MATRIXINPUT")  # keywords whose INPUT is not a text of cards and data
_BLANKS = bytes.maketrans(b",\t\r", b"   ")
_FORTRAN = bytes.maketrans(b"dD", b"ee")
_IS_SEPARATOR = np.isin(np.arange(256), list(b", \t\r\n"))


@dataclass(frozen=True)
class Piece:
    """Consecutive data lines of one file."""

    text: bytes
    file: str  # "" for the input file itself
    line: int  # number of its first line


@dataclass(frozen=True, eq=False)
class Card:
    """A keyword with its parameters and data lines."""

    keyword: str  # upper case, single blanks: "SOLID SECTION"
    parameters: dict[str, str]  # names in upper case without blanks, values as written
    file: str
    line: int
    pieces: list[Piece] = field(default_factory=list)

    @property
    def where(self) -> str:
        """File and line of the card, for messages."""
        return place(self.file, self.line)

    def parameter(self, name: str, default: str = "") -> str:
        """Return the value of a parameter in upper case."""
        return self.parameters.get(name, default).upper()

    def lines(self) -> Iterator[tuple[list[str], str]]:
        """Yield the fields and the place of every data line that is not empty."""
        for piece in self.pieces:
            for i, line in enumerate(piece.text.decode("utf-8", "replace").splitlines()):
                if line.strip():
                    yield [_bare(word) for word in line.split(",")], place(piece.file, piece.line + i)

    def numbers(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all numbers of the data lines, and the count in each line that is not empty; empty fields do not count.

        Raises
        ------
        MeshError : a word in place of a number
        """
        text = self.pieces[0].text if len(self.pieces) == 1 else b"\n".join(piece.text for piece in self.pieces)
        counts = _fields_per_line(text)
        values = values_of(text)
        if values is None:
            raise MeshError(self._no_numbers())
        return values, counts[counts > 0]

    def continues(self) -> np.ndarray:
        """Return which data lines that are not empty end in a comma, (n_lines,) bool."""
        lines = [line.rstrip() for piece in self.pieces for line in piece.text.split(b"\n")]
        return np.array([line.endswith(b",") for line in lines if line.strip(b", \t")], dtype=bool)

    def _no_numbers(self) -> str:
        for words, where in self.lines():
            if values_of(",".join(words).encode()) is None:
                return f"{where}: *{self.keyword} holds {','.join(words)[:60]!r} where numbers are expected"
        return f"{self.where}: *{self.keyword} holds entries that are not numbers"


def read_cards(path: str) -> list[Card]:
    """Return the cards of an input file and its included files in order.  Local.

    Raises
    ------
    MeshError without the file's name : not an input file; included files that are missing, outside its folder or cyclic
    """
    reader = _Reader(path)
    reader.read(reader.includes.path, ())
    return reader.cards


class _Reader:
    """Collects the cards of several files in order."""

    def __init__(self, path: str):
        self.includes = Includes(path)
        self.cards: list[Card] = []

    def read(self, path: str, within: tuple[str, ...]) -> None:
        """Add the cards of one file; data lines before its first keyword belong to the card before."""
        text, label = self.includes.read(path), self.includes.label(path)
        at, line = 0, 1
        for start, end in _star_lines(text):
            if start < at:
                continue  # a continuation of a keyword line
            self._take_data(text[at:start], label, line)
            line += text.count(b"\n", at, start)
            at = end
            if not text[start:end].lstrip().startswith(b"**"):
                at = _continued(text, start, end)
                self._take_card(_card(text[start:at], label, line), (*within, path))
            line += text.count(b"\n", start, at)
        self._take_data(text[at:], label, line)

    def _take_card(self, card: Card, within: tuple[str, ...]) -> None:
        if card.keyword != "INCLUDE":
            self.cards.append(card)
        if "INPUT" in card.parameters and "".join(card.keyword.split()) not in _OTHER_INPUT:
            name = card.parameters["INPUT"]
            if "PASSWORD" in card.parameters:
                raise MeshError(f"{card.where}: {name!r} is encrypted and cannot be read here")
            self.read(self.includes.find(name, within, card.where), within)
        elif card.keyword == "INCLUDE":
            raise MeshError(f"{card.where}: *INCLUDE names no file: INPUT = is missing")

    def _take_data(self, text: bytes, label: str, line: int) -> None:
        """Take data lines; lines before the first keyword are a title."""
        if self.cards and text.strip():
            self.cards[-1].pieces.append(Piece(text, label, line))


def _star_lines(text: bytes) -> Iterator[tuple[int, int]]:
    """Yield begin and end (after the line feed) of every line that begins with a star, after optional blanks."""
    at = 0
    while (star := text.find(b"*", at)) >= 0:
        feed = text.rfind(b"\n", at, star)
        begin = at if feed < 0 else feed + 1
        end = text.find(b"\n", star) + 1 or len(text)
        if not text[begin:star].strip():
            yield begin, end
        at = end


def _continued(text: bytes, start: int, end: int) -> int:
    """Return the end of a keyword line with its continuation lines; each line before the last ends in a comma."""
    while end < len(text) and text[start:end].rstrip().endswith(b","):
        following = text.find(b"\n", end) + 1 or len(text)
        if text[end:following].lstrip().startswith(b"*") or b"=" not in text[end:following]:
            break  # a trailing comma without continuation
        end = following
    return end


def _card(text: bytes, label: str, line: int) -> Card:
    content = text.decode("utf-8", "replace").strip()[1:].replace("\n", " ")
    words = _outside_of_quotes(content) if '"' in content else content.split(",")
    pairs = (word.partition("=") for word in words[1:] if word.strip())
    parameters = {"".join(key.upper().split()): _bare(value) for key, _, value in pairs}
    return Card(" ".join(words[0].upper().split()), parameters, label, line)


def _outside_of_quotes(line: str) -> list[str]:
    """Return the fields of a line between commas outside quotes."""
    parts = line.split('"')
    for i in range(len(parts) - 1, -1, -2):
        parts[i] = parts[i].replace(",", "\n")
    return '"'.join(parts).split("\n")


def number(word: str) -> float | None:
    """Return a word as a finite number; None for other words."""
    values = values_of(word.encode())
    return float(values[0]) if values is not None and len(values) == 1 and np.isfinite(values[0]) else None


def _bare(word: str) -> str:
    return word.replace('"', "").strip().strip("'").strip()


def _fields_per_line(text: bytes) -> np.ndarray:
    """Return the number of words on each line, (n_lines,)."""
    if not text:
        return np.zeros(0, dtype=np.int64)
    is_separator = _IS_SEPARATOR[np.frombuffer(text, dtype=np.uint8)]
    begins = ~is_separator
    begins[1:] &= is_separator[:-1]
    del is_separator
    feeds = np.flatnonzero(np.frombuffer(text, dtype=np.uint8) == 10) + 1
    first = np.concatenate([[0], feeds[feeds < len(text)]])
    return np.add.reduceat(begins.view(np.uint8), first, dtype=np.int64)


def values_of(text: bytes) -> np.ndarray | None:
    """Return the numbers of a text; None if the text contains anything else."""
    plain = text.translate(_BLANKS)
    values = numbers_of(plain)
    return numbers_of(plain.translate(_FORTRAN)) if values is None else values
