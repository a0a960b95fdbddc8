"""Nastran's OUTPUT4, .op4: text or binary, full columns or strings of them (BIGMAT or not).

pyNastran expands columns written from their first to their last entry to a full matrix: 3.2 GB from a file of 1.4 MB.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from .file_matrix import FileMatrix, Wanted, from_coordinates
from .fortran_records import Records
from .text import fixed_width, fortran_format

_WORDS = {1: 1, 2: 2, 3: 1, 4: 2}  # 32-bit words of a number, by its type code; complex numbers (3, 4) have two parts
_HEAD = 24  # bytes of the header of a binary matrix


@dataclass(frozen=True)
class _Head:
    """The header of a matrix."""

    n_columns: int
    n_rows: int
    is_big: bool  # BIGMAT: strings begin with two words
    form: int  # 6: symmetric
    kind: int  # key of _WORDS
    name: str
    per_line: int = 0  # numbers per line of text, and the width of each
    width: int = 0


def read_op4(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file, or the wanted one of several.  Local.  Raises CaseError, ResourceError: the file is faulty."""
    with open(wanted.path, "rb") as file:
        reader, positions = _reader(file, wanted), dict[str, int]()
        position = file.tell()
        while (head := reader.head()) is not None:
            positions.setdefault(head.name, position)
            for _ in reader.parts(head):
                pass
            position = file.tell()
        file.seek(positions[wanted.choose(list(positions))])
        head = reader.head()
        assert head is not None, "read before"
        _check_head(head, wanted)
        return _matrix(reader, head, wanted)


def _reader(file: IO[bytes], wanted: Wanted) -> _Binary | _Text:
    """Return the reader of a file by its first word: the length of a header, in either byte order, or text."""
    first = file.read(4)
    file.seek(0)
    for order in "<>":
        (n,) = struct.unpack(f"{order}i", first.ljust(4, b" "))
        if n == 2 * _HEAD:
            raise wanted.error("it has words of 64 bits; write it with words of 32, or as text (FORM=FORMATTED)")
        if n == _HEAD:
            return _Binary(file, order, wanted)
    return _Text(file, wanted)


def _check_head(head: _Head, wanted: Wanted) -> None:
    """Raise CaseError for complex numbers and for sizes that a file of this length cannot have."""
    if head.kind in (3, 4):
        raise wanted.error("it is complex; microslip takes real matrices")
    if head.kind not in _WORDS:
        raise wanted.error(f"its numbers are of the type {head.kind}; 1 and 2 are real")
    wanted.check_rows(max(head.n_columns, head.n_rows))
    if head.n_columns < 1 or head.n_rows == 0:
        raise wanted.error(f"it has {head.n_rows} rows and {head.n_columns} columns")


def _matrix(reader: _Binary | _Text, head: _Head, wanted: Wanted) -> FileMatrix:
    """Return the next matrix."""
    places, parts = [], [np.empty(0)]
    for column, row, part in reader.parts(head):
        for first, numbers in reader.strings(row, part, head):
            places.append((first - 1, column - 1, len(numbers)))
            parts.append(numbers)
    first, column, lengths = np.array(places, dtype=np.int64).reshape(-1, 3).T
    values = np.concatenate(parts)
    rows = np.repeat(first - np.cumsum(lengths) + lengths, lengths) + np.arange(len(values))
    columns = np.repeat(column, lengths)
    is_triangle = head.form == 6 and not ((rows > columns).any() and (rows < columns).any())
    matrix = from_coordinates(rows, columns, values, (head.n_rows, head.n_columns), wanted)
    matrix.eliminate_zeros()
    return FileMatrix(matrix, is_triangle=is_triangle)


def _string(words: list[int]) -> tuple[int, int]:
    """Return length in words and first row of a string, from its header of one word (two with BIGMAT)."""
    if len(words) == 2:
        return words[0] - 1, words[1]
    length = words[0] // 65536 - 1
    return length, words[0] - 65536 * (length + 1)


