"""Harwell-Boeing and Rutherford-Boeing: compressed columns in fields of fixed width."""

from itertools import islice

import numpy as np
import scipy.sparse as sp

from ...messages.errors import CaseError
from ..numbers import numbers_of
from .file_matrix import FileMatrix, Wanted
from .text import fixed_width, fortran_format


def read_harwell_boeing(wanted: Wanted) -> FileMatrix:
    """Return the matrix of a file: assembled, real or integer.  Local.  Raises CaseError, ResourceError: the file is faulty."""
    with open(wanted.path, "rb") as file:
        head = [file.readline(200).decode("latin-1") for _ in range(4)]
        kind = head[2][:3].upper()
        sizes, counts = _whole(head[2][14:]), _whole(head[1])
        if len(kind.strip()) != 3 or len(sizes) < 3 or len(counts) < 3:
            raise CaseError(f"{wanted.where} is not a Harwell-Boeing file: its second and third line hold no sizes")
        _check_kind(kind, wanted)
        n_rows, n_columns, n = sizes[:3]
        has_right_sides = len(counts) > 4 and counts[4] > 0  # right-hand sides add a format line to the header
        stated = [fortran_format(head[3][start : start + width]) for start, width in ((0, 16), (16, 16), (32, 20))]
        formats = [each for each in stated if each is not None]
        if len(formats) < 3:
            raise wanted.error(f"'{head[3].strip()[:60]}' is not three formats as (16I5) and (4E20.12)")
        wanted.check_entries(n, sum(each[1] for each in formats[1:]) / 2.0)
        wanted.check_entries(n_columns, 1.0)
        wanted.check_rows(n_rows)
        if has_right_sides:
            file.readline(200)
        starts = _field(file, formats[0], n_columns + 1, wanted).astype(np.int64) - 1
        rows = _field(file, formats[1], n, wanted).astype(np.int64) - 1
        values = _field(file, formats[2], n, wanted)
    if starts[0] != 0 or starts[-1] != n or (np.diff(starts) < 0).any() or n and not 0 <= rows.min() <= rows.max() < n_rows:
        raise wanted.error("its columns do not have the stated number of entries")
    return FileMatrix(sp.csc_matrix((values, rows, starts), (n_rows, n_columns)), is_triangle=kind[1] == "S")


def _check_kind(kind: str, wanted: Wanted) -> None:
    """Raise CaseError unless the matrix is real, assembled, and symmetric or general."""
    if kind[0] == "C":
        raise CaseError(
            f"{wanted.where} is complex; microslip takes real matrices: damping goes into [model] damping or [damping]"
        )
    if kind[0] in "PQ":
        raise CaseError(f"{wanted.where} is a pattern without numbers")
    if kind[0] not in "RI" or kind[1] not in "SUR" or kind[2] != "A":
        raise wanted.error(f"its type is {kind}; RSA and RUA are read: real, symmetric or not, assembled")


def _whole(text: str) -> list[int]:
    """Return the whole numbers at the beginning of a text."""
    values = []
    for word in text.split():
        if not word.lstrip("+-").isdigit():
            break
        values.append(int(word))
    return values


def _field(file, form: tuple[int, int], n: int, wanted: Wanted) -> np.ndarray:
    """Return the next ``n`` numbers: blank-separated, as SciPy writes them against its format, or of the stated width."""
    per_line, width = form
    lines = [line.rstrip(b"\r\n").ljust(per_line * width) for line in islice(file, -(-n // per_line))]
    values = numbers_of(b" ".join(lines).replace(b"D", b"E"))
    if values is not None and len(values) == n:
        return values
    values = fixed_width([line[: per_line * width] for line in lines], width, n)
    if values is None:
        raise wanted.error("it is truncated, or has a field that is not a number")
    return values
