"""Records of a study: a table of named columns, as a CSV file and as cells for the screen."""

import csv
from collections.abc import Iterable, Mapping
from typing import Any

from ..system.files import atomic_write

UNKNOWN = "\u2013"  # on the screen


def write_csv(
    path: str, columns: Iterable[str], records: Iterable[Mapping[str, Any]], digits: int = 9, unknown: str = "nan"
) -> None:
    """Write records to a CSV file, numbers with ``digits`` digits, ``unknown`` in place of NaN.  Local.

    Raises
    ------
    CaseError, ResourceError : the file cannot be written
    """
    with atomic_write(path) as unfinished, open(unfinished, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(columns), lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: cell(value, digits, unknown) for key, value in record.items()} for record in records)


def cell(value: Any, digits: int, unknown: str = UNKNOWN) -> str:
    """Return a cell: a float with ``digits`` digits, ``unknown`` for NaN, other values as text.  Local."""
    if not isinstance(value, float):
        return str(value)
    return unknown if value != value else f"{value:.{digits}g}"
