"""Nastran's OUTPUT4, .op4: text or binary, full columns or strings of them (BIGMAT or not)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import IO

import numpy as np

from .file_matrix import FileMatrix, Wanted, from_coordinates
from .text import fixed_width, fortran_format

_WORDS = {1: 1, 2: 2, 3: 1, 4: 2}  # 32-bit words of a real number, by the code of its type; 3 and 4 are complex: two of them
_HEAD = 24  # bytes of the head of a binary matrix


def read_op4(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file, or of several the one that is wanted.  Local.

    Raises
    ------
    CaseError, ResourceError : the file is at fault
    """
    with open(wanted.path, "rb") as file:
        head = file.read(8)
        order = next((order for order in "<>" if head and struct.unpack(f"{order}i", head[:4].ljust(4))[0] == _HEAD), None)
        if struct.pack("<i", 48) == head[:4] or struct.pack(">i", 48) == head[:4]:
            raise wanted.error("it has words of 64 bits; write it with words of 32, or as text (FORM=FORMATTED)")
        file.seek(0)
        reader = _Text(file, wanted) if order is None else _Binary(file, order, wanted)
        names: dict[str, int] = {}
        for name, position in reader.matrices():
            names.setdefault(name, position)
        position = names[wanted.choose(list(names))]
        return reader.read(position)


