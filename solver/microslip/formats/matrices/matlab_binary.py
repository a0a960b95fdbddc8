"""MATLAB's .mat of versions 4 to 7: tables of numbers and sparse matrices.

SciPy's reader crashes on files that are damaged in the right place; here every length is held against the bytes that are there.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .file_matrix import FileMatrix, Wanted, from_coordinates

_MATRIX, _COMPRESSED = 14, 15  # types of elements
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = (
    " cell struct object char sparse double single int8 uint8 int16 uint16 int32 uint32 int64 uint64 function opaque".split(" ")
)
_SPARSE, _NUMBERS = 5, range(5, 16)
_COMPLEX = 0x800  # of the flags
_MOST_DEFLATED = 1040  # bytes that one byte can stand for
_HEAD = 4096  # bytes in which flags, shape and name of a variable are
_OLD_TYPES = ("f8", "f4", "i4", "i2", "u2", "u1")


@dataclass(frozen=True)
class _Variable:
    """A variable of a file, its numbers not read yet."""

    name: str
    kind: int  # index into _CLASSES
    is_complex: bool
    shape: tuple[int, ...]
    element: np.ndarray  # bytes
    is_packed: bool


def read_5(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file of version 5 to 7, or of several variables the one that is wanted.  Local.

    Raises
    ------
    CaseError : the file is at fault
    """
    data = np.memmap(wanted.path, dtype=np.uint8, mode="r")
    order = "<" if bytes(data[126:128]) == b"IM" else ">"
    found: dict[str, _Variable] = {}
    for kind, content in _elements(data[128:], order, wanted):
        if kind in (_MATRIX, _COMPRESSED):
            variable = _variable(content, kind == _COMPRESSED, order, wanted)
            if variable.name:
                found.setdefault(variable.name, variable)
    variable = found[wanted.choose(list(found))]
    if variable.kind not in _NUMBERS:
        kind_ = _CLASSES[variable.kind] if variable.kind < len(_CLASSES) else f"number {variable.kind}"
        raise wanted.error(f"its variable {variable.name} is of the class {kind_}; a matrix of numbers is needed")
    return FileMatrix(_numbers_of(variable, order, wanted))


def _elements(data: np.ndarray, order: str, wanted: Wanted) -> Iterator[tuple[int, np.ndarray]]:
    """Yield type and bytes of every element of a file."""
    at = 0
    while at < len(data):
        tag = np.frombuffer(bytes(data[at : at + 8]).ljust(8, b"\0"), dtype=f"{order}u4")
        kind, n = int(tag[0]), int(tag[1])
        if at + 8 + n > len(data):
            raise wanted.error(f"it is truncated: {n} bytes are announced, {max(len(data) - at - 8, 0)} follow")
        yield kind, data[at + 8 : at + 8 + n]
        at += 8 + n


def _variable(content: np.ndarray, is_packed: bool, order: str, wanted: Wanted) -> _Variable:
    """Return what the head of a variable says."""
    head = bytes(content[:_HEAD])
    if is_packed:
        head = zlib.decompressobj().decompress(head, _HEAD)
        claimed = int(np.frombuffer(head[:8].ljust(8, b"\0"), dtype=f"{order}u4")[1])
        if claimed > _MOST_DEFLATED * len(content):
            raise wanted.error(f"a variable claims {claimed} bytes in {len(content)}")
        head = head[8:]
    flags, at = _part(head, 0, order, wanted)
    shape, at = _part(head, at, order, wanted)
    name, at = _part(head, at, order, wanted)
    if len(flags) < 1:
        raise wanted.error("a variable has no class")
    return _Variable(
        name.astype(np.uint8).tobytes().decode("latin-1"),
        int(flags[0]) & 0xFF,
        bool(int(flags[0]) & _COMPLEX),
        tuple(int(length) for length in shape),
        content,
        is_packed,
    )


