"""The commands of an archive in order, with their lines; a library reads the blocks of nodes, elements and components."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from ...messages.errors import MeshError

_BLOCKS = ("NBLOCK", "EBLOCK", "CMBLOCK")  # followed by lines of numbers of one width, without commas
_GEOMETRY = re.compile(rb"\A[^\n]{72}S +1\s*\n(?:[^\n]*\n)*?(?=:CDWRITE)")  # IGES, which CDWRITE,ALL writes before its data
_NO_NUMBER = re.compile(rb"[^\s0-9+\-.EeDd]")


@dataclass(frozen=True)
class Command:
    """A command and its fields, upper case but for names; ``fields[0]`` follows the first comma."""

    word: str
    fields: tuple[str, ...]
    line: int  # from 1; 0 for a file without lines
    block: tuple[str, ...] = ()  # lines of a block of types, without its format
    end: int = 0  # byte of the file at which the next line begins

    @property
    def is_archived(self) -> bool:
        """Whether CDWRITE has written it, blocked (R5.0) or unblocked (UNBL)."""
        return self.field(0).upper().startswith(("R5", "UNBL"))

    @property
    def where(self) -> str:
        """Its line, or its word in a file without lines, for messages."""
        return f"line {self.line}" if self.line else f"its {self.word}"

    def field(self, i: int) -> str:
        """Return field i; empty if missing."""
        return self.fields[i] if i < len(self.fields) else ""

    def number(self, i: int) -> float:
        """Return field i as a number, 0 if empty.  Raises MeshError: the field is not a number."""
        text = self.field(i)
        try:
            return float(text.upper().replace("D", "E")) if text else 0.0
        except ValueError:
            raise MeshError(f"{self.where}: {self.word}: {text!r} where a number is expected") from None


def commands(path: str) -> Iterator[Command]:
    """Yield the commands of an archive.  Local."""
    with open(path, "rb") as file:
        content = file.read()
    geometry = _GEOMETRY.match(content)
    if geometry:
        content = (
            b"\n" * geometry[0].count(b"\n") + b" " * (len(geometry[0]) - geometry[0].count(b"\n")) + content[geometry.end() :]
        )
    lines, block = _Lines(content), ""
    while (line := lines.next()) is not None:
        text = line.partition("!")[0].strip()
        if not text or text[0] == ":":  # a label
            continue
        if _is_data(text):
            if block and text[0] != "(" and _NO_NUMBER.search(text.encode()):
                raise MeshError(f"line {lines.number}: {block} holds {text[:60]!r} where numbers are expected")
            lines.skip_numbers()
            continue
        number = lines.number
        parts = [text] if text[0] in "/*" else text.split("$")  # titles and comments may contain a dollar sign
        for part in parts:
            word, *fields = (field.strip() for field in part.split(","))
            word = word.upper()
            if word == "DBLOCK":
                yield from _supports(lines)
            elif word:
                block = word if word in _BLOCKS else ""
                end = lines.at
                yield Command(word, tuple(fields), number, lines.block() if word == "ETBLOCK" else (), end)


def _supports(lines: _Lines) -> Iterator[Command]:
    """Yield the lines of a DBLOCK, in the format (i9,a6,2(pg16.9)), as D commands."""
    form = (lines.next() or "").strip().lower()
    if not form.startswith("(i9,a6,2(pg16"):
        raise MeshError(f"line {lines.number}: DBLOCK in the format {form[:40]!r}; (i9,a6,2(pg16.9)) is read")
    while (line := lines.next()) is not None and line.strip() != "-1" and line.strip():
        yield Command("D", (line[:9].strip(), line[9:15].strip(), line[15:31].strip()), lines.number)


def numbers_after(content: bytes, command: Command) -> bytes:
    """Return the lines of numbers of a block, after its format.  Local."""
    start = content.find(b"\n", command.end) + 1 or len(content)
    other = _NO_NUMBER.search(content, start)
    end = len(content) if other is None else content.rfind(b"\n", start, other.start()) + 1
    return content[start : max(end, start)].strip()


class _Lines:
    """Sequential reader of the lines of a text."""

    def __init__(self, content: bytes):
        self.content, self.at, self.number = content, 0, 0  # number of the last line taken, from 1

    def next(self) -> str | None:
        """Return the next line, None after the last."""
        if self.at >= len(self.content):
            return None
        end = self.content.find(b"\n", self.at)
        end = len(self.content) if end < 0 else end
        line, self.at = self.content[self.at : end], end + 1
        self.number += 1
        return line.decode("utf-8", errors="replace")

    def block(self) -> tuple[str, ...]:
        """Return the lines of numbers after a format, up to the final -1."""
        self.next()
        lines = []
        while (line := self.next()) is not None and line.strip()[:1].isdigit():
            lines.append(line)
        return tuple(lines)

    def skip_numbers(self) -> None:
        """Skip lines of numbers, nearly the whole file, in one step."""
        other = _NO_NUMBER.search(self.content, self.at)
        end = len(self.content) if other is None else self.content.rfind(b"\n", self.at, other.start()) + 1
        if end > self.at:  # otherwise the next line is not a line of numbers
            self.number += self.content.count(b"\n", self.at, end)
            self.at = end


def _is_data(text: str) -> bool:
    """Return whether a line belongs to a block: numbers, or the block's format."""
    return text[0] in "(-+.0123456789"


