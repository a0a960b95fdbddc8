"""Read a scene file: text, TOML, schema, consistency, existence of files."""

import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from shlex import quote
from typing import Any

from pydantic import ValidationError

from ..messages.errors import CaseError
from ..messages.words import is_deeply_nested, shortened
from ..system.files import refuse_devices
from .checks import contradictions
from .inputs import absent, missing_files
from .messages import in_words
from .overrides import overridden
from .schema import Scene
from .toml_text import as_toml

_LARGEST_FILE = 10_000_000  # bytes
_LONGEST, _LONGEST_LIST = 1000, 4000  # characters of a mistake in a message, and of all of them
_TABLE = re.compile(r"\('(.*?)',?\)")  # name of a table in tomllib's errors


def read_scene(path: str | Path, settings: Sequence[str] = (), kind: type[Scene] = Scene) -> Scene:
    """Return the scene of a TOML file, checked without its mesh, as a scene of a ``kind``.

    Local.  ``settings``, texts KEY=VALUE, override keys of the file (:func:`.overrides.overridden`).

    Raises
    ------
    CaseError : one message with the file, and for each mistake table, key, stated and expected value
    """
    if not isinstance(path, (str, os.PathLike)):
        raise CaseError(f"read: expected the path of a scene, found {path!r}")
    path = Path(path)
    text = _text(path)
    tables = _tables(path, text)
    if not settings:
        return _checked(path, tables, text, kind=kind)
    raw = _frozen(overridden(tables, settings))
    return _checked(path, raw, as_toml(raw), settings=tuple(settings), kind=kind)


def scene_of(tables: Mapping[str, Any], path: str | Path = "scene.toml") -> Scene:
    """Return the scene of tables in the form of a scene file, checked without its mesh.  Local.

    ``path`` need not exist: it names the scene, and paths in the scene are relative to its folder.

    Raises
    ------
    CaseError : as in :func:`read_scene`
    """
    if not isinstance(tables, Mapping):
        raise CaseError(f"scene_of: expected the tables of a scene by name, found {type(tables).__name__}")
    raw = _frozen(dict(tables))
    return _checked(Path(path), raw, as_toml(raw))


def changed(
    scene: Scene, tables: Mapping[str, Mapping[str, Any]], joints: Mapping[str, Mapping[str, Any]] | None = None
) -> Scene:
    """Return a scene with changed keys of tables, and of joints by name; changed keys count as stated.  Local.

    None removes a key.

    Raises
    ------
    CaseError : as in :func:`read_scene`
    """
    raw = scene.model_dump(exclude_unset=True)
    for name, keys in tables.items():
        raw[name] = {key: value for key, value in {**(raw.get(name) or {}), **keys}.items() if value is not None}
    raw["joints"] = tuple({**joint, **(joints or {}).get(joint["name"], {})} for joint in raw.get("joints", ()))
    raw = _frozen(raw)
    return _checked(scene.path, raw, as_toml(raw), scene.is_complete, kind=type(scene))


def with_settings(scene: Scene, settings: Sequence[str]) -> Scene:
    """Return a scene with keys that ``settings`` set, texts KEY=VALUE as for :func:`read_scene`.  Local.

    Raises
    ------
    CaseError : as :func:`read_scene`
    """
    raw = _frozen(overridden(scene.model_dump(exclude_unset=True), settings))
    return _checked(scene.path, raw, as_toml(raw), scene.is_complete, (*scene.settings, *settings), type(scene))


def completed(scene: Scene, tables: Mapping[str, Any]) -> Scene:
    """Return a scene with some tables replaced, complete without further data of its model file.  Local.

    The text of the scene's file is retained.

    Raises
    ------
    CaseError : as in :func:`read_scene`
    """
    raw = {**scene.model_dump(exclude_unset=True), **_frozen(dict(tables))}
    return _checked(scene.path, raw, scene.text, True, scene.settings, type(scene))


def _checked(
    path: Path,
    raw: Mapping[str, Any],
    text: str,
    is_complete: bool = False,
    settings: tuple[str, ...] = (),
    kind: type[Scene] = Scene,
) -> Scene:
    """Return the scene from tables and their text."""
    command = " ".join([str(path), *(f"--set {setting}" for setting in settings)])
    try:
        context = {"path": path.absolute(), "text": text, "is_complete": is_complete, "settings": settings}
        scene = kind.model_validate(raw, context=context)
    except ValidationError as problem:
        _refuse(command, in_words(problem.errors(include_url=False), raw))
        raise AssertionError("a scene was refused without a reason") from problem
    for problems in (contradictions, missing_files):
        _refuse(command, problems(scene))
    return scene


def _refuse(command: str, problems: list[str]) -> None:
    """Raise CaseError with all problems of a scene, if there are any."""
    if len(problems) == 1:
        raise CaseError(f"{command}: {shortened(problems[0], _LONGEST)}") from None
    if problems:
        shown = [shortened(problem, _LONGEST) for problem in problems]
        n_shown = sum(length <= _LONGEST_LIST for length in accumulate(map(len, shown)))
        shown[n_shown:] = [f"and {len(problems) - n_shown} more"] * (n_shown < len(problems))
        raise CaseError("\n  ".join([f"{command}: {len(problems)} mistakes", *shown])) from None


def _text(path: Path) -> str:
    try:
        if path.is_dir():
            raise CaseError(f"{path} is a folder; a scene file is expected")
        if not path.exists():
            raise CaseError(f"{path}: {absent(path.absolute())}")
        refuse_devices(path)
        if path.stat().st_size > _LARGEST_FILE:
            raise CaseError(f"{path}: {path.stat().st_size / 1e6:.0f} MB are too much for a scene; a TOML file is expected")
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        cause = f"not a text file in UTF-8 (byte {problem.start}); a scene is a TOML file"
        raise CaseError(f"{path}: {cause}{_no_scene(path)}") from None
    except (OSError, ValueError) as problem:
        raise CaseError(f"{path}: {getattr(problem, 'strerror', None) or problem}") from None


def _tables(path: Path, text: str) -> dict[str, Any]:
    if is_deeply_nested(text):
        raise CaseError(f"{path}: not a scene: lists or tables are nested too deeply")
    try:
        return _frozen(tomllib.loads(text))
    except tomllib.TOMLDecodeError as problem:
        command = _TABLE.sub(lambda keys: f"[{keys[1]}]".replace("', '", "."), str(problem))
        raise CaseError(f"{path}: not valid TOML: {command}{_line(command, text)}{_no_scene(path)}") from None
    except ValueError as problem:  # a number of thousands of digits
        raise CaseError(f"{path}: not valid TOML: {problem}") from None
    except RecursionError:
        raise CaseError(f"{path}: not a scene: lists or tables are nested too deeply") from None


def _no_scene(path: Path) -> str:
    """Return a hint if the name of the file suggests another type, probably a model."""
    return "" if path.suffix.lower() in (".toml", "") else f"; for a model file, microslip new {quote(str(path))} writes a scene"


def _line(problem: str, text: str) -> str:
    """Return the line of a TOML error, for the message."""
    match = re.search(r"line (\d+)", problem)
    lines = text.splitlines()
    number = int(match[1]) if match else 0
    return f": {lines[number - 1].strip()[:80]}" if 0 < number <= len(lines) else ""


def _frozen(value: Any) -> Any:
    """Return values of TOML or NumPy with tuples in place of lists: a scene is immutable."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: _frozen(entry) for key, entry in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value
