"""*BOUNDARY and *TRANSFORM: supports in model axes or in axes of the nodes."""

import numpy as np

from ...messages.errors import MeshError
from ...tables.structure import Support
from ..draft import NAMES
from .cards import Card, number, values_of
from .input_model import InputModel, along_axis
from .nodes import axes_of
from .scopes import Scope

_NAMED = {
    "ENCASTRE": (1, 2, 3, 4, 5, 6),
    "PINNED": (1, 2, 3),
    "XSYMM": (1, 5, 6),
    "YSYMM": (2, 4, 6),
    "ZSYMM": (3, 4, 5),
    "XASYMM": (2, 3, 4),
    "YASYMM": (1, 3, 5),
    "ZASYMM": (1, 2, 6),
}


def take_transforms(model: InputModel) -> None:
    """Store the axes of nodes with *TRANSFORM.  Raises MeshError: points that do not define axes."""
    for scope, card in model.cards:
        if card.keyword != "TRANSFORM":
            continue
        rows = [values_of(",".join(words).encode()) for words, _ in card.lines()]
        values = np.concatenate([np.zeros(0), *(row if row is not None else np.zeros(0) for row in rows)])
        kind, name = card.parameter("TYPE", "R"), card.parameter("NSET")
        if len(values) < 6 or kind not in ("R", "C", "S"):
            raise MeshError(f"{card.where}: *TRANSFORM: expected TYPE=R, C or S and two points of three coordinates")
        nodes = model.mesh.nodes(scope, name, card.where)
        first, second = values[:3], values[3:6]
        if kind == "R":
            axes = np.broadcast_to(axes_of(first, second, card.where) @ scope.rotation.T, (len(nodes), 3, 3))
        else:
            first, second = scope.placed(np.stack([first, second]))
            axes = _round_axes(model.mesh.points[nodes], first, second, kind, card)
        model.axes.update(zip(nodes.tolist(), axes, strict=True))


def _round_axes(points: np.ndarray, first: np.ndarray, second: np.ndarray, kind: str, card: Card) -> np.ndarray:
    """Return radial, tangential and axial directions (n, 3, 3) at points, NaN on the axis; spherical axes about ``first``."""
    along = (second - first) / max(np.linalg.norm(second - first), 1e-300)
    radial = points - first
    if kind == "C":
        radial = radial - np.outer(radial @ along, along)
    size = np.linalg.norm(radial, axis=1)
    scale = max(float(size.max(initial=0.0)), 1e-300)
    if not np.linalg.norm(second - first) > 0.0:
        raise MeshError(f"{card.where}: *TRANSFORM, TYPE={kind}: its two points coincide")
    with np.errstate(invalid="ignore", divide="ignore"):  # NaN on the axis, where no direction is radial
        radial = np.where(size[:, None] > 1e-10 * scale, radial / size[:, None], np.nan)
    if kind == "C":
        return np.stack([radial, np.cross(along, radial), np.broadcast_to(along, radial.shape)], axis=1)
    tangent = np.cross(along, radial)
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        tangent = np.where(length > 1e-10, tangent / length, np.nan)
    return np.stack([radial, tangent, np.cross(radial, tangent)], axis=1)


_Fixed = dict[str, tuple[list[np.ndarray], set[int]]]  # by set or support: nodes, directions from 1


def take_supports(model: InputModel) -> None:
    """Take the supports of the chosen step: from the model data and the steps up to it."""
    fixed: _Fixed = {}
    loading = {card for step in model.steps_at_rest for _, card in step.cards}
    for scope, card in _boundaries(model):
        _take_card(model, scope, card, fixed, may_move=card in loading)
    for name, (nodes, dofs) in fixed.items():
        _hold(model, name, np.unique(np.concatenate(nodes)), dofs)


def _boundaries(model: InputModel) -> list[tuple[Scope, Card]]:
    """Return the *BOUNDARY cards in effect; OP = NEW on a card removes only the cards of earlier steps."""
    cards = [(scope, card) for scope, card in model.cards if card.keyword == "BOUNDARY"]
    for step in model.steps_until:
        of_step = [(scope, card) for scope, card in step.cards if card.keyword == "BOUNDARY"]
        if any(card.parameter("OP") == "NEW" for _, card in of_step):
            cards = []
        cards += of_step
    return cards


