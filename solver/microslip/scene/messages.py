"""Messages for pydantic's errors in a scene: table and key, stated value, expected value."""

import math
import types
import typing
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic_core import ErrorDetails

from ..messages.words import hint, listed, nearest
from ..tables.constant_loads import Bolt, Force, MovedSupport, Pressure, Temperature
from ..tables.cyclic import Scatter, SectorFactors
from ..tables.joint import Joint
from ..tables.structure import Body, Mass, Material, Orientation, Point, Spring, Support, Surface, Tie
from ..tables.table import Table
from ..tables.vibration import Load, Output
from .schema import Scene
from .solution import Method, Over

_NAMED: dict[str, type[Table]] = {"materials": Material, "orientations": Orientation, "bodies": Body}  # [materials.NAME]
_LISTED: dict[str, type[Table]] = {  # [[loads]]
    "supports": Support,
    "surfaces": Surface,
    "joints": Joint,
    "ties": Tie,
    "points": Point,
    "masses": Mass,
    "springs": Spring,
    "loads": Load,
    "outputs": Output,
}
_NESTED: dict[tuple[str, str], type[Table]] = {  # [[statics.forces]]
    ("statics", "forces"): Force,
    ("statics", "pressures"): Pressure,
    ("statics", "temperatures"): Temperature,
    ("statics", "bolts"): Bolt,
    ("statics", "displacements"): MovedSupport,
    ("cyclic", "sector"): SectorFactors,
    ("response", "over"): Over,
}
_INLINE: dict[tuple[str, str], type[Table]] = {("cyclic", "scatter"): Scatter}  # [cyclic] scatter = { ... }
_LONGEST = 60  # characters of a value that a message shows


def in_words(problems: Iterable[ErrorDetails], raw: Mapping[str, Any]) -> list[str]:
    """Return one text per mistake, unknown keys first.  Local.

    A misspelled key counts as one mistake, and so does a value that matches none of several types.
    """
    problems = _without_followers(list(problems))
    unknown = [problem["loc"] for problem in problems if problem["type"] == "extra_forbidden"]
    meant = {(*loc[:-1], nearest(str(loc[-1]), _model(loc[:-1]).model_fields)) for loc in unknown}
    texts: dict[str, None] = {}
    for problem in sorted(problems, key=lambda problem: problem["type"] != "extra_forbidden"):
        if problem["type"] != "missing" or problem["loc"] not in meant:
            texts[_in_words(problem, raw)] = None
    return list(texts)


def _without_followers(problems: list[ErrorDetails]) -> list[ErrorDetails]:
    """Leave out consequential errors: a list that is too short because of a wrong entry."""
    locs = [problem["loc"] for problem in problems]
    return [
        problem
        for problem in problems
        if problem["type"] != "too_short" or not any(loc[: len(problem["loc"])] == problem["loc"] != loc for loc in locs)
    ]


def _in_words(problem: ErrorDetails, raw: Mapping[str, Any]) -> str:
    loc = problem["loc"]
    if problem["type"] == "extra_forbidden":
        return _unknown(loc, raw)
    n_table = _depth(loc)
    where, key = _header(loc[:n_table], raw), loc[n_table] if len(loc) > n_table else None
    if key is None and problem["type"] == "value_error":
        return f"{where}: {problem['ctx']['error']}"
    expected = _expected(loc)
    if problem["type"] == "missing" and len(loc) <= n_table + 1:
        return f"{_join(where, key)} is missing: expected {expected}"
    value = raw
    for step in loc[: n_table + 1]:
        value = value[step]  # type: ignore[index]
    hint = _hint(loc, value)
    if problem["type"] == "less_than_equal" and "at most" not in expected:
        hint += f"; at most {problem['ctx']['le']:g}"
    return f"{_join(where, key)} = {shown(value)}: expected {expected}{hint}"


def _depth(loc: tuple[int | str, ...]) -> int:
    """Return the number of steps of ``loc`` that name the table of the key."""
    if not loc or len(loc) == 1 and _is_key(str(loc[0])):
        return 0
    if len(loc) > 2 and loc[:2] in _NESTED:
        return 3
    if len(loc) > 2 and loc[:2] in _INLINE:
        return 2
    return min(len(loc), 2 if loc[0] in _NAMED or loc[0] in _LISTED else 1)


def _is_key(name: str) -> bool:
    field = Scene.model_fields.get(name)
    return field is not None and field.annotation is str


def _model(table: tuple[int | str, ...]) -> type[Table]:
    """Return the model of a table."""
    if not table:
        return Scene
    name = str(table[0])
    if len(table) > 1 and table[:2] in _NESTED:
        return _NESTED[table[:2]]  # type: ignore[index]
    if len(table) > 1 and table[:2] in _INLINE:
        return _INLINE[table[:2]]  # type: ignore[index]
    if name in _NAMED or name in _LISTED:
        return {**_NAMED, **_LISTED}[name]
    return next(kind for kind in _alternatives(Scene.model_fields[name].annotation) if issubclass(kind, Table))


