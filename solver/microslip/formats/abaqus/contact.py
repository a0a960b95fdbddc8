"""Surfaces in contact: *CONTACT PAIR with the stiffness and friction of its *SURFACE INTERACTION."""

from dataclasses import dataclass, field, replace

import numpy as np

from ...messages.errors import MeshError
from ...messages.words import hint, listed
from ...tables.joint import Joint
from ..model import Finding
from .cards import Card, number
from .connections import plain, surface_of, tie
from .input_model import InputModel
from .scopes import Scope

_NUMERICAL = {"ELASTICSLIP", "LAGRANGE", "SLIPTOLERANCE", "SHEARTRACTIONSLOPE"}  # of *FRICTION, without effect here
_LARGER = 1.02  # area ratio above which a surface cannot lie entirely on the other
_PAIRING = {"SURFACETOSURFACE": "mortar", "NODETOSURFACE": "projected"}


@dataclass(frozen=True)
class _Interaction:
    """Properties of a contact in terms of a joint, and the reasons for the missing ones."""

    has: dict[str, float] = field(default_factory=dict)  # key of a joint: its value; stiffnesses in force per volume
    lacks: dict[str, str] = field(default_factory=dict)  # key of a joint: why its value is unknown
    is_glued: bool = False


def take_contact(model: InputModel) -> None:
    """Take pairs of surfaces in contact: a finding for each, and a joint if the file states all its values.

    Raises
    ------
    MeshError : surfaces, interactions or sets that there are not, words in place of numbers
    """
    interactions = _interactions(model)
    for scope, card in model.cards:
        if card.keyword != "CONTACT PAIR":
            continue
        for words, where in card.lines():
            if "TIED" in card.parameters and len(words) > 1 and words[1]:
                tie(model, scope, words, where, card)
            elif len(words) < 2 or not words[1]:
                model.findings.add("*CONTACT PAIR", where, f"{words[0]} in contact with itself", True)
            else:
                _take_pair(model, scope, card, words, where, _interaction_of(card, interactions))


def _interaction_of(card: Card, interactions: dict[str, _Interaction]) -> _Interaction:
    """Return the interaction named by the card of a pair."""
    name = card.parameter("INTERACTION")
    if name in interactions:
        return interactions[name]
    if name:
        stated, near = card.parameters["INTERACTION"], hint(name, interactions, repr)
        raise MeshError(f"{card.where}: *CONTACT PAIR: there is no *SURFACE INTERACTION, NAME={stated}{near}")
    return _Interaction(lacks=dict.fromkeys(_KEYS, f"{card.where}: no INTERACTION"))


_KEYS = ("friction", "tangential_stiffness", "normal_stiffness")


def _interactions(model: InputModel) -> dict[str, _Interaction]:
    """Return all interactions by their names in upper case."""
    interactions: dict[str, _Interaction] = {}
    name = ""
    for _, card in model.cards:
        if card.keyword == "SURFACE INTERACTION":
            name = card.parameter("NAME")
            lacks = {"tangential_stiffness": "no *FRICTION", "normal_stiffness": "hard contact"}
            interactions[name] = _Interaction({"friction": 0.0}, {key: f"{card.where}: {why}" for key, why in lacks.items()})
        elif card.keyword == "SURFACE BEHAVIOR" and name in interactions:
            interactions[name] = _with_normal_behaviour(interactions[name], card)
        elif card.keyword == "FRICTION" and name in interactions:
            interactions[name] = _with_friction(interactions[name], card)
    for card in (card for step in model.steps_until for _, card in step.cards):
        changed = interactions.get(card.parameter("INTERACTION")) if card.keyword == "CHANGE FRICTION" else None
        if changed is not None:
            interactions[card.parameter("INTERACTION")] = _lacking(changed, friction=f"{card.where}: *CHANGE FRICTION")
    return interactions


def _lacking(interaction: _Interaction, **why: str) -> _Interaction:
    """Return an interaction with some keys unknown, and the reasons."""
    has = {key: value for key, value in interaction.has.items() if key not in why}
    return replace(interaction, has=has, lacks={**interaction.lacks, **why})


def _having(interaction: _Interaction, **values: float) -> _Interaction:
    """Return an interaction with the values of some keys."""
    lacks = {key: why for key, why in interaction.lacks.items() if key not in values}
    return replace(interaction, has={**interaction.has, **values}, lacks=lacks)


def _with_normal_behaviour(interaction: _Interaction, card: Card) -> _Interaction:
    """Return an interaction with the pressure-overclosure relation of a *SURFACE BEHAVIOR."""
    law = card.parameter("PRESSURE-OVERCLOSURE") or "HARD"
    words, where = next(card.lines(), ([""], card.where))
    if "NOSEPARATION" in card.parameters:
        return _lacking(interaction, normal_stiffness=f"{card.where}: contact that never opens")
    if law == "LINEAR" and words[0]:
        slope = _number(words, 0, where, card)
        if slope > 0.0:
            return _having(interaction, normal_stiffness=slope)
        return _lacking(interaction, normal_stiffness=f"{where}: a slope of {words[0]}")
    why = {
        "LINEAR": "a slope that is not stated",
        "HARD": "hard contact",
        "EXPONENTIAL": 'a pressure that grows exponentially, as of law = "rough"',
        "TABULAR": "a table of pressures",
        "TIED": "springs that also act in tension",
    }.get(law, f"PRESSURE-OVERCLOSURE={law}, which this program does not have")
    return replace(_lacking(interaction, normal_stiffness=f"{card.where}: {why}"), is_glued=law == "TIED")


