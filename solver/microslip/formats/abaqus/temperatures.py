"""Temperatures at which the structure vibrates: what they make of materials, and what they load."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...messages.errors import MeshError
from ...tables.constant_loads import Temperature
from ...tables.structure import Body, Material
from .cards import Card, number
from .elastic import keys_of
from .input_model import InputModel, Table
from .scopes import Scope

Ends = tuple[float | None, float | None]  # temperature of a body at first and in the vibration, None where it differs within it
_SAME = 1e-9  # temperatures of one body that differ by less, of the largest, are one
_FIRST_ALONE = "values depend on the temperature or on fields; those of the first line would be taken"


def temperatures_of(model: InputModel, scope: Scope, card: Card) -> dict[int, float]:
    """Return what the data lines of a card give to nodes, by node.

    Raises
    ------
    MeshError : sets that there are not, words where numbers are due
    """
    temperatures: dict[int, float] = {}
    for words, where in card.lines():
        value = number(words[1]) if len(words) > 1 else None
        if value is None:
            raise MeshError(f"{where}: *{card.keyword} holds {','.join(words)[:60]!r} where a temperature is due")
        temperatures.update(dict.fromkeys(model.mesh.nodes(scope, words[0], where).tolist(), value))
    return temperatures


def take_temperatures(model: InputModel, at_rest: dict[int, float] | None, where: str) -> None:
    """Give materials their values at the temperature of their bodies, and the statics what is warmer than at first.

    ``at_rest`` has the temperatures that static steps end with, by node, stated at ``where``; None: the file changes them in a
    way that is not followed. Materials whose values depend on a temperature that no card states, or that differs within a body,
    are among the findings.

    Raises
    ------
    MeshError : as :func:`temperatures_of`
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
    """Return the one temperature of a body, None where its nodes differ."""
    group = model.grouped.groups[body.group]
    at_nodes = np.concatenate([values[model.grouped.cells[i].nodes[rows].ravel()] for i, rows in group.cells.items()])
    return float(at_nodes[0]) if np.ptp(at_nodes) <= _SAME * np.abs(at_nodes).max() else None


def _materials_at_temperature(model: InputModel, ends: dict[str, Ends]) -> None:
    """Replace materials that depend on the temperature by what they are in each body, cold at first and warm in the vibration."""
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
    """Return a material at a temperature, between the rows of its tables and constant beyond them.

    An expansion counts from the zero of its table; its value becomes the mean expansion per degree from ``initial`` to ``final``.
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
    """Add to the statics by how much bodies that expand are warmer than at first."""
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
