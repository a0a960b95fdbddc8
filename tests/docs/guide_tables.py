"""The tables of docs/guide.md that follow from the declarations.

PYTHONPATH=solver python tests/docs/guide_tables.py docs/guide.md        writes them
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path

from microslip.points.bifurcation import BIFURCATION_QUANTITIES
from microslip.points.branch import QUANTITIES
from microslip.points.peak import PEAK_QUANTITIES
from microslip.points.quantities import Column, Quantity, axis_lengths
from microslip.results.record import JOINT_QUANTITIES
from microslip.results.sensitivities import COLUMNS as OF_SENSITIVITIES
from microslip.results.table import COLUMNS

SIZES = {"outputs": "n_output", "pairs": "n_pair", "coefficients": "2H+1"}  # the others have the same length in every file


def columns_table(columns: Iterable[Column] = COLUMNS) -> str:
    """Return the columns of a table, frf.csv by default; columns with the same meaning share a row."""
    rows = groupby(columns, key=lambda column: column.meaning)
    return _table(("column", "meaning"), ((", ".join(f"`{column.name}`" for column in same), meaning) for meaning, same in rows))


def datasets_table(quantities: Iterable[Quantity], *first: str) -> str:
    """Return the datasets of a group in results.h5, whose shape begins with ``first``."""
    rows = ((f"`{quantity.dataset}`", _shape(quantity, first), _content(quantity)) for quantity in quantities)
    return _table(("dataset", "shape", "content"), rows)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))


def _shape(quantity: Quantity, first: tuple[str, ...]) -> str:
    lengths = axis_lengths(0, 0, 0)
    return f"({', '.join([*first, *(SIZES.get(axis) or str(lengths[axis]) for axis in quantity.axes)])})"


def _content(quantity: Quantity) -> str:
    return (
        quantity.meaning
        if quantity.unit == "1" or quantity.meaning.startswith(quantity.unit)
        else f"{quantity.meaning}, {quantity.unit}"
    )


TABLES = {
    "frf.csv": columns_table(),
    "sensitivities.csv": columns_table(OF_SENSITIVITIES),
    "joint": datasets_table(JOINT_QUANTITIES),
    "levels": datasets_table(QUANTITIES, "n"),
    "peaks": datasets_table(PEAK_QUANTITIES, "n"),
    "bifurcations": datasets_table(BIFURCATION_QUANTITIES, "n"),
}


def with_tables(text: str) -> str:
    """Return the guide with each table between its two marks written again."""
    for name, table in TABLES.items():
        begin, end = f"<!-- {name}: from the declarations -->\n", f"<!-- {name}: end -->"
        before, rest = text.split(begin)
        text = f"{before}{begin}\n{table}\n\n{end}{rest.split(end)[1]}"
    return text


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(with_tables(path.read_text(encoding="utf-8")), encoding="utf-8")
