"""Measured tables in the pages of the documentation.

A page in docs/ holds its prose.  A script writes only the text between the markers of a table:

    <!-- table: NAME -->
    ...
    <!-- end -->

If the page does not exist (another scene, or the copy without pages in which jobs/docs/reproduce.py runs commands), a page with
only the tables is written.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

MARKED = re.compile(r"(<!-- table: (\S+) -->\n).*?(<!-- end -->)", flags=re.DOTALL)


def put(page: Path, tables: Mapping[str, Sequence[str]]) -> None:
    """Write tables, lists or pictures (lines of Markdown by name) between their markers of a page.  Local.

    Raises
    ------
    ValueError : the page has no markers of one of the names; nothing is written then
    """
    if page.exists():
        text = page.read_text(encoding="utf-8")
        missing = sorted(set(tables) - {name for _, name, _ in MARKED.findall(text)})
        if missing:
            raise ValueError(
                f"{page} has no markers <!-- table: {missing[0]} --> ... <!-- end --> (missing: {', '.join(missing)})"
            )
    else:
        page.parent.mkdir(parents=True, exist_ok=True)
        text = f"# {page.stem}\n\n" + "\n\n".join(f"<!-- table: {name} -->\n<!-- end -->" for name in tables) + "\n"
    page.write_text(MARKED.sub(lambda match: filled(match, tables), text), encoding="utf-8")


def filled(match: re.Match[str], tables: Mapping[str, Sequence[str]]) -> str:
    """Return a marked part with its table, or unchanged if the table was not measured."""
    begin, name, end = match.groups()
    if name not in tables:
        return match[0]
    body = "\n".join(tables[name]).strip("\n")
    return f"{begin}\n{body}\n\n{end}"


def table(titles: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> list[str]:
    """Return a Markdown table; the first ``words`` columns are aligned left, the numbers right."""
    ruler = ["---"] * words + ["---:"] * (len(titles) - words)
    return ["| " + " | ".join(cells) + " |" for cells in (titles, ruler, *rows)]


# -- numbers ------------------------------------------------------------------------------------------------------------


def percent(share: float) -> str:
    """Return a share in per cent; one below 1e-5 as it is."""
    if share >= 0.1:
        return f"{100.0 * share:.0f} %"
    return f"{100.0 * share:.2g} %" if share >= 1e-5 or share == 0.0 else f"{share:.0e}"


def small(value: float, form: str = ".1e") -> str:
    """Return a difference, which may be exactly zero."""
    return f"{value:{form}}" if value else "0"


def times(ratio: float) -> str:
    """Return a ratio to two digits."""
    return f"{float(f'{ratio:.2g}'):,.0f}x" if ratio >= 10.0 else f"{ratio:.2g}x"


def duration(seconds: float) -> str:
    """Return a time in the unit that suits it."""
    if seconds >= 3600.0:
        return f"{seconds / 3600.0:.3g} h"
    if seconds >= 120.0:
        return f"{seconds / 60.0:.3g} min"
    return f"{seconds:.3g} s" if seconds >= 0.1 else f"{1e3 * seconds:.3g} ms"
