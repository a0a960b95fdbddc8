"""Tables of numbers from CSV files: a header with the names of the columns, then one line of numbers per entry.  Local."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..messages.errors import CaseError
from ..messages.words import hint
from ..system.files import refuse_devices


def read_table(
    path: Path, needed: Sequence[str], optional: Sequence[str] = (), what: str = "entry"
) -> tuple[dict[str, np.ndarray], list[int]]:
    """Return the columns of a file by name, (n,) each, and the line number of each entry.

    The first line names the columns, in any order and case; empty lines and lines that begin with # are ignored.

    Raises
    ------
    CaseError : with the number of the faulty line
    """
    numbered = numbered_rows(path)
    columns = " and may name ".join(",".join(names) for names in (needed, optional) if names)
    columns = f"the columns {columns}" if needed else f"some of the columns {columns}"
    if not numbered:
        raise CaseError(f"{path}: the file is empty; its first line names {columns}")
    (line, header), *rest = numbered
    header = [cell.lower() for cell in header]
    _check_header(header, needed, optional, f"{path}, line {line}: the header must name {columns}")
    if not rest:
        raise CaseError(f"{path}: there is no {what} after the header")
    values = np.array([_numbers(row, header, f"{path}, line {line}") for line, row in rest])
    return dict(zip(header, values.T)), [line for line, _ in rest]


def numbered_rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return the cells of all lines but empty lines and comments, with the line numbers from 1.

    Raises
    ------
    CaseError : the file does not exist or is not a text file of comma-separated values
    """
    refuse_devices(path)
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (UnicodeDecodeError, csv.Error) as problem:
        raise CaseError(f"{path}: not a text file of comma-separated values: {problem}") from None
    except OSError as problem:
        raise CaseError(f"{path}: {problem.strerror}") from None
    return [(line, row) for line, row in rows if any(row) and not row[0].startswith("#")]


def _check_header(header: list[str], needed: Sequence[str], optional: Sequence[str], message: str) -> None:
    known = [*needed, *optional]
    faults = [f"{name} is missing" for name in needed if name not in header]
    faults += [f"{name} appears twice" for name in known if header.count(name) > 1]
    for name in header:
        if name not in known:
            faults.append(f'"{name[:20]}" is unknown' + hint(name, known).replace(";", ",", 1))
    if ";" in header[0]:
        faults = ["values are separated by semicolons, not by commas"]
    if faults:
        raise CaseError(f"{message}: {'; '.join(faults[:3])}")


def _numbers(row: list[str], header: list[str], where: str) -> list[float]:
    if len(row) != len(header):
        raise CaseError(f"{where}: {len(row)} values; {len(header)} are needed: {','.join(header)}")
    values = []
    for name, cell in zip(header, row):
        try:
            values.append(float(cell))
        except ValueError:
            raise CaseError(f'{where}: {name} = "{cell[:20]}" is not a number') from None
        if not np.isfinite(values[-1]):
            raise CaseError(f"{where}: {name} = {cell} is not a finite number")
    return values
