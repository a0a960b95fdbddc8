"""Temperatures of the vibrating structure: material values and thermal loads."""

from dataclasses import replace
from typing import Any

import numpy as np

from ...messages.errors import MeshError
from ...tables.constant_loads import Temperature
from ...tables.structure import Body, Material
from .cards import Card, number
from .input_model import InputModel, Table
from .properties import keys_of
from .scopes import Scope

Ends = tuple[float | None, float | None]  # temperatures of a body: initial, in vibration; None if not uniform
_SAME = 1e-9  # relative difference below which temperatures of a body are equal
_FIRST_ALONE = "values depend on the temperature or on fields; those of the first line would be taken"


def temperatures_of(model: InputModel, scope: Scope, card: Card) -> dict[int, float]:
    """Return the temperatures of a card, by node.  Raises MeshError: sets that do not exist, words in place of numbers."""
    temperatures: dict[int, float] = {}
    for words, where in card.lines():
        value = number(words[1]) if len(words) > 1 else None
        if value is None:
            raise MeshError(f"{where}: *{card.keyword} holds {','.join(words)[:60]!r} where a temperature is expected")
        temperatures.update(dict.fromkeys(model.mesh.nodes(scope, words[0], where).tolist(), value))
    return temperatures


def take_temperatures(model: InputModel, at_rest: dict[int, float] | None, where: str) -> None:
    """Evaluate materials at the temperature of their bodies, and add the temperature rises to the statics.

    ``at_rest``: temperatures at the end of the static steps, by node, stated at ``where``; None: the file changes them in an
    unsupported way. Temperature-dependent materials become findings if the temperature is not stated or not uniform in a body.

    Raises
    ------
    MeshError : as in :func:`temperatures_of`
    """
    given: dict[int, float] = {}
    for scope, card in model.cards:
        if card.keyword == "INITIAL CONDITIONS" and card.parameter("TYPE") == "TEMPERATURE" and set(card.parameters) == {"TYPE"}:
            given.update(temperatures_of(model, scope, card))
    initial = np.zeros(len(model.mesh.points))
    initial[list(given)] = list(given.values())
    final = initial.copy()
    final[list(at_rest or {})] = list((at_rest or {}).values())
    ends = {name: (_common(model, body, initial), _common(model, body, final)) for name, body in model.bodies.items()}
    is_known = at_rest is not None and bool(given or at_rest)
    _materials_at_temperature(model, ends if is_known else dict.fromkeys(ends, (None, None)))
    if at_rest:
        _temperature_rises(model, ends, where)


def _common(model: InputModel, body: Body, values: np.ndarray) -> float | None:
    """Return the temperature of a body, or None if it is not uniform."""
    group = model.grouped.groups[body.group]
    at_nodes = np.concatenate([values[model.grouped.cells[i].nodes[rows].ravel()] for i, rows in group.cells.items()])
    return float(at_nodes[0]) if np.ptp(at_nodes) <= _SAME * np.abs(at_nodes).max() else None


def _materials_at_temperature(model: InputModel, ends: dict[str, Ends]) -> None:
    """Replace temperature-dependent materials by their values in each body, initial and in the vibration."""
    for name, tables in model.tables.items():
        bodies = {key: ends[key] for key, body in model.bodies.items() if body.material == name}
        states = {(initial, final) for initial, final in bodies.values() if initial is not None and final is not None}
        if not bodies or len(states) < len(set(bodies.values())) or not all(table.is_of_temperature for table in tables):
            for table in tables:
                model.findings.add(f"*{table.keyword}", table.where, f"material {name!r}: {_FIRST_ALONE}", True, "materials")
            continue
        plain = model.materials.pop(name)
        for key, (initial, final) in bodies.items():
            assert initial is not None and final is not None, "a body of one temperature"
            named = name if len(states) == 1 else f"{name} {key}"
            model.materials[named] = _at(plain, tables, initial, final)
            model.bodies[key] = model.bodies[key].with_keys(material=named)


def _at(material: Material, tables: list[Table], initial: float, final: float) -> Material:
    """Return a material at a temperature, interpolated in its tables and constant beyond them.

    Expansions refer to the zero of their table; the result is the mean expansion per degree from ``initial`` to ``final``.
    """
    changed: dict[str, Any] = {}
    for table in tables:
        values = table.at(final)
        if table.keyword == "EXPANSION" and final != initial:
            strain = values * (final - table.zero) - table.at(initial) * (initial - table.zero)
            values = strain / (final - initial)
        changed.update(keys_of(table.keyword, table.kind, values.tolist()))
    return material.with_keys(**changed)


def _temperature_rises(model: InputModel, ends: dict[str, Ends], where: str) -> None:
    """Add the temperature rises of bodies with thermal expansion to the statics."""
    assert model.statics is not None, "a file with loads"
    temperatures = []
    for name, body in model.bodies.items():
        material = model.materials.get(body.material)
        initial, final = ends[name]
        if material is None or not material.expansion or (initial is not None and initial == final):
            continue
        if initial is None or final is None:
            effect = f"temperatures that differ within body {name!r} load the structure before it vibrates"
            model.findings.add("*TEMPERATURE", where, effect, True, "statics")
        else:
            temperatures.append(Temperature.of_file(group=body.group, temperature=final - initial))
    table = model.statics.table.with_keys(temperatures=tuple(temperatures))
    model.statics = replace(model.statics, table=table)
