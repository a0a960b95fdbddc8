"""A table for the screen: drawn by rich, or plain text without rich."""

import io
from collections.abc import Collection, Sequence

_WIDTH = 200  # characters


def screen_table(
    title: str,
    head: Sequence[str],
    rows: Sequence[tuple[object, Sequence[str]]],
    *,
    left: Collection[str] = (),
    wraps: Collection[str] = (),
    close: bool = False,
) -> str:
    """Return rows of cells as a table.  Local.

    Parameters
    ----------
    rows : group and cells of each row; a line is drawn where the group changes
    left, wraps : headings of left-aligned columns, and of columns that may wrap
    close : no space between the columns
    """
    try:
        from rich.console import Console
        from rich.table import Table
    except ImportError:
        return "\n".join("  ".join(line) for line in [head, *(cells for _, cells in rows)])
    table = Table(title=title, padding=(0, 0) if close else (0, 1))
    for name in head:
        table.add_column(name, justify="left" if name in left else "right", no_wrap=name not in wraps)
    for (group, cells), (following, _) in zip(rows, [*rows[1:], (None, ())]):
        table.add_row(*cells, end_section=following != group)
    text = io.StringIO()
    Console(file=text, width=_WIDTH).print(table)
    return text.getvalue().rstrip()
