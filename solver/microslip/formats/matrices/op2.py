"""Nastran's OUTPUT2, .op2: matrices among the data blocks of a file, 32-bit words.

pyNastran only reads matrices with names of a fixed list.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import IO

import numpy as np

from .file_matrix import FileMatrix, Wanted, from_coordinates
from .fortran_records import Records

_NUMBERS = {1: "f4", 2: "f8"}  # by the type code of the trailer; 3 and 4 are complex


def read_op2(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file, or the wanted one of several.  Local.  Raises CaseError, ResourceError: the file is faulty."""
    with open(wanted.path, "rb") as file:
        blocks = {block.name: block for block in _Walk(file, wanted).blocks() if block.is_matrix}
        if not blocks:
            raise wanted.error("there is no matrix among its data blocks")
        return _matrix(blocks[wanted.choose(list(blocks))], file, wanted)


@dataclass
class _Block:
    """A data block: its trailer and the positions of its columns."""

    name: str
    trailer: tuple[int, ...]  # number, columns, rows, form, type, ...
    order: str
    is_matrix: bool = False
    strings: list[tuple[int, int, int]] = field(default_factory=list)  # column, position, bytes


class _Walk(Records):
    """Sequential reader of a file: records are a single integer (marker) or data."""

    def __init__(self, file: IO[bytes], wanted: Wanted) -> None:
        head = file.read(4)
        file.seek(0)
        super().__init__(file, "<" if head == struct.pack("<i", 4) else ">", wanted)
        if head != struct.pack(f"{self.order}i", 4):
            raise wanted.error("it does not begin as OUTPUT2 with 32-bit words")

    def record(self) -> tuple[int, int]:
        """Skip the next record and return its position and size in bytes."""
        at = self.skip()
        if at is None:
            raise self.wanted.error("it is truncated at its end")
        return at

    def marker(self) -> int:
        at = self.record()
        if at[1] != 4:
            raise self.wanted.error(f"a marker is missing at byte {at[0]}")
        return struct.unpack(f"{self.order}i", self.content(at))[0]

    def blocks(self) -> Iterator[_Block]:
        """Yield the data blocks of the file in order."""
        while self.file.tell() < self.wanted.size:
            marker = self.marker()
            if marker == 3:  # date and label of the file
                for expected in (7, 2):
                    self.record()
                    if self.marker() != expected:
                        raise self.wanted.error("its label is damaged")
                self.record()
                self.marker(), self.marker()
            elif marker == 2:
                yield self.block()
            elif marker != 0:
                raise self.wanted.error(f"a data block begins with {marker}")

    def block(self) -> _Block:
        """Return the next data block."""
        name = self.content(self.record())[:8].decode("latin-1").strip()
        if self.marker() != -1:
            raise self.wanted.error(f"data block {name} has no trailer")
        self.marker()
        trailer = self.content(self.record())
        block = _Block(name, struct.unpack(f"{self.order}{len(trailer) // 4}i", trailer[: len(trailer) // 4 * 4]), self.order)
        while (marker := self.marker()) < 0:
            self.part(block, -marker - 3)
        return block

    def part(self, block: _Block, column: int) -> None:
        """Skip one part of a data block: a column of a matrix."""
        self.marker()
        is_column = self.marker() == 1
        block.is_matrix |= is_column
        while True:
            position = self.file.tell()
            marker = self.marker()
            if marker <= 0:
                self.file.seek(position)
                return
            at = self.record()
            if is_column:
                block.strings.append((column, *at))


def _matrix(block: _Block, file: IO[bytes], wanted: Wanted) -> FileMatrix:
    """Return the matrix of a data block."""
    if len(block.trailer) < 5:
        raise wanted.error(f"data block {block.name} has no trailer")
    _, n_columns, n_rows, form, kind = block.trailer[:5]
    if kind not in _NUMBERS:
        raise wanted.error(
            "it is complex; microslip takes real matrices" if kind in (3, 4) else f"its numbers are of type {kind}"
        )
    wanted.check_rows(max(n_rows, n_columns))
    number = np.dtype(block.order + _NUMBERS[kind])
    rows, columns, values = [], [], []
    for column, start, n_bytes in block.strings:
        if n_bytes < 4 or (n_bytes - 4) % number.itemsize:
            raise wanted.error(f"column {column + 1} of {block.name} does not hold whole numbers of {number.itemsize} bytes")
        file.seek(start)
        data = file.read(n_bytes)
        (first,) = struct.unpack(f"{block.order}i", data[:4])
        string = np.frombuffer(data, number, offset=4).astype(float)
        values.append(string)
        rows.append(first - 1 + np.arange(len(string)))
        columns.append(np.full(len(string), column))
    below, across = (np.concatenate([np.empty(0, dtype=np.int64), *parts]) for parts in (rows, columns))
    matrix = from_coordinates(below, across, np.concatenate([np.empty(0), *values]), (n_rows, n_columns), wanted)
    is_triangle = form == 6 and not ((below > across).any() and (below < across).any())
    return FileMatrix(matrix, is_triangle=is_triangle)
