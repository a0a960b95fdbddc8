"""Arrays as checked records in files: after any interruption a record is read back complete or not at all.

Each record has a length and a CRC-32, a JSON head that names the arrays, and their bytes.  Nothing in it is executed.  Local, on
the rank that owns the file.

A written record is with the operating system and survives the process.  fsync, which can take as long as a point on a
busy disk, runs in a background thread.
"""

import json
import math
import os
import re
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from operator import index
from pathlib import Path
from time import monotonic, perf_counter
from typing import TypeVar

import numpy as np

from ..messages.errors import CaseError
from ..system.files import atomic_write, file_errors

T = TypeVar("T")
Arrays = dict[str, np.ndarray]  # by a path: "now/U"
_FRAME = struct.Struct("<QI")  # bytes of a record, their CRC-32
_HEAD = struct.Struct("<I")  # bytes of its head
_KIND = re.compile(r"[<>|](?:[iub][1248]|f8|c16)")  # types of arrays, doubles among them; texts are in the head
# errors of decoding bytes that are not a record
_DAMAGED = (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError, RecursionError, struct.error)
_INTERVAL = 300.0  # times the duration of an fsync: the least time between two of them


def pack(arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | bytes | None = None) -> bytes:
    """Return one record of arrays and of texts, which are encoded JSON or anything that JSON can represent."""
    values = [np.asarray(value, order="C") for value in arrays.values()]
    head = _head_of(tuple(arrays), *zip(*[(value.dtype, value.shape) for value in values]))
    coded = head + (texts if isinstance(texts, bytes) else json.dumps(texts).encode() if texts else b"{}") + b"]"
    body = b"".join([_HEAD.pack(len(coded)), coded, *values])  # type: ignore[list-item]  # arrays are buffers
    return framed(body)


def framed(body: bytes) -> bytes:
    """Return a record: its contents after their length and checksum."""
    return _FRAME.pack(len(body), zlib.crc32(body)) + body


@lru_cache(maxsize=64)
def _head_of(names: tuple[str, ...], kinds: tuple[np.dtype, ...] = (), shapes: tuple[tuple[int, ...], ...] = ()) -> bytes:
    """Return the first half of a head: names, types and shapes, cached because most records equal the previous one."""
    described = {name: (kind.str, shape) for name, kind, shape in zip(names, kinds, shapes)}
    return json.dumps([described]).encode()[:-1] + b","


def unpack(body: bytes) -> tuple[Arrays, dict]:
    """Return the arrays and texts of a record without its header.  Raises ValueError: the bytes are not a record."""
    start = _HEAD.size + _HEAD.unpack_from(body)[0]
    head, texts = json.loads(body[_HEAD.size : start])
    arrays = {}
    for name, (kind, shape) in head.items():
        if not _KIND.fullmatch(kind):
            raise ValueError(f"{name} is no array of numbers")
        dtype = np.dtype(kind)
        size = dtype.itemsize * math.prod(map(index, shape))
        arrays[name] = np.frombuffer(body[start : start + size], dtype).reshape(shape).copy()
        start += size
    return arrays, texts


def read_records(path: Path) -> list[bytes]:
    """Return the records of a file up to the first incomplete one, without their headers; none if there is no file."""
    records: list[bytes] = []
    remaining = path.stat().st_size if path.is_file() else 0
    if remaining == 0:
        return records
    with open(path, "rb") as file:
        while remaining >= _FRAME.size:
            length, checksum = _FRAME.unpack(file.read(_FRAME.size))
            remaining -= _FRAME.size
            if length > remaining:
                break
            body = file.read(length)
            if zlib.crc32(body) != checksum:
                break
            records.append(body)
            remaining -= length
    return records


def length_of(records: Sequence[bytes]) -> int:
    """Return the bytes that records take in a file."""
    return sum(_FRAME.size + len(body) for body in records)


def checksum_of(record: bytes) -> int:
    """Return the checksum of a packed record."""
    return _FRAME.unpack_from(record)[1]


def write_record(path: Path, arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | None = None) -> None:
    """Write a file of one record atomically.  Raises CaseError, ResourceError: it cannot be written."""
    with atomic_write(str(path)) as temporary, open(temporary, "wb") as file:
        file.write(pack(arrays, texts))


def checked_read(path: Path, read: Callable[..., T], *arguments: object) -> T:
    """Return ``read(*arguments)``, which decodes the records of a file or a folder.

    Checksums show that records are complete, not that this version of the program wrote them.

    Raises
    ------
    CaseError : the records have contents unknown to this version
    """
    try:
        return read(*arguments)
    except _DAMAGED as problem:
        cause = " ".join(f"{type(problem).__name__}: {problem}".split())[:200]
        raise CaseError(f"{path}: has contents that this program does not write ({cause}); start again with --fresh") from problem


def write_unsynced(path: Path, arrays: Mapping[str, np.ndarray], texts: Mapping[str, object] | None = None) -> None:
    """Write a file of one record without waiting for the disk: a truncated file is treated as missing.

    Raises
    ------
    CaseError, ResourceError : it cannot be written
    """
    with file_errors(str(path)), open(path, "wb", buffering=0) as file:
        _write_all(file.fileno(), [pack(arrays, texts)])


def read_record(path: Path) -> tuple[Arrays, dict] | None:
    """Return arrays and texts of a file of one record; None if it is missing or damaged."""
    records = read_records(path)
    try:
        return unpack(records[0]) if records else None
    except _DAMAGED:
        return None


