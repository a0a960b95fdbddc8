"""Numbers in text files: columns, read in blocks, and Fortran fields of fixed width."""

import re
from typing import IO

import numpy as np
import scipy.sparse as sp

from ..numbers import numbers_of
from .file_matrix import Wanted, from_coordinates

_BLOCK = 1 << 26  # bytes read at a time
_LONGEST = 4096  # characters of a line


def table_of(file: IO[bytes], n_columns: int, wanted: Wanted, has_no_count: bool = False) -> np.ndarray:
    """Return the numbers in the rest of a file, (n_lines, n_columns), separated by blanks or commas.  Local.

    With ``has_no_count`` (the file does not state the number of lines) the last line must end: its number may be truncated.

    Raises
    ------
    CaseError : a line of another form
    """
    parts, rest = [np.empty((0, n_columns))], b""
    while block := file.read(_BLOCK):
        block = rest + block
        cut = block.rfind(b"\n") + 1
        parts.append(_table(block[:cut], n_columns, wanted))
        rest = block[cut:]
        if len(rest) > _LONGEST:
            raise wanted.error(f"it has lines of more than {_LONGEST} characters")
    if rest.strip() and has_no_count:
        raise wanted.error(f"its last line, '{rest[:60].decode('latin-1').strip()}', does not end; the file is truncated")
    parts.append(_table(rest, n_columns, wanted))
    return np.concatenate(parts)


def _table(text: bytes, n_columns: int, wanted: Wanted) -> np.ndarray:
    plain = text.replace(b",", b" ").replace(b"D", b"E").replace(b"d", b"e")
    values = numbers_of(plain)
    n_lines = plain.count(b"\n") + (not plain.endswith(b"\n"))
    if values is None or values.size != n_columns * n_lines:  # empty lines, or words that are not numbers
        lines = [line for line in plain.splitlines() if line.strip()]
        for line in lines:
            of_line = numbers_of(line)
            if of_line is None or of_line.size != n_columns:
                raise wanted.error(f"the line '{line[:60].decode('latin-1').strip()}' is not {n_columns} numbers")
        values = numbers_of(b"\n".join(lines))
    return values.reshape(-1, n_columns)


def square_of(table: np.ndarray, wanted: Wanted, n: int | None = None) -> sp.csr_matrix:
    """Return the matrix of lines row, column, value, counted from 1; ``n`` rows, by default the largest index.  Local.

    Raises
    ------
    CaseError : indices that are not whole numbers from 1, or more rows than a file of this size can have
    """
    if len(table) and (table[:, :2].min() < 1 or (table[:, :2] % 1.0).any()):
        raise wanted.error("rows and columns must be whole numbers from 1")
    largest = int(table[:, :2].max()) if len(table) else 0
    wanted.check_rows(largest)
    n = largest if n is None else n
    rows, columns = table[:, :2].T.astype(np.int64) - 1
    return from_coordinates(rows, columns, table[:, 2], (n, n), wanted)


def fixed_width(lines: list[bytes], width: int, n: int) -> np.ndarray | None:
    """Return the first ``n`` numbers of lines with fields of one width, without blanks between them.  Local.

    None if there are fewer numbers, or a field is not a number.
    """
    text = b"".join(line.rstrip(b"\r\n") for line in lines)
    if len(text) < n * width - width + 1 or n == 0:
        return np.empty(0) if n == 0 else None
    fields = np.frombuffer(text[: n * width].ljust(n * width), dtype=f"S{width}")
    fields = np.char.replace(np.char.replace(fields, b"D", b"E"), b"d", b"e")
    try:
        return fields.astype(float)
    except ValueError:
        return None


def fortran_format(text: str) -> tuple[int, int] | None:
    """Return numbers per line and width of a Fortran format, (16I5) or (1P,3E23.16); None for other texts.  Local."""
    match = re.search(r"(\d*)\s*[IEDFG]\s*(\d+)(?:\.\d+)?\s*\)?\s*$", text.strip().upper())
    per_line, width = (int(match[1] or 1), int(match[2])) if match else (0, 0)
    return (per_line, width) if 0 < width <= 64 and 0 < per_line * width <= _LONGEST else None