def _part(data: bytes, at: int, order: str, wanted: Wanted) -> tuple[np.ndarray, int]:
    """Return the numbers of an element within a variable, and where the next one begins."""
    word = int.from_bytes(data[at : at + 4], "little" if order == "<" else "big")
    if word >> 16:  # short: type, length and up to four bytes in eight
        kind, n, start, end = word & 0xFFFF, word >> 16, at + 4, at + 8
        is_short = n <= 4
    else:
        kind, n = word, int.from_bytes(data[at + 4 : at + 8], "little" if order == "<" else "big")
        start, is_short = at + 8, True
        end = start + n + -n % 8
    if not is_short or kind not in _TYPES or start + n > len(data):
        raise wanted.error(f"it is truncated or damaged: an element of type {kind} with {n} bytes")
    number = np.dtype(order + _TYPES[kind])
    return np.frombuffer(data, number, n // number.itemsize, start), end


def _numbers_of(variable: _Variable, order: str, wanted: Wanted) -> np.ndarray | sp.csc_matrix:
    """Return the numbers of a variable, as a table or as compressed columns."""
    data = bytes(variable.element)
    if variable.is_packed:
        claimed = int(np.frombuffer(zlib.decompressobj().decompress(data, 8).ljust(8, b"\0"), dtype=f"{order}u4")[1])
        data = zlib.decompressobj().decompress(data, claimed + 8)[8:]
        if len(data) < claimed:
            raise wanted.error(f"it is truncated: {claimed} bytes are announced, {len(data)} follow")
    at = 0
    for _ in range(3):  # flags, shape, name
        _, at = _part(data, at, order, wanted)
    if variable.kind == _SPARSE:
        return _sparse(data, at, variable, order, wanted)
    values, at = _part(data, at, order, wanted)
    if variable.is_complex:
        values = values + 1j * _part(data, at, order, wanted)[0]
    return _shaped(values, variable.shape, wanted)


def _shaped(values: np.ndarray, shape: tuple[int, ...], wanted: Wanted) -> np.ndarray:
    n = 1
    for length in shape:
        n *= length
    if min(shape, default=-1) < 0 or n != len(values):
        raise wanted.error(f"it holds {len(values)} numbers for the shape {shape}")
    return values.reshape(shape, order="F")


def _sparse(data: bytes, at: int, variable: _Variable, order: str, wanted: Wanted) -> sp.csc_matrix:
    """Return a sparse matrix: rows of entries, starts of columns, numbers."""
    rows, at = _part(data, at, order, wanted)
    starts, at = _part(data, at, order, wanted)
    values, at = _part(data, at, order, wanted)
    if variable.is_complex:
        values = values + 1j * _part(data, at, order, wanted)[0]
    rows, starts = rows.astype(np.int64), starts.astype(np.int64)
    if len(variable.shape) != 2 or min(variable.shape) < 0 or len(starts) != variable.shape[1] + 1:
        raise wanted.error(f"its sparse variable {variable.name} has {len(starts) - 1} columns for the shape {variable.shape}")
    wanted.check_rows(max(variable.shape))
    n = int(starts[-1])  # more may be allotted than there are
    if starts[0] != 0 or (np.diff(starts) < 0).any() or n > len(rows) or n > len(values):
        raise wanted.error(f"the columns of its sparse variable {variable.name} do not have the entries that they say")
    if n and not 0 <= rows[:n].min() <= rows[:n].max() < variable.shape[0]:
        raise wanted.error("row index exceeds matrix dimensions")
    return sp.csc_matrix((values[:n], rows[:n], starts), variable.shape)


def read_4(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file of version 4, or of several variables the one that is wanted.  Local.

    Raises
    ------
    CaseError : the file is at fault
    """
    data = np.memmap(wanted.path, dtype=np.uint8, mode="r")
    found: dict[str, tuple[int, np.ndarray]] = {}  # sort, table
    at = 0
    while at < len(data):
        name, sort, table, at = _old_variable(data, at, wanted)
        found.setdefault(name, (sort, table))
    name = wanted.choose(list(found))
    sort, table = found[name]
    if sort == 1:
        raise wanted.error(f"its variable {name} is of the class char; a matrix of numbers is needed")
    return FileMatrix(table if sort == 0 else _old_sparse(table, name, wanted))


def _old_variable(data: np.ndarray, at: int, wanted: Wanted) -> tuple[str, int, np.ndarray, int]:
    """Return name, sort (numbers, text, sparse), table and end of the variable that begins at a byte."""
    head = bytes(data[at : at + 20])
    order = "<" if 0 <= int.from_bytes(head[:4], "little") < 5000 else ">"
    if len(head) < 20:
        raise wanted.error(f"it is truncated at byte {at}")
    code, n_rows, n_columns, is_complex, n_letters = (int(number) for number in np.frombuffer(head, f"{order}i4"))
    precision, sort = code // 10 % 10, code % 10
    if code // 100 % 10 or code >= 5000 or precision >= len(_OLD_TYPES) or sort > 2 or min(n_rows, n_columns, n_letters) < 0:
        raise wanted.error(f"it is damaged, or of a machine that is not known: {code} at byte {at}")
    number = np.dtype(order + _OLD_TYPES[precision])
    n = n_rows * n_columns
    start = at + 20 + n_letters
    end = start + n * number.itemsize * (2 if is_complex else 1)
    if end > len(data):
        raise wanted.error(f"it is truncated: {end - at} bytes are announced, {len(data) - at} follow")
    values = np.frombuffer(bytes(data[start:end]), number)
    values = values[:n] + 1j * values[n:] if is_complex else values
    name = bytes(data[at + 20 : start]).rstrip(b"\0").decode("latin-1")
    return name, sort, values.reshape((n_rows, n_columns), order="F"), end


def _old_sparse(table: np.ndarray, name: str, wanted: Wanted) -> sp.csr_matrix:
    """Return a sparse matrix of a table of rows, columns and values, from 1, whose last line has its shape."""
    if table.shape[0] < 1 or table.shape[1] not in (3, 4) or table.dtype.kind == "c":
        raise wanted.error(f"its sparse variable {name} is no table of rows, columns and values")
    if not np.isfinite(table[:, :2]).all():
        raise wanted.error(f"its sparse variable {name} has rows or columns that are no numbers")
    shape = int(table[-1, 0]), int(table[-1, 1])
    wanted.check_rows(max(shape))
    wanted.check_rows(min(shape))
    places = table[:-1, :2]
    if len(places) and (places.min() < 1 or (places > shape).any()):
        raise wanted.error("row or column index exceeds matrix dimensions")
    values = table[:-1, 2] if table.shape[1] == 3 else table[:-1, 2] + 1j * table[:-1, 3]
    return from_coordinates(places[:, 0].astype(np.int64) - 1, places[:, 1].astype(np.int64) - 1, values, shape, wanted)
