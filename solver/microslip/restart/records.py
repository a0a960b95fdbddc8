"""Arrays as checked records in files: whatever ends a process, what is read back is whole or not there.

A record is a frame of two words, the length of what follows and its checksum, a JSON head that names the arrays, and their
bytes.  Nothing in it is executed.  Local, on the rank that owns the file.

Records are with the system when they are written, so that they outlive the process.  The disk is waited for in a thread, beside
the computation: fsync takes as long as a point on a busy disk.
"""

from __future__ import annotations

import json
import os
import re
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from time import monotonic, perf_counter
from typing import TypeVar

import numpy as np

from ..messages.errors import CaseError
from ..system.files import said_of, written_whole

T = TypeVar("T")
Arrays = dict[str, np.ndarray]  # by a path: "now/U"
_FRAME = struct.Struct("<QI")  # bytes of a record, their CRC-32
_HEAD = struct.Struct("<I")  # bytes of its head
_KIND = re.compile(r"[<>|][iufbc]\d{1,2}")  # of arrays; texts travel in the head
# what bytes that are no record come to
_DAMAGED = (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError, RecursionError, struct.error)
_SHARE = 300.0  # times as long as the disk takes to have it all: files are left to the system's memory in between


def pack(arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | bytes | None = None) -> bytes:
    """Return arrays and texts, anything that JSON holds or JSON itself, as one record."""
    values = [np.asarray(value, order="C") for value in arrays.values()]
    head = _head_of(tuple(arrays), *zip(*[(value.dtype, value.shape) for value in values]))
    coded = head + (texts if isinstance(texts, bytes) else json.dumps(texts).encode() if texts else b"{}") + b"]"
    body = b"".join([_HEAD.pack(len(coded)), coded, *values])  # type: ignore[list-item]  # arrays are buffers
    return framed(body)


def framed(body: bytes) -> bytes:
    """Return what is in a record as one, with its length and checksum."""
    return _FRAME.pack(len(body), zlib.crc32(body)) + body


@lru_cache(maxsize=64)
def _head_of(names: tuple[str, ...], kinds: tuple[np.dtype, ...] = (), shapes: tuple[tuple[int, ...], ...] = ()) -> bytes:
    """Return the first half of a head: names, types and shapes, which are mostly those of the record before."""
    described = {name: (kind.str, shape) for name, kind, shape in zip(names, kinds, shapes)}
    return json.dumps([described]).encode()[:-1] + b","


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
        if not _KIND.fullmatch(kind):
            raise ValueError(f"{name} is no array of numbers")
        dtype = np.dtype(kind)
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


def checksum_of(record: bytes) -> int:
    """Return the checksum of a packed record."""
    return _FRAME.unpack_from(record)[1]


def write_record(path: Path, arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | None = None) -> None:
    """Write a file of one record, whole or not at all.

    Raises
    ------
    CaseError, ResourceError : it cannot be written
    """
    with written_whole(str(path)) as beside, open(beside, "wb") as file:
        file.write(pack(arrays, texts))


def as_written(path: Path, read: Callable[..., T], *arguments: object) -> T:
    """Return what ``read(*arguments)`` makes of the records of a file or a folder.

    Records are whole, their sums say.  What they hold was written by this very program, or by somebody else.

    Raises
    ------
    CaseError : it is not what this program writes
    """
    try:
        return read(*arguments)
    except _DAMAGED as problem:
        cause = " ".join(f"{type(problem).__name__}: {problem}".split())[:200]
        raise CaseError(f"{path}: holds what this program does not write there ({cause}); begin anew with --fresh") from problem


def note_record(path: Path, arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | None = None) -> None:
    """Write a file of one record where none is worth keeping: cut off, it is as good as not there, so nobody waits for the disk.

    Raises
    ------
    CaseError, ResourceError : it cannot be written
    """
    with said_of(str(path)), open(path, "wb", buffering=0) as file:
        _write_all(file.fileno(), [pack(arrays, texts)])


def read_record(path: Path) -> tuple[Arrays, dict] | None:
    """Return arrays and texts of a file of one record; None where it is missing or damaged."""
    records = read_records(path)
    try:
        return unpack(records[0]) if records else None
    except _DAMAGED:
        return None


class Disk:
    """Has files reach the disk, in a thread: at first, and whenever that takes less than a three-hundredth of the time since.

    One for all files of a run, or of its own for each.  What the system reports comes with the next call.

    Raises
    ------
    OSError : of every method, where a file did not reach the disk
    """

    def __init__(self) -> None:
        self._next = 0.0
        self._beside: ThreadPoolExecutor | None = None
        self._under_way: list[Future] = []

    def reach(self, handle: int, is_last: bool = False) -> None:
        """Begin to bring a file to the disk, if it is time or this is the last of it."""
        self._hear()
        if is_last or (not self._under_way and monotonic() >= self._next):
            self._beside = self._beside or ThreadPoolExecutor(1, "disk")
            own = os.dup(handle)
            try:
                self._under_way.append(self._beside.submit(self._bring, own))
            except RuntimeError:  # the system gives no further thread
                self._beside = None
                self._bring(own)

    def wait(self) -> None:
        """Wait for what is under way."""
        for one in self._under_way:
            one.exception()
        self._hear()

    def _bring(self, handle: int) -> None:
        """Wait until a file has reached the disk, in the thread; the handle is its own."""
        try:
            began = perf_counter()
            os.fsync(handle)
            self._next = monotonic() + _SHARE * (perf_counter() - began)
        finally:
            os.close(handle)

    def _hear(self) -> None:
        """Raise what has failed since the last call."""
        over = [one for one in self._under_way if one.done()]
        self._under_way = [one for one in self._under_way if one not in over]
        for one in over:
            one.result()


