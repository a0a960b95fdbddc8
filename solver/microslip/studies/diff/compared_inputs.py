"""Differences between the inputs of two results and the programs that computed them."""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...results.record import ResultFile
from ...scene.toml_text import value_text

NOT_STATED = "not stated"


@dataclass(frozen=True)
class Change:
    """A key or fact that differs between two results."""

    key: str
    a: str
    b: str


def keys_changed(a: ResultFile, b: ResultFile) -> list[Change]:
    """Return the keys of the scene that differ, named as in ``--set``, in the order of the scenes.  Local."""
    try:
        scenes = [flattened(tomllib.loads(results.scene_text)) for results in (a, b)]
    except (tomllib.TOMLDecodeError, RecursionError):
        return [] if a.scene_text == b.scene_text else [Change("the text of the scene", "one text", "another, or no TOML")]
    return _changed(*scenes)


def flattened(tables: Mapping[str, Any], before: str = "") -> dict[str, str]:
    """Return the values of a scene as texts by key: ``joints.dovetail.friction``; entries by name, or number from 1."""
    values: dict[str, str] = {}
    for key, value in tables.items():
        name = before + (key if "." not in key else json.dumps(key))
        if isinstance(value, Mapping):
            values |= flattened(value, f"{name}.")
        elif isinstance(value, list) and value and all(isinstance(entry, Mapping) for entry in value):
            names = [entry.get("name") for entry in value]
            by_name = all(isinstance(name, str) for name in names) and len(set(names)) == len(names)
            for number, entry in enumerate(value, 1):
                values |= flattened(entry, f"{name}.{entry['name'] if by_name else number}.")
        else:
            values[name] = value_text(_frozen(value))
    return values


def _frozen(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(map(_frozen, value))
    if isinstance(value, Mapping):
        return json.dumps(value, default=str)
    return value if isinstance(value, bool | int | float | str) else str(value)


def _changed(a: Mapping[str, str], b: Mapping[str, str]) -> list[Change]:
    keys = [*a, *(key for key in b if key not in a)]
    return [Change(key, a.get(key, NOT_STATED), b.get(key, NOT_STATED)) for key in keys if a.get(key) != b.get(key)]


def facts_changed(a: ResultFile, b: ResultFile) -> list[Change]:
    """Return the other differences that affect a run: options, versions, ranks and groups, threads, hosts.  Local."""
    return _changed(_facts(a), _facts(b))


def _facts(results: ResultFile) -> dict[str, str]:
    facts = {"method": results.method, "PETSc options": " ".join(results.options) or "none"}
    facts |= {f"version of {name}": version for name, version in results.versions.items()}
    origin = results.origin
    if origin is None:
        return facts
    facts |= {"ranks": str(origin.n_ranks), "groups": str(origin.n_groups), "hosts": ", ".join(sorted(set(origin.hosts)))}
    return facts | origin.environment


def inputs_changed(a: ResultFile, b: ResultFile) -> list[Change] | None:
    """Return the input files with different contents; None if a result does not list its input files.  Local."""
    if a.origin is None or b.origin is None:
        return None
    return _changed(*(dict(_inputs(results)) for results in (a, b)))


def _inputs(results: ResultFile) -> list[tuple[str, str]]:
    entries = []
    for entry in results.origin.inputs:
        name = f"{entry.key}, {Path(entry.path).name}" if entry.key.startswith(("included", "beside")) else entry.key
        entries.append((name, f"{entry.size} bytes, SHA-256 {entry.sha256[:12]}\u2026"))
    return entries
