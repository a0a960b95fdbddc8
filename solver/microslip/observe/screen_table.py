"""A table for the screen: drawn by rich, or plain text where a cluster's Python lacks it."""

from __future__ import annotations

import io
from collections.abc import Collection, Sequence


def screen_table(
    title: str,
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    groups: Sequence,
    *,
    left: Collection[str] = (),
    wraps: Collection[str] = (),
    width: int = 170,
    close: bool = False,
) -> str:
    """Return rows of cells as a table.  Local.

    Parameters
    ----------
    groups : of each row; a line is drawn where it changes
    left, wraps : headings of the columns that are aligned left, and that may take several lines
    width : characters
    close : no space between the columns
    """
    try:
        from rich.console import Console
        from rich.table import Table
    except ImportError:
        return "\n".join("  ".join(line) for line in [head, *rows])
    table = Table(title=title, padding=(0, 0) if close else (0, 1))
    for name in head:
        table.add_column(name, justify="left" if name in left else "right", no_wrap=name not in wraps)
    for line, group, following in zip(rows, groups, [*groups[1:], None]):
        table.add_row(*line, end_section=following != group)
    text = io.StringIO()
    Console(file=text, width=width).print(table)
    return text.getvalue().rstrip()