class Disk:
    """Calls fsync in a background thread, at most for one three-hundredth of the time.

    One object is used for all files of a run, or a single file.  An error of the system is raised by the next call.

    Raises
    ------
    OSError : of every method, if a file did not reach the disk
    """

    def __init__(self) -> None:
        self._next = 0.0
        self._executor: ThreadPoolExecutor | None = None
        self._pending: list[Future] = []

    def sync(self, handle: int, is_last: bool = False) -> None:
        """Start to synchronise a file, if the interval has passed or ``is_last``."""
        self._raise_failures()
        if is_last or (not self._pending and monotonic() >= self._next):
            self._executor = self._executor or ThreadPoolExecutor(1, "disk")
            duplicate = os.dup(handle)
            try:
                self._pending.append(self._executor.submit(self._sync, duplicate))
            except RuntimeError:  # no further thread available
                self._executor = None
                self._sync(duplicate)

    def wait(self) -> None:
        """Wait for all pending files."""
        for future in self._pending:
            future.exception()
        self._raise_failures()

    def _sync(self, handle: int) -> None:
        """Synchronise a file and close its handle.  Called in the thread."""
        try:
            began = perf_counter()
            os.fsync(handle)
            self._next = monotonic() + _INTERVAL * (perf_counter() - began)
        finally:
            os.close(handle)

    def _raise_failures(self) -> None:
        """Raise the first error since the last call."""
        finished = [future for future in self._pending if future.done()]
        self._pending = [future for future in self._pending if future not in finished]
        for future in finished:
            future.result()


class Journal:
    """A file to which records are appended after its first ``keep`` bytes; later bytes are truncated.

    When ``append`` returns, the operating system has the record, which survives the process; soon after it is on the disk and
    survives the machine.

    Raises
    ------
    CaseError, ResourceError : it cannot be written
    """

    def __init__(self, path: Path, keep: int = 0, disk: Disk | None = None):
        self.path = path
        with file_errors(str(path)):
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
            self._disk.sync(self._handle)
        except OSError:
            with file_errors(str(self.path)):
                raise

    def close(self) -> None:
        """Request a last synchronisation and close the file."""
        if self._handle >= 0:
            with file_errors(str(self.path)):
                self._disk.sync(self._handle, is_last=True)
            os.close(self._handle)
            self._handle = -1


class Latest:
    """The latest record of a name, written to two files alternately, so that one of them is always complete.

    A record may have parts: packed records that follow it in the file.  The record has their checksums, so that parts which did
    not change are neither packed nor summed again.

    Raises
    ------
    CaseError, ResourceError : they cannot be written
    """

    def __init__(self, path: Path, disk: Disk | None = None):
        self._paths = [path.with_name(f"{path.name}.{i}") for i in range(2)]
        self._number = max([record["number"] for _, record in self._intact()], default=-1)
        self._handles = [-1, -1]
        self._lengths = [path.stat().st_size if path.is_file() else 0 for path in self._paths]
        self._disk = disk or Disk()

    def _intact(self) -> list[tuple[Arrays, dict]]:
        return [record for path in self._paths if (record := _with_parts(path)) is not None]

    def read(self) -> list[tuple[Arrays, dict]]:
        """Return the complete records, the latest first, with the arrays of their parts under the names of the parts."""
        return sorted(self._intact(), key=lambda record: -record[1]["number"])

    def write(self, arrays: Mapping[str, np.ndarray], parts: Mapping[str, bytes] | None = None) -> None:
        """Write a record over the older of the two."""
        self._number += 1
        turn, parts = self._number % 2, parts or {}
        header = {"number": np.array(self._number), "sums": np.array([checksum_of(part) for part in parts.values()], dtype="u4")}
        record = pack({**arrays, **header}, _names_of(tuple(parts)))
        try:
            self._put(turn, [record, *parts.values()])
        except OSError:
            with file_errors(str(self._paths[turn])):
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
        self._disk.sync(handle)

    def close(self) -> None:
        """Close both files."""
        for handle in self._handles:
            if handle >= 0:
                os.close(handle)
        self._handles = [-1, -1]


@lru_cache(maxsize=64)
def _names_of(parts: tuple[str, ...]) -> bytes:
    """Return the names of the parts as JSON, cached because most records equal the previous one."""
    return json.dumps({"parts": parts}).encode()


def _with_parts(path: Path) -> tuple[Arrays, dict] | None:
    """Return arrays and texts of a record and its parts; None if one of them is missing or damaged."""
    records = read_records(path)
    try:
        arrays, header = unpack(records[0])
        number, sums, names = int(arrays.pop("number")), arrays.pop("sums").tolist(), header["parts"]
        parts = records[1 : 1 + len(sums)]  # records after these belong to an earlier, longer record
        if [zlib.crc32(part) for part in parts] != sums:
            return None
        for name, part in zip(names, parts, strict=True):
            arrays |= {f"{name}/{key}": value for key, value in unpack(part)[0].items()}
        return arrays, {"number": number}
    except _DAMAGED:
        return None


def _write_all(handle: int, records: Sequence[bytes]) -> int:
    """Write records and return their size in bytes, in several system calls if necessary."""
    length, written = sum(map(len, records)), os.writev(handle, records)
    if written < length:
        view = memoryview(b"".join(records))
        while written < length:
            written += os.write(handle, view[written:])
    return length
