"""Nastran's DMIG entries, of bulk data or a punch file: matrices by grid points and components."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from ...messages.errors import CaseError
from .file_matrix import LARGEST, DofMap, FileMatrix, Wanted, from_coordinates

_EXPONENT = re.compile(r"(?<=[\d.])([+-]\d)")  # Nastran writes 1.5-3 for 1.5e-3


def read_dmig(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file, or of several the one that is wanted, with grid point and component of each row.  Local.

    Raises
    ------
    CaseError : the file is at fault
    """
    heads, columns = _cards(wanted)
    if not heads:
        raise CaseError(f"{wanted.where} holds no DMIG entries")
    name = wanted.choose(list(heads))
    form, kind = heads[name]
    if kind in (3, 4):
        raise wanted.error(f"{name} is complex; microslip takes real matrices")
    if form not in (1, 2, 6, 9):
        raise wanted.error(f"{name} is of the form {form}; 1, 2, 6 and 9 are known")
    places, values = _entries(columns[name], wanted)
    row_keys, column_keys = 8 * places[:, 2] + places[:, 3], 8 * places[:, 0] + places[:, 1]
    if form in (1, 6):
        keys, at = np.unique(np.concatenate([row_keys, column_keys]), return_inverse=True)
        rows, cols, shape = at[: len(values)], at[len(values) :], (len(keys), len(keys))
    else:
        (keys, rows), (others, cols) = (np.unique(own, return_inverse=True) for own in (row_keys, column_keys))
        shape = len(keys), len(others)
    matrix = from_coordinates(rows, cols, values, shape, wanted)
    is_triangle = form == 6
    return FileMatrix(matrix, DofMap(keys // 8, keys % 8), is_triangle=is_triangle)


def _cards(wanted: Wanted) -> tuple[dict[str, tuple[int, int]], dict[str, list]]:
    """Return form and type of each matrix, and its columns: the fields of a card each."""
    heads: dict[str, tuple[int, int]] = {}
    columns: dict[str, list] = defaultdict(list)
    for number, fields in _logical(wanted):
        name, second = fields[0], fields[1]
        if second == "0":
            if not (fields[2].isdigit() and fields[3].isdigit()):
                raise wanted.error(f"line {number}: a DMIG entry without form and type")
            heads[name] = int(fields[2]), int(fields[3])
        elif second not in ("UACCEL", ""):
            columns[name].append((number, fields))
    return heads, columns


def _logical(wanted: Wanted) -> Iterator[tuple[int, list[str]]]:
    """Return line and fields of each DMIG card with its continuations."""
    fields, start, is_inside, line = [], 0, False, ""
    with open(wanted.path, encoding="latin-1") as file:
        for number, line in enumerate(file, 1):
            if len(line) > 4096:
                raise wanted.error("it has lines of more than 4096 characters")
            first = line[:1]
            if is_inside and first in "+* " and line.strip():
                fields += _fields(line)
                continue
            if is_inside:
                yield start, fields
            is_inside = line[:8].upper().startswith(("DMIG ", "DMIG*", "DMIG,"))
            if is_inside:
                fields, start = _fields(line), number
    if is_inside and not line.endswith("\n"):
        raise wanted.error(f"its last line, '{line[:60].strip()}', does not end; the file is truncated")
    if is_inside:
        yield start, fields


def _fields(line: str) -> list[str]:
    """Return the fields of a line after its first, of eight or sixteen characters, or between commas."""
    line = line.partition("$")[0].rstrip()
    if "," in line:
        own = [text.strip() for text in line.split(",")[1:9]]
        return own + [""] * (8 - len(own))
    width, n = (16, 4) if "*" in line[:8] else (8, 8)
    return [line[8 + width * i : 8 + width * (i + 1)].strip() for i in range(n)]


def _entries(cards: list, wanted: Wanted) -> tuple[np.ndarray, np.ndarray]:
    """Return grid point and component of column and row, (n, 4), and the numbers, (n,)."""
    places, values = [], []
    for number, fields in cards:
        try:
            column = int(fields[1]), int(fields[2] or 0)
            for i in range(4, len(fields), 4):
                point, component, value = fields[i : i + 3]
                if point:
                    places.append((*column, int(point), int(component or 0)))
                    values.append(_real(value))
        except (ValueError, IndexError):
            raise wanted.error(f"the DMIG entry of line {number} has a field that is no number") from None
    found = np.array(places, dtype=np.int64).reshape(-1, 4)
    if len(found) and abs(found).max() >= LARGEST:
        raise wanted.error(f"it has a grid point of the number {abs(found).max()}")
    if len(found) and (found[:, [1, 3]].min() < 0 or found[:, [1, 3]].max() > 6):
        raise wanted.error("a component of a DMIG entry is not 0 to 6")
    return found, np.array(values)


def _real(text: str) -> float:
    """Return a number as Nastran writes it: 1.5D+03, 1.5+3."""
    try:
        return float(text)
    except ValueError:
        plain = text.upper().replace("D", "E")
        return float(plain if "E" in plain else _EXPONENT.sub(r"E\1", plain))
