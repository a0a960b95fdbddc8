"""Unformatted records of Fortran: a length in bytes, the content, the length again."""

import struct
from typing import IO

from .file_matrix import Wanted


class Records:
    """Sequential reader of the records of a file, 32-bit words in the byte order ``order``, "<" or ">"."""

    def __init__(self, file: IO[bytes], order: str, wanted: Wanted) -> None:
        self.file, self.order, self.wanted = file, order, wanted

    def skip(self) -> tuple[int, int] | None:
        """Skip the next record and return its position and size in bytes; None at the end of the file.

        Raises
        ------
        CaseError : the lengths before and after the record differ, or the record exceeds the file
        """
        mark = self.file.read(4)
        if not mark:
            return None
        (n,) = struct.unpack(f"{self.order}i", mark.ljust(4, b"\0"))
        start = self.file.tell()
        if len(mark) < 4 or n < 0 or start + n + 4 > self.wanted.size:
            raise self.wanted.error(f"it is truncated: a record of {n} bytes begins at byte {start}")
        self.file.seek(start + n)
        if self.file.read(4) != mark:
            raise self.wanted.error(f"the record at byte {start} does not end at its stated length")
        return start, n

    def content(self, at: tuple[int, int], most: int | None = None) -> bytes:
        """Return the content of a record, or its first ``most`` bytes, without moving to the next record."""
        position = self.file.tell()
        self.file.seek(at[0])
        data = self.file.read(at[1] if most is None else min(most, at[1]))
        self.file.seek(position)
        return data
