"""A scene's tables as the text of a TOML file."""

import json
from collections.abc import Mapping
from typing import Any

from ..messages.errors import CaseError


def as_toml(tables: Mapping[str, Any]) -> str:
    """Return the TOML text of tables.  Local."""
    return "\n".join(_lines("", tables)) + "\n"


def _lines(header: str, table: Mapping[str, Any]) -> list[str]:
    """Return the lines of a table, its values before the tables in it."""
    tables = {name: value for name, value in table.items() if isinstance(value, Mapping) or _is_list_of_tables(value)}
    lines = [f"{key_text(name)} = {value_text(value)}" for name, value in table.items() if name not in tables]
    for name, value in tables.items():
        path = f"{header}.{key_text(name)}" if header else key_text(name)
        for entry in (value,) if isinstance(value, Mapping) else value:
            head = [f"[{path}]"] if isinstance(value, Mapping) else [f"[[{path}]]"]
            lines += ["", *head, *_lines(path, entry)]
    return lines


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, tuple) and len(value) > 0 and isinstance(value[0], Mapping)


def key_text(name: str) -> str:
    """Return a key in TOML syntax.  Local."""
    return name if name.isascii() and name.replace("_", "").replace("-", "").isalnum() else json.dumps(name)


def value_text(value: Any) -> str:
    """Return a value in TOML syntax.  Local."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, float):
        return repr(value)
    try:
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    except TypeError:
        raise CaseError(
            f"{value!r} is no value of a scene; expected a number, a text, true or false, a list or a table"
        ) from None
