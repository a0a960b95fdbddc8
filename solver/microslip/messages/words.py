"""Text of messages: lists, similar names, coordinates."""

import difflib
import math
import re
from collections.abc import Callable, Iterable

_DEEP = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){50}""")  # a.a.a: read in a time quadratic in its length
_LONGEST = 200  # letters that are compared: names from files may be long


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word nearest to ``word``, ignoring case, or else the first that starts with it, or None.  Local."""
    by_lower = {name.lower()[:_LONGEST]: name for name in known}
    word = word.lower()[:_LONGEST]
    near = difflib.get_close_matches(word, by_lower, n=1)
    if not near and len(word) > 2:
        near = [name for name in by_lower if name.startswith(word)]
    return by_lower[near[0]] if near else None


def quoted(name: str) -> str:
    """Return a name in double quotes.  Local."""
    return f'"{name}"'


def hint(word: str, known: Iterable[str], shown: Callable[[str], str] = quoted) -> str:
    """Return "; nearest is NAME" for a message, NAME formatted by ``shown``; "" where no known word is near.  Local."""
    near = nearest(word, known)
    return f"; nearest is {shown(near)}" if near else ""


def listed(words: Iterable[str], last: str = "and") -> str:
    """Return "a, b and c".  Local."""
    *first, end = words
    return f"{', '.join(first)} {last} {end}" if first else end


def counted(n: int, noun: str) -> str:
    """Return "1 face", "2 faces", "3 bodies".  Local."""
    stem = noun[:-1] + "ie" if noun.endswith("y") else noun + "e" * noun.endswith(("x", "s", "ch"))
    return f"{n} {noun}" if n == 1 else f"{n} {stem}s"


def verb(n: int, plural: str) -> str:
    """Return the verb after a count: "are" or "is", "have" or "has", "follow" or "follows".  Local."""
    return plural if n != 1 else {"are": "is", "have": "has", "were": "was"}.get(plural, f"{plural}s")


def shortened(text: str, n_letters: int = 400) -> str:
    """Return a text that fits into a message.  Local."""
    return text if len(text) <= n_letters else f"{text[:n_letters]} ..."


def is_deeply_nested(text: str) -> bool:
    """Return whether the tables of a TOML file are nested deeper than any valid ones.  Local."""
    return _DEEP.search(text) is not None


def place(point: Iterable[float]) -> str:
    """Return a point as text for messages, with 0 for coordinates that are only roundoff.  Local."""
    values = tuple(point)
    least = 1e-12 * max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    return "(" + ", ".join(f"{0.0 if abs(value) <= least else value:.6g}" for value in values) + ")"


def rounded(value: float, digits: int = 3) -> str:
    """Return a number with few significant digits, below a million without a power of ten: 1030, not 1.03e+03.  Local."""
    return f"{float(f'{value:.{digits}g}'):g}"