class _Parts:
    """Entries of a matrix, collected string by string."""

    def __init__(self) -> None:
        self.rows: list[int] = []
        self.columns: list[int] = []
        self.values: list[np.ndarray] = []

    def add(self, column: int, row: int, values: np.ndarray) -> None:
        self.columns.append(column)
        self.rows.append(row)
        self.values.append(values)

    def matrix(self, n_rows: int, n_columns: int, form: int, wanted: Wanted) -> FileMatrix:
        lengths = np.array([len(values) for values in self.values], dtype=np.int64)
        values = np.concatenate([np.empty(0), *self.values])
        within = np.arange(len(values)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        rows = np.repeat(np.array(self.rows, dtype=np.int64), lengths) - 1 + within
        columns = np.repeat(np.array(self.columns, dtype=np.int64), lengths) - 1
        is_triangle = form == 6 and not ((rows > columns).any() and (rows < columns).any())
        matrix = from_coordinates(rows, columns, values, (n_rows, n_columns), wanted)
        matrix.eliminate_zeros()
        return FileMatrix(matrix, is_triangle=is_triangle)


def _check_head(n_columns: int, n_rows: int, kind: int, wanted: Wanted) -> None:
    """Raise CaseError for complex numbers and for sizes that no file of this length has."""
    if kind in (3, 4):
        raise wanted.error("it is complex; microslip takes real matrices")
    if kind not in _WORDS:
        raise wanted.error(f"its numbers are of the type {kind}; 1 and 2 are real")
    wanted.check_rows(max(n_columns, abs(n_rows)))
    if n_columns < 1 or n_rows == 0:
        raise wanted.error(f"it has {abs(n_rows)} rows and {n_columns} columns")


def _strings(words: np.ndarray, is_big: bool, wanted: Wanted) -> Iterator[tuple[int, int, int]]:
    """Return first row, position and length in words of each string of a column."""
    at = 0
    while at < len(words):
        length, row = (int(words[at]) - 1, int(words[at + 1])) if is_big and at + 1 < len(words) else _packed(int(words[at]))
        at += 2 if is_big else 1
        if length < 1 or at + length > len(words):
            raise wanted.error("a string of a column is longer than the column")
        yield row, at, length
        at += length


def _packed(word: int) -> tuple[int, int]:
    """Return length in words and first row of a string whose head is one word."""
    length = word // 65536 - 1
    return length, word - 65536 * (length + 1)


class _Binary:
    """A binary file: records of Fortran, one a column."""

    def __init__(self, file: IO[bytes], order: str, wanted: Wanted) -> None:
        self.file, self.order, self.wanted = file, order, wanted
        self.word, self.number = np.dtype(f"{order}i4"), {1: np.dtype(f"{order}f4"), 2: np.dtype(f"{order}f8")}

    def record(self, reads: bool = True) -> bytes:
        """Return the next record, or its first 12 bytes; none at the end of the file."""
        mark = self.file.read(4)
        if not mark:
            return b""
        (n,) = struct.unpack(f"{self.order}i", mark.ljust(4, b"\0"))
        start = self.file.tell()
        if len(mark) < 4 or n < 12 or start + n + 4 > self.wanted.size:
            raise self.wanted.error(f"it is truncated: a record of {n} bytes begins at byte {start}")
        data = self.file.read(n if reads else 12)
        self.file.seek(start + n)
        if self.file.read(4) != mark:
            raise self.wanted.error(f"the record at byte {start} does not end where it says")
        return data

    def head(self) -> tuple[int, int, int, int, str] | None:
        """Return columns, rows, form, type and name; None at the end of the file."""
        data = self.record()
        if not data:
            return None
        if len(data) != _HEAD:
            raise self.wanted.error("a matrix begins with something else than a head")
        n_columns, n_rows, form, kind = struct.unpack(f"{self.order}4i", data[:16])
        return n_columns, n_rows, form, kind, data[16:].decode("latin-1").strip()

    def matrices(self) -> Iterator[tuple[str, int]]:
        """Return name and position of each matrix."""
        position = self.file.tell()
        while (head := self.head()) is not None:
            yield head[4], position
            column = 0
            while column <= head[0]:
                data = self.record(reads=False)
                if not data:
                    raise self.wanted.error(f"it is truncated in its matrix {head[4]}")
                (column,) = struct.unpack(f"{self.order}i", data[:4])
            position = self.file.tell()

    def read(self, position: int) -> FileMatrix:
        self.file.seek(position)
        n_columns, n_rows, form, kind, _ = self.head()  # type: ignore[misc]
        _check_head(n_columns, n_rows, kind, self.wanted)
        parts = _Parts()
        while True:
            data = self.record()
            column, row, n_words = struct.unpack(f"{self.order}3i", data[:12])
            if column > n_columns:
                return parts.matrix(abs(n_rows), n_columns, form, self.wanted)
            if len(data) != 12 + 4 * n_words or column < 1:
                raise self.wanted.error(f"column {column} does not have the {n_words} words that it says")
            if row > 0:
                parts.add(column, row, np.frombuffer(data, self.number[kind], offset=12).astype(float))
                continue
            words = np.frombuffer(data, self.word, offset=12)
            for row, at, length in _strings(words, n_rows < 0, self.wanted):
                values = np.frombuffer(words[at : at + length].tobytes(), self.number[kind])
                parts.add(column, row, values.astype(float))


class _Text:
    """A text file: integers in fields of eight, numbers in the format that the head states."""

    def __init__(self, file: IO[bytes], wanted: Wanted) -> None:
        self.file, self.wanted = file, wanted

    def line(self) -> bytes:
        return self.file.readline(4096)

    def head(self) -> tuple[int, int, int, int, str, tuple[int, int]] | None:
        """Return columns, rows, form, type, name and format; None at the end of the file."""
        line = self.line()
        while line and not line.strip():
            line = self.line()
        if not line:
            return None
        numbers = _integers(line[:32], 4)
        form = fortran_format(line[40:].decode("latin-1"))
        if numbers is None or form is None:
            raise self.wanted.error(f"'{line[:60].decode('latin-1').strip()}' is not the head of a matrix of OUTPUT4")
        return (*numbers, line[32:40].decode("latin-1").strip(), form)  # type: ignore[return-value]

    def column(self, kind: int, form: tuple[int, int]) -> tuple[int, int, int]:
        """Return number, first row and length of the next column."""
        line = self.line()
        found = _integers(line, 3)
        if found is None:
            raise self.wanted.error(
                f"'{line[:60].decode('latin-1').strip()}' is not the head of a column" if line else "it is truncated"
            )
        return found  # type: ignore[return-value]

    def matrices(self) -> Iterator[tuple[str, int]]:
        """Return name and position of each matrix."""
        position = self.file.tell()
        while (head := self.head()) is not None:
            n_columns, n_rows, _, kind, name, form = head
            yield name, position
            column = 0
            while column <= n_columns:
                column, row, length = self.column(kind, form)
                self.skip(row, length, n_rows < 0, kind, form)
            position = self.file.tell()

    def skip(self, row: int, length: int, is_big: bool, kind: int, form: tuple[int, int]) -> None:
        """Pass over the lines of a column."""
        if row > 0:
            self.numbers(length, form, reads=False)
            return
        for _ in self.strings(length, is_big, kind, form, reads=False):
            pass

    def strings(self, length: int, is_big: bool, kind: int, form: tuple[int, int], reads: bool = True):
        """Return first row and numbers of each string of a column of so many words."""
        words = _WORDS.get(kind, 1)
        while length > 0:
            head = _integers(self.line(), 2 if is_big else 1)
            if head is None:
                raise self.wanted.error("it is truncated, or a string of a column has no head")
            n, row = (head[0] - 1, head[1]) if is_big else _packed(head[0])
            length -= n + (2 if is_big else 1)
            if n < 1 or length < 0:
                raise self.wanted.error("a string of a column is longer than the column")
            yield row, self.numbers(n // words, form, reads)

    def numbers(self, n: int, form: tuple[int, int], reads: bool = True) -> np.ndarray:
        """Return the next numbers, so many a line and so wide."""
        per_line, width = form
        self.wanted.check_entries(n, 1.0)
        lines = [self.line() for _ in range(-(-n // per_line))]
        if not reads:
            return np.empty(0)
        found = fixed_width(lines, width, n)
        if found is None:
            raise self.wanted.error("it is truncated, or has a field that is no number")
        return found

    def read(self, position: int) -> FileMatrix:
        self.file.seek(position)
        n_columns, n_rows, form, kind, _, width = self.head()  # type: ignore[misc]
        _check_head(n_columns, n_rows, kind, self.wanted)
        parts = _Parts()
        while True:
            column, row, length = self.column(kind, width)
            if column > n_columns:
                return parts.matrix(abs(n_rows), n_columns, form, self.wanted)
            if row > 0:
                parts.add(column, row, self.numbers(length, width))
                continue
            for first, values in self.strings(length, n_rows < 0, kind, width):
                parts.add(column, first, values)


def _integers(line: bytes, n: int) -> list[int] | None:
    """Return the integers of a line, between blanks or else in fields of eight; None where it does not have so many."""
    fields = line.split()
    if len(fields) != n:
        fields = [line[8 * i : 8 * i + 8].strip() for i in range(n)]
    if not all(field.lstrip(b"-").isdigit() for field in fields):
        return None
    return [int(field) for field in fields]