def _with_friction(interaction: _Interaction, card: Card) -> _Interaction:
    """Return an interaction with the coefficient and the stick slope of a *FRICTION."""
    lines = list(card.lines())
    special = [name for name in card.parameters if name not in _NUMERICAL]
    if special or len(lines) != 1:
        why = f"*FRICTION, {special[0]}" if special else f"{len(lines)} lines of coefficients"
        return _lacking(interaction, friction=f"{card.where}: {why}", tangential_stiffness=f"{card.where}: no stick slope")
    words, where = lines[0]
    friction = _number(words, 0, where, card)
    if friction < 0.0:
        raise MeshError(f"{where}: *FRICTION: the coefficient is {words[0]}, below 0")
    interaction = _having(interaction, friction=friction)
    slope = card.parameters.get("SHEARTRACTIONSLOPE") or (words[1] if len(words) > 1 else "")
    stiffness = _number([slope], 0, where, card) if slope else 0.0
    if stiffness > 0.0:
        return _having(interaction, tangential_stiffness=stiffness)
    return _lacking(interaction, tangential_stiffness=f"{where}: no stick slope")


def _number(words: list[str], i: int, where: str, card: Card) -> float:
    value = number(words[i])
    if value is None:
        raise MeshError(f"{where}: *{card.keyword} holds {words[i][:60]!r} where a number is expected")
    return value


def _take_pair(model: InputModel, scope: Scope, card: Card, words: list[str], where: str, interaction: _Interaction) -> None:
    """Add a finding of two surfaces in contact, and their joint with the values of the file."""
    surfaces = _smaller_first(model, surface_of(model, scope, words[0], where), surface_of(model, scope, words[1], where))
    lacks = {**interaction.lacks, **_gap(model, card, surfaces)}
    within = number(card.parameters.get("ADJUST", "")) or None  # surfaces within this distance touch
    model.joints.append(
        Joint.of_file(
            name=plain("_".join(surfaces).replace(" ", "_")),
            surfaces=surfaces,
            pairing=_PAIRING.get("".join(card.parameter("TYPE").split()), "auto"),
            **interaction.has,
            preload="static",
            tolerance=within,
            gap=None if "gap" in lacks else 0.0 if within else "geometry",
        )
    )
    friction = f", friction {interaction.has['friction']:g}" if "friction" in interaction.has else ""
    replacement = (
        "a joint that [statics] presses, of the file or the scene; without it state a joint between them, with its preload"
    )
    if lacks:
        keys = listed([f"{key} ({why})" for key, why in lacks.items()])
        replacement = f"a joint of the scene between them replaces it and has to state {keys}"
    effect = f"{surfaces[0]} and {surfaces[1]} in contact{friction}: {replacement}"
    finding = Finding(
        word="*CONTACT PAIR", where=where, effect=effect, changes=True, surfaces=surfaces, is_glued=interaction.is_glued
    )
    model.findings.take(finding)


def _smaller_first(model: InputModel, slave: str, master: str) -> tuple[str, str]:
    """Return two surfaces, first the one that can lie entirely on the other: the slave, unless it is larger."""
    areas = _area(model, slave), _area(model, master)
    return (master, slave) if areas[0] > _LARGER * areas[1] > 0.0 else (slave, master)


def _area(model: InputModel, surface: str) -> float:
    """Return the area of the faces of a surface, from their corners; 0 for a surface of nodes."""
    area, group = 0.0, model.grouped.groups.get(surface)
    for block, rows in group.cells.items() if group is not None else ():
        cells = model.grouped.cells[block]
        if cells.kind.startswith(("tri", "quad")):
            corners = model.mesh.points[cells.nodes[rows][:, : 3 + cells.kind.startswith("quad")]]
            first, second = corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]
            area += 0.5 * float(np.linalg.norm(np.cross(first, second), axis=1).sum())
    return area


def _gap(model: InputModel, card: Card, surfaces: tuple[str, str]) -> dict[str, str]:
    """Return why the gap between two surfaces differs from the mesh, if the file changes it in a way that a joint lacks."""
    adjusted = card.parameters.get("ADJUST", "")
    distance = number(adjusted)
    if adjusted and (distance is None or distance < 0.0):
        return {"gap": f"{card.where}: ADJUST={adjusted}"}
    for _, other in model.cards:
        named = {other.parameter(key) for key in ("MASTER", "SLAVE", "CPSET")} - {""}
        if other.keyword == "CLEARANCE" and named & {*(name.upper() for name in surfaces), card.parameter("CPSET")}:
            return {"gap": f"{other.where}: *CLEARANCE"}
    return {}