def _take_card(model: InputModel, scope: Scope, card: Card, fixed: _Fixed, *, may_move: bool) -> None:
    """Take the supports of a card; ``may_move``: its moved supports are handled in statics.py."""
    kind = card.parameter("TYPE", "DISPLACEMENT")
    for key in ("SUBMODEL", "USER", "BASENAME"):
        if key in card.parameters:
            model.findings.add(f"*BOUNDARY, {key}", card.where, "a support that moves", True, "supports")
            return
    for words, where in card.lines():
        dofs, value = fixed_dofs(words, where)
        if not dofs:  # 8 to 11: temperatures, potentials
            loads = bool(value) and any(material.expansion for material in model.materials.values())
            effect = f"a temperature, or another quantity than a displacement, of {words[0]}; state [[statics.temperatures]]"
            model.findings.add("*BOUNDARY", where, effect, loads, "supports")
            continue
        if (value or kind != "DISPLACEMENT") and not may_move:
            effect = f"a displacement other than 0 ({words[0]}); it would be taken as a support at rest"
            model.findings.add("*BOUNDARY", where, effect, True, "supports")
        nodes = model.mesh.nodes(scope, words[0], where)
        if words[0].isdigit():
            parts, known = fixed.setdefault("*BOUNDARY " + "".join(NAMES[dof - 1] for dof in sorted(dofs)), ([], set()))
        else:
            parts, known = fixed.setdefault(model.mesh.name_of(scope, words[0]), ([], set()))
        parts.append(nodes)
        known |= dofs


def fixed_dofs(words: list[str], where: str) -> tuple[set[int], float]:
    """Return the degrees of freedom, from 1, that a data line holds, and their displacement."""
    if len(words) > 1 and words[1].upper() in _NAMED:
        return set(_NAMED[words[1].upper()]), 0.0
    first, last, value = ([number(word) if word else None for word in words[1:4]] + [None] * 3)[:3]
    given = [bool(word) for word in (words[1:4] + [""] * 3)[:3]]
    if first is None or not 0 <= first <= 11 or (last is None and given[1]) or (value is None and given[2]):
        raise MeshError(
            f"{where}: *BOUNDARY holds {','.join(words)[:60]!r}; expected a node or a set and its first and last direction, "
            f"or one of {', '.join(_NAMED)}"
        )
    return {dof for dof in range(int(first), int(last or first) + 1) if 1 <= dof <= 6}, value or 0.0


def _hold(model: InputModel, name: str, nodes: np.ndarray, dofs: set[int]) -> None:
    """Support nodes: points by name, nodes with *TRANSFORM by equations, others as a group."""
    for node in nodes:
        if int(node) in model.points and dofs:
            fix = tuple(NAMES[dof - 1] for dof in sorted(dofs))
            model.supports.append(Support.of_file(point=model.points[int(node)].name, fix=fix))
        elif int(node) in model.turns and dofs & {1, 2, 3}:
            fix = tuple(NAMES[dof + 2] for dof in sorted(dofs) if dof <= 3)
            model.supports.append(Support.of_file(point=model.points[model.turns[int(node)]].name, fix=fix))
    dofs = {dof for dof in dofs if dof <= 3}
    if not dofs:
        return
    in_use = model.grouped.of_solids[nodes] | np.isin(nodes, list(model.attached))
    turned = np.isin(nodes, list(model.axes)) & (len(dofs) < 3) & in_use
    for node in nodes[turned]:
        for dof in sorted(dofs):
            model.terms.add(along_axis(model, int(node), dof, 1.0), f"*BOUNDARY {name} in axes of *TRANSFORM", True)
    straight = nodes if not turned.any() and in_use.any() else nodes[in_use & ~turned]
    if len(straight):
        group = model.grouped.node_group(name, straight)
        model.supports.append(Support.of_file(group=group, fix=tuple(NAMES[dof - 1] for dof in sorted(dofs))))