class Journal:
    """A file that records are appended to; ``keep`` bytes of it stay, what lies behind them is dropped.

    Each record is with the system when ``append`` returns, so that it outlives the process, and soon on the disk, so that it
    outlives the machine.

    Raises
    ------
    CaseError, ResourceError : it cannot be written
    """

    def __init__(self, path: Path, keep: int = 0, disk: Disk | None = None):
        self.path = path
        with said_of(str(path)):
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
            os.ftruncate(self._handle, keep)
            os.lseek(self._handle, 0, os.SEEK_END)
        self._disk = disk or Disk()

    def append(self, arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | None = None) -> None:
        """Append a record."""
        self.append_packed([pack(arrays, texts)])

    def append_packed(self, records: Sequence[bytes]) -> None:
        """Append records."""
        try:
            _write_all(self._handle, records)
            self._disk.reach(self._handle)
        except OSError:
            with said_of(str(self.path)):
                raise

    def close(self) -> None:
        """Leave the file to the disk and close it."""
        if self._handle >= 0:
            with said_of(str(self.path)):
                self._disk.reach(self._handle, is_last=True)
            os.close(self._handle)
            self._handle = -1


class Latest:
    """The latest of the records written under one name: two files in turn, so that one of them is always whole.

    A record may have parts, which are packed records themselves and often those of the one before: they lie behind it, and it
    holds their checksums, so that they are neither packed nor summed again.

    Raises
    ------
    CaseError, ResourceError : they cannot be written
    """

    def __init__(self, path: Path, disk: Disk | None = None):
        self._paths = [path.with_name(f"{path.name}.{i}") for i in range(2)]
        self._number = max([found["number"] for _, found in self._whole()], default=-1)
        self._handles = [-1, -1]
        self._lengths = [path.stat().st_size if path.is_file() else 0 for path in self._paths]
        self._disk = disk or Disk()

    def _whole(self) -> list[tuple[Arrays, dict]]:
        return [found for path in self._paths if (found := _with_parts(path)) is not None]

    def read(self) -> list[tuple[Arrays, dict]]:
        """Return what is whole of it, the latest first, with the arrays of its parts under their names."""
        return sorted(self._whole(), key=lambda found: -found[1]["number"])

    def write(self, arrays: Mapping[str, np.ndarray], parts: Mapping[str, bytes] | None = None) -> None:
        """Write a record in place of the one before the last."""
        self._number += 1
        turn, parts = self._number % 2, parts or {}
        said = {"number": np.array(self._number), "sums": np.array([checksum_of(part) for part in parts.values()], dtype="u4")}
        record = pack({**arrays, **said}, _names_of(tuple(parts)))
        try:
            self._put(turn, [record, *parts.values()])
        except OSError:
            with said_of(str(self._paths[turn])):
                raise

    def _put(self, turn: int, records: Sequence[bytes]) -> None:
        """Write one of the files from its beginning."""
        if self._handles[turn] < 0:
            self._handles[turn] = os.open(self._paths[turn], os.O_RDWR | os.O_CREAT, 0o644)
        handle = self._handles[turn]
        os.lseek(handle, 0, os.SEEK_SET)
        length = _write_all(handle, records)
        if length < self._lengths[turn]:
            os.ftruncate(handle, length)
        self._lengths[turn] = length
        self._disk.reach(handle)

    def close(self) -> None:
        """Close both files."""
        for handle in self._handles:
            if handle >= 0:
                os.close(handle)
        self._handles = [-1, -1]


@lru_cache(maxsize=64)
def _names_of(parts: tuple[str, ...]) -> bytes:
    """Return names of parts as texts, which are mostly those of the record before."""
    return json.dumps({"parts": parts}).encode()


def _with_parts(path: Path) -> tuple[Arrays, dict] | None:
    """Return arrays and texts of a record and its parts; None where one of them is missing or damaged."""
    records = read_records(path)
    try:
        arrays, said = unpack(records[0])
        number, sums, names = int(arrays.pop("number")), arrays.pop("sums").tolist(), said["parts"]
        parts = records[1 : 1 + len(sums)]  # what lies behind is of a longer one before
        if [zlib.crc32(part) for part in parts] != sums:
            return None
        for name, part in zip(names, parts, strict=True):
            arrays |= {f"{name}/{key}": value for key, value in unpack(part)[0].items()}
        return arrays, {"number": number}
    except _DAMAGED:
        return None


def _write_all(handle: int, records: Sequence[bytes]) -> int:
    """Write records and return their bytes; the system may take a part at a time."""
    length, written = sum(map(len, records)), os.writev(handle, records)
    if written < length:
        view = memoryview(b"".join(records))
        while written < length:
            written += os.write(handle, view[written:])
    return length
