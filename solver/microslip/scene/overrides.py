"""Keys of a scene that the command line sets: ``--set joints.dovetail.friction=0.2``."""

import re
import tomllib
from collections.abc import Iterable, Mapping
from typing import Any

from ..messages.errors import CaseError
from ..messages.words import hint, listed

_WORD = re.compile(r"(\.{0,2}/)*[A-Za-z_][\w./-]*")  # a text whose quotes the shell has removed: a word or a path


def overridden(tables: Mapping[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """Return a scene's tables with keys replaced by ``settings``, each a text KEY=VALUE; the last one applies.  Local.

    KEY has the tables, then the key, separated by dots; an entry of a list has its ``name``, or its number from 1.  The schema
    checks key and value.

    Raises
    ------
    CaseError : a text that is not KEY=VALUE, or an entry of a list that does not exist
    """
    tables = dict(tables)
    for text in settings:
        words, value = _parsed(text)
        tables = _placed(tables, words, value, f"--set {text}")
    return tables


def _parsed(text: str) -> tuple[list[str], Any]:
    """Return the words of the key and the TOML value; quotes may be omitted around a word or a path."""
    key, _, value = text.partition("=")
    plain = value.strip()
    if _WORD.fullmatch(plain) and plain not in ("true", "false", "inf", "nan"):
        value = f'"{plain}"'
    words = words_of(key)
    try:
        values = tomllib.loads(f"value = {value}")
    except tomllib.TOMLDecodeError:
        values = {}
    if not words or list(values) != ["value"]:
        raise CaseError(
            f"--set {text}: expected KEY=VALUE with a value as in a scene file, as --set joints.dovetail.friction=0.2 "
            "or --set 'response.levels=[5.0, 10.0]'"
        )
    return words, values["value"]


def words_of(key: str) -> list[str]:
    """Return the words of a dotted key as TOML reads it; none where it is no key.  Local."""
    try:
        keys: Any = tomllib.loads(f"{key} = 0")
    except tomllib.TOMLDecodeError:
        return []
    words = []
    while isinstance(keys, dict) and len(keys) == 1:
        ((word, keys),) = keys.items()
        words.append(word)
    return words if keys == 0 else []


def _placed(table: Mapping[str, Any], words: list[str], value: Any, where: str) -> dict[str, Any]:
    """Return a table with a value at the key ``words``; missing tables are created."""
    first, *rest = words
    if not rest:
        return {**table, first: value}
    inner = table.get(first, {})
    if isinstance(inner, tuple):
        number, rest = _entry(first, inner, rest, where)
        inner = tuple(_placed(entry, rest, value, where) if i == number else entry for i, entry in enumerate(inner))
        return {**table, first: inner}
    if not isinstance(inner, Mapping):
        raise CaseError(f"{where}: {first} is a key, not a table")
    return {**table, first: _placed(inner, rest, value, where)}


def _entry(table: str, entries: tuple, words: list[str], where: str) -> tuple[int, list[str]]:
    """Return the index of the entry that the first of ``words`` names, and the words after it."""
    word, *rest = words
    names = [entry.get("name") if isinstance(entry, Mapping) else None for entry in entries]
    if not all(isinstance(entry, Mapping) for entry in entries):
        raise CaseError(f"{where}: {table} is a key, not a table")
    if not rest:
        raise CaseError(f"{where}: of which [[{table}]]? Name it, as in {table}.{_words_for(names)[0]}.{word}")
    if word in names:
        return names.index(word), rest
    if word.isdecimal() and 1 <= int(word) <= len(entries):
        return int(word) - 1, rest
    near = hint(word, [name for name in names if isinstance(name, str)])
    there = near or f"; there {'is' if len(names) == 1 else 'are'} {listed(_words_for(names))}"
    raise CaseError(f'{where}: there is no [[{table}]] "{word}"{there}')


def _words_for(names: list) -> list[str]:
    """Return the word for each entry of a list of tables in a key: its name, or its number from 1."""
    return [name if isinstance(name, str) and name else str(number) for number, name in enumerate(names, 1)]
