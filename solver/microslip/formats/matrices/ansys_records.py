"""The records of Ansys' binary files."""

from __future__ import annotations

import numpy as np

from .file_matrix import Wanted

_INTEGERS, _NUMBERS = 0x80000000, 0x0  # kinds of records; all others are compressed


class Records:
    """Records of words: length, kind, content, length; ``advice`` names a readable format for messages."""

    def __init__(self, words: np.ndarray, wanted: Wanted, advice: str) -> None:
        self.words, self.wanted, self.advice = words, wanted, advice

    @classmethod
    def of(cls, wanted: Wanted, advice: str) -> Records:
        """Return the records of a file."""
        n_words = wanted.size // 4
        words = np.memmap(wanted.path, "<i4", "r", shape=(n_words,)) if n_words else np.empty(0, dtype="<i4")
        return cls(words, wanted, advice)

    def length(self, at: int) -> int:
        """Return the number of words of the record at a position; CaseError if no record fits there."""
        n = int(self.words[at]) if 0 <= at < len(self.words) - 2 else -1
        if n < 0 or at + n + 3 > len(self.words) or self.words[at + 2 + n] != n:
            raise self.wanted.error(f"it is truncated or damaged: no record at word {at}")
        return n

    def follow(self, at: int) -> int:
        """Return the position of the record after this one."""
        return at + self.length(at) + 3

    def integers(self, at: int) -> np.ndarray:
        """Return the integers of the record at a position; CaseError if it has another type.  Local."""
        return self._content(at, _INTEGERS)

    def numbers(self, at: int) -> np.ndarray:
        """Return the numbers in double precision of the record at a position; CaseError if it has another type.  Local."""
        return self._content(at, _NUMBERS).view("<f8")

    def _content(self, at: int, kind: int) -> np.ndarray:
        n = self.length(at)
        stated = int(self.words[at + 1]) & 0xFFFFFFFF
        if stated != kind or (kind == _NUMBERS and n % 2):
            raise self.wanted.error(f"the record at word {at} is of the kind {stated:#x}, which is not read; {self.advice}")
        return self.words[at + 2 : at + 2 + n]
