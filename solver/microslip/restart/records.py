"""Arrays as checked records in files: whatever ends a process, what is read back is whole or not there.

A record is a frame of two words, the length of what follows and its checksum, a JSON head that names the arrays, and their
bytes.  Nothing in it is executed.  Local, on the rank that owns the file.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from time import monotonic, perf_counter

import numpy as np

from ..parallel.files import said_of, written_whole

Arrays = dict[str, np.ndarray]  # by a path: "now/U"
_FRAME = struct.Struct("<QI")  # bytes of a record, their CRC-32
_HEAD = struct.Struct("<I")  # bytes of its head
_KINDS = "iufbc"  # of arrays; texts travel in the head
_SHARE = 300.0  # times as long as the disk takes to have it all: files are left to the system's memory in between


def pack(arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | None = None) -> bytes:
    """Return arrays and texts, anything that JSON holds, as one record."""
    values = [np.asarray(value) for value in arrays.values()]
    head = _head_of(tuple((name, value.dtype.str, value.shape) for name, value in zip(arrays, values)))
    coded = head + json.dumps(texts or {}).encode() + b"]"
    body = b"".join([_HEAD.pack(len(coded)), coded, *(value.tobytes() for value in values)])
    return _FRAME.pack(len(body), zlib.crc32(body)) + body


@lru_cache(maxsize=32)
def _head_of(arrays: tuple[tuple[str, str, tuple[int, ...]], ...]) -> bytes:
    """Return the first half of a head: names, types and shapes, which are mostly those of the record before."""
    return json.dumps([{name: (kind, shape) for name, kind, shape in arrays}]).encode()[:-1] + b","


def unpack(body: bytes) -> tuple[Arrays, dict]:
    """Return the arrays and texts of a record, without its frame.

    Raises
    ------
    ValueError : it is not one
    """
    start = _HEAD.size + _HEAD.unpack_from(body)[0]
    head, texts = json.loads(body[_HEAD.size : start])
    arrays = {}
    for name, (kind, shape) in head.items():
        dtype = np.dtype(kind)
        if dtype.kind not in _KINDS:
            raise ValueError(f"{name} is no array of numbers")
        size = dtype.itemsize * int(np.prod(shape, dtype=object))
        arrays[name] = np.frombuffer(body[start : start + size], dtype).reshape(shape).copy()
        start += size
    return arrays, texts


def read_records(path: Path) -> list[bytes]:
    """Return the records of a file up to the first that is not whole, without their frames; none where there is no file."""
    found: list[bytes] = []
    left = path.stat().st_size if path.is_file() else 0
    if left == 0:
        return found
    with open(path, "rb") as file:
        while left >= _FRAME.size:
            length, checksum = _FRAME.unpack(file.read(_FRAME.size))
            left -= _FRAME.size
            if length > left:
                break
            body = file.read(length)
            if zlib.crc32(body) != checksum:
                break
            found.append(body)
            left -= length
    return found


def length_of(records: Sequence[bytes]) -> int:
    """Return the bytes that records take in a file."""
    return sum(_FRAME.size + len(body) for body in records)


def write_record(path: Path, arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | None = None) -> None:
    """Write a file of one record, whole or not at all.

    Raises
    ------
    CaseError, ResourceError : it cannot be written
    """
    with written_whole(str(path)) as beside, open(beside, "wb") as file:
        file.write(pack(arrays, texts))


def read_record(path: Path) -> tuple[Arrays, dict] | None:
    """Return arrays and texts of a file of one record; None where it is missing or damaged."""
    records = read_records(path)
    try:
        return unpack(records[0]) if records else None
    except (ValueError, TypeError, KeyError, AttributeError, struct.error):
        return None


class Journal:
    """A file that records are appended to; ``keep`` bytes of it stay, what lies behind them is dropped.

    Each record is with the system when ``append`` returns, so that it outlives the process, and soon on the disk, so that it
    outlives the machine: the disk is waited for at most a three-hundredth of the time.

    Raises
    ------
    CaseError, ResourceError : it cannot be written
    """

    def __init__(self, path: Path, keep: int = 0):
        self.path = path
        with said_of(str(path)):
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
            os.ftruncate(self._handle, keep)
            os.lseek(self._handle, 0, os.SEEK_END)
        self._disk = Disk()

    def append(self, arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | None = None) -> None:
        """Append a record."""
        with said_of(str(self.path)):
            _write_all(self._handle, pack(arrays, texts))
            self._disk.reach(self._handle)

    def close(self) -> None:
        """Wait for the disk and close the file."""
        if self._handle >= 0:
            with said_of(str(self.path)):
                os.fsync(self._handle)
            os.close(self._handle)
            self._handle = -1


class Latest:
    """The latest of the records written under one name: two files in turn, so that one of them is always whole.

    Raises
    ------
    CaseError, ResourceError : they cannot be written
    """

    def __init__(self, path: Path):
        self._paths = [path.with_name(f"{path.name}.{i}") for i in range(2)]
        self._number = max([found["number"] for _, found in self._whole()], default=-1)
        self._handles = [-1, -1]
        self._lengths = [path.stat().st_size if path.is_file() else 0 for path in self._paths]
        self._disk = Disk()

    def _whole(self) -> list[tuple[Arrays, dict]]:
        return [found for path in self._paths if (found := read_record(path)) is not None]

    def read(self) -> list[tuple[Arrays, dict]]:
        """Return what is whole of it, the latest first."""
        return sorted(self._whole(), key=lambda found: -found[1]["number"])

    def write(self, arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | None = None) -> None:
        """Write a record in place of the one before the last."""
        self._number += 1
        turn = self._number % 2
        path, record = self._paths[turn], pack(arrays, {**(texts or {}), "number": self._number})
        with said_of(str(path)):
            if self._handles[turn] < 0:
                self._handles[turn] = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
            handle = self._handles[turn]
            os.lseek(handle, 0, os.SEEK_SET)
            _write_all(handle, record)
            if len(record) < self._lengths[turn]:
                os.ftruncate(handle, len(record))
            self._lengths[turn] = len(record)
            self._disk.reach(handle)

    def close(self) -> None:
        """Close both files."""
        for handle in self._handles:
            if handle >= 0:
                os.close(handle)
        self._handles = [-1, -1]


class Disk:
    """Waits for the disk now and then: at first, and whenever that takes less than a three-hundredth of the time since."""

    def __init__(self) -> None:
        self._next = 0.0

    def reach(self, handle: int) -> None:
        """Wait until a file has reached the disk, if it is time."""
        if monotonic() >= self._next:
            began = perf_counter()
            os.fsync(handle)
            self._next = monotonic() + _SHARE * (perf_counter() - began)


def _write_all(handle: int, record: bytes) -> None:
    """Write all bytes; the system may take a part at a time."""
    view = memoryview(record)
    while len(view):
        view = view[os.write(handle, view) :]