# words of archives that may be abbreviated: Ansys compares the first four letters
_ABBREVIATED = "ALLSEL CERIG CMSEL CYCLIC EALIVE EKILL ETCONTROL INISTATE KEYOPT MPDATA PSMESH RMODIF"
# blocks; further commands that select elements, set up a solution, print or write
_SET_UP = (
    "ANTYPE AUTOTS CMBLOCK CMDELE CNCHECK CNTR CNVTOL CEWRITE DELTIM DMPOPTION EBLOCK EQSLV ERESX ESLL ESLN FINISH FCUM HROPT "
    "KEYW MAGOPT MCHECK MODOPT MXPAND NBLOCK NLDIAG NLGEOM NLHIST NSLL NSUBST OUTGEOM OUTPR OUTRES RESCONTROL SELTOL SOLCONTROL "
    "SOLVE TIMINT TRNOPT XMLO *ASK *CFCLOSE *CFOPEN *LIST *MSG *VGET *VWRITE"
)
_IN_FULL = {word[:4]: word for word in _ABBREVIATED.split()}
_SKIPPED = {word[:4] for word in _SET_UP.split()}
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([ED][-+]?\d+)?\Z", re.IGNORECASE)
_ASSIGNED = re.compile(r"([A-Z_]\w*)\s*=\s*(\S+)\Z")


def as_archived(commands_read: Iterable[Command]) -> Iterator[Command]:
    """Yield commands with parameters (*SET, name = value) replaced by their numbers and words in full.  Local.

    Elements that are defined one by one become one command E.
    """
    known: dict[str, str] = {}
    has_elements = False
    for command in commands_read:
        fields = tuple(known.get(field.upper(), field) for field in command.fields)
        assigned = _ASSIGNED.match(command.word)
        if assigned or command.word == "*SET":
            name, value = assigned.groups() if assigned else (fields + ("", ""))[:2]
            _set_parameter(known, name.upper(), known.get(value.upper(), value))
        elif command.word in ("E", "EN", "EMORE"):
            if not has_elements:
                yield replace(command, word="E", fields=fields)
            has_elements = True
        elif command.word[:4] not in _SKIPPED:
            word = _IN_FULL.get(command.word[:4], command.word)
            yield replace(command, word=word, fields=fields)


def _set_parameter(known: dict[str, str], name: str, value: str) -> None:
    """Store the number of a parameter; remove the parameter if its new value is not a number."""
    known.pop(name, None)
    if _NUMBER.match(value):
        known[name] = value