def _alternatives(annotation: Any) -> tuple:
    return typing.get_args(annotation) if isinstance(annotation, types.UnionType) else (annotation,)


def _header(table: tuple[int | str, ...], raw: Mapping[str, Any]) -> str:
    """Return the header of a table in the scene, numbered from 1 and with its name if it has one."""
    if not table:
        return ""
    name = str(table[0])
    if len(table) > 2 and table[:2] in _NESTED:
        return _entry(f"{name}.{table[1]}", int(table[2]), raw[name][table[1]])
    if len(table) > 1 and table[:2] in _INLINE:
        return f"[{name}] {table[1]}"
    if name in _NAMED:
        return f"[{name}.{table[1]}]" if len(table) > 1 else f"[{name}]"
    if name not in _LISTED:
        return f"[{name}]"
    if len(table) == 1:
        return f"[[{name}]]"
    return _entry(name, int(table[1]), raw[name])


def _entry(name: str, number: int, entries: Any) -> str:
    """Return the header of an entry of a list of tables."""
    entry = entries[number]
    stated = entry.get("name") if isinstance(entry, Mapping) else None
    return f"[[{name}]] {number + 1}" + (f' ("{stated}")' if isinstance(stated, str) and stated else "")


def _join(where: str, key: int | str | None) -> str:
    return f"{where} {key}" if where and key is not None else f"{where}{key if key is not None else ''}"


def _expected(loc: tuple[int | str, ...]) -> str:
    """Return the expected value of the key or table at ``loc`` as text."""
    n_table = _depth(loc)
    if len(loc) > n_table:
        return str(_model(loc[:n_table]).model_fields[str(loc[n_table])].description)
    if n_table >= 2:
        return f"a table with {listed(_model(loc).model_fields)}"
    return str(Scene.model_fields[str(loc[0])].description)


def _unknown(loc: tuple[int | str, ...], raw: Mapping[str, Any]) -> str:
    """Return the message for an unknown key, with similar keys."""
    key, table = str(loc[-1]), loc[:-1]
    if not table and isinstance(raw[key], Mapping | tuple):
        return _unknown_table(key, isinstance(raw[key], tuple))
    known = [name for name in _model(table).model_fields if table or _is_key(name)]
    near = nearest(key, known)
    places = [_any(name) for name in Scene.model_fields if not _is_key(name) and key in _model((name,)).model_fields]
    hints = [f'nearest is "{near}"'] if near else []
    hints += [f"{listed(places, 'or')} has a key of this name"] if places else []
    return f"{_join(_header(table, raw), key)}: unknown key; {', and '.join(hints) or 'known: ' + ', '.join(known)}"


def _unknown_table(name: str, is_list: bool) -> str:
    known = [known for known in Scene.model_fields if not _is_key(known)]
    near = nearest(name, known)
    hint = f"nearest is {_any(near)}" if near else f"known: {', '.join(map(_any, known))}"
    return f"{f'[[{name}]]' if is_list else f'[{name}]'}: unknown table; {hint}"


def _any(name: str) -> str:
    """Return the header of a kind of table."""
    return f"[{name}.NAME]" if name in _NAMED else f"[[{name}]]" if name in _LISTED else f"[{name}]"


def _hint(loc: tuple[int | str, ...], value: Any) -> str:
    """Return a further hint: the nearest word, the known methods, superfluous quotes."""
    numbers = value if isinstance(value, tuple) else (value,)
    if any(isinstance(number, float) and not math.isfinite(number) for number in numbers):
        return "; nan and inf are not numbers here"
    field = loc[_depth(loc)] if len(loc) > _depth(loc) else None
    if loc[0] in _NAMED and field is None and len(loc) == 2 and loc[1] in _model(loc).model_fields:
        return f"; keys stand under a header [{loc[0]}.NAME]"
    annotation = _model(loc[: _depth(loc)]).model_fields[str(field)].annotation if field is not None else None
    words = _words(annotation)
    if words and isinstance(value, str):
        known = f"; known: {', '.join(words)}" if annotation is Method else ""
        return hint(value, words) + known
    if isinstance(value, str) and _is_number(value) and not words:
        return "; without quotes"
    return ""


def _words(annotation: Any) -> tuple[str, ...]:
    """Return the accepted words of a key; empty if not limited."""
    words: tuple[str, ...] = ()
    for kind in _alternatives(annotation):
        if typing.get_origin(kind) is typing.Literal:
            words += typing.get_args(kind)
    return words


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def shown(value: Any) -> str:
    """Return a value in the form of a scene file, shortened.  Local."""
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, tuple) and any(isinstance(entry, Mapping) for entry in value):
        return "a list of tables"
    text = _toml(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 4] + " ..."


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        short = f"{value:g}"
        return short if "e" in short and float(short) == value else str(value)
    return f'"{value}"'.replace("\n", "\\n") if isinstance(value, str) else str(value)