class _Binary:
    """A binary file: Fortran records, one per column."""

    def __init__(self, file: IO[bytes], order: str, wanted: Wanted) -> None:
        self.records, self.order, self.wanted = Records(file, order, wanted), order, wanted

    def head(self) -> _Head | None:
        """Return the head of the next matrix; None at the end of the file."""
        at = self.records.skip()
        if at is None:
            return None
        if at[1] != _HEAD:
            raise self.wanted.error("a matrix does not begin with a header")
        data = self.records.content(at)
        n_columns, n_rows, form, kind = struct.unpack(f"{self.order}4i", data[:16])
        return _Head(n_columns, abs(n_rows), n_rows < 0, form, kind, data[16:].decode("latin-1").strip())

    def parts(self, head: _Head) -> Iterator[tuple[int, int, Any]]:
        """Yield the columns: number, first row (0: strings), position of the record; skip the record after the last column."""
        while True:
            at = self.records.skip()
            if at is None or at[1] < 12:
                raise self.wanted.error(f"it is truncated in its matrix {head.name}")
            column, row, n_words = struct.unpack(f"{self.order}3i", self.records.content(at, 12))
            if column > head.n_columns:
                return
            if column < 1 or at[1] != 12 + 4 * n_words:
                raise self.wanted.error(f"column {column} does not have its stated {n_words} words")
            yield column, row, at

    def strings(self, row: int, at: tuple[int, int], head: _Head) -> Iterator[tuple[int, np.ndarray]]:
        """Yield first row and numbers of each string of a column."""
        number = np.dtype(f"{self.order}f{4 * _WORDS[head.kind]}")
        words = np.frombuffer(self.records.content(at), f"{self.order}i4", offset=12)
        if row > 0:
            yield row, np.frombuffer(words, number).astype(float)
            return
        start, n_head = 0, 1 + head.is_big
        while start < len(words):
            length, first = _string(words[start : start + n_head].tolist()) if start + n_head < len(words) else (0, 0)
            start += n_head
            if length < 1 or start + length > len(words):
                raise self.wanted.error("a string of a column is longer than the column")
            yield first, np.frombuffer(words[start : start + length].tobytes(), number).astype(float)
            start += length


class _Text:
    """A text file: integers in fields of eight, numbers in the format stated by the header."""

    def __init__(self, file: IO[bytes], wanted: Wanted) -> None:
        self.file, self.wanted = file, wanted

    def line(self) -> bytes:
        return self.file.readline(4096)

    def head(self) -> _Head | None:
        """Return the head of the next matrix; None at the end of the file."""
        line = self.line()
        while line and not line.strip():
            line = self.line()
        if not line:
            return None
        n_columns, n_rows, form, kind = self.integers(line[:32], 4, "the head of a matrix of OUTPUT4")
        layout = fortran_format(line[40:].decode("latin-1"))
        if layout is None:
            raise self.wanted.error(f"'{line[:60].decode('latin-1').strip()}' is not the head of a matrix of OUTPUT4")
        return _Head(n_columns, abs(n_rows), n_rows < 0, form, kind, line[32:40].decode("latin-1").strip(), *layout)

    def integers(self, line: bytes, n: int, what: str) -> list[int]:
        """Return the integers of a line, blank-separated or in fields of eight; CaseError if the line is not ``what``."""
        fields = line.split()
        if len(fields) != n:
            fields = [line[8 * i : 8 * i + 8].strip() for i in range(n)]
        if not all(field.lstrip(b"-").isdigit() for field in fields):
            raise self.wanted.error(
                f"'{line[:60].decode('latin-1').strip()}' is not {what}" if line.strip() else "it is truncated"
            )
        return [int(field) for field in fields]

    def parts(self, head: _Head) -> Iterator[tuple[int, int, Any]]:
        """Yield the strings: column, first row, number of values and their lines; skip the end of the columns."""
        column = 0
        while column <= head.n_columns:
            column, row, length = self.integers(self.line(), 3, "the head of a column")
            if row > 0:
                lines = self.lines(length, head)
                if column <= head.n_columns:
                    yield column, row, lines
            while row <= 0 < length:
                n, first = _string(self.integers(self.line(), 1 + head.is_big, "the head of a string"))
                length -= n + 1 + head.is_big
                if n < 1 or length < 0:
                    raise self.wanted.error("a string of a column is longer than the column")
                yield column, first, self.lines(n // _WORDS.get(head.kind, 1), head)

    def lines(self, n: int, head: _Head) -> tuple[int, list[bytes]]:
        """Return ``n`` and the next lines, which hold ``n`` numbers."""
        self.wanted.check_entries(n, 1.0)
        return n, [self.line() for _ in range(-(-n // head.per_line))]

    def strings(self, row: int, part: tuple[int, list[bytes]], head: _Head) -> Iterator[tuple[int, np.ndarray]]:
        """Yield first row and numbers of a string."""
        numbers = fixed_width(part[1], head.width, part[0])
        if numbers is None:
            raise self.wanted.error("it is truncated, or has a field that is not a number")
        yield row, numbers
