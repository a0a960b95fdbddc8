"""*EQUATION: linear equations between displacements, in the axes of the nodes."""

import numpy as np

from ...messages.errors import MeshError
from ..draft import Term
from .cards import Card, number
from .input_model import InputModel, along_axis
from .scopes import Scope


def take_equations(model: InputModel) -> None:
    """Take linear equations, once all reference nodes are known.

    Raises
    ------
    MeshError : a truncated equation, or nodes that do not exist
    """
    for scope, card in model.cards:
        if card.keyword == "EQUATION":
            _take_equations(model, scope, card)
    for leader, node, where in model.coupled:
        if leader in model.points and node in model.points:
            arm = model.mesh.points[node] - model.mesh.points[leader]
            model.terms.follow_rigidly(model.points[node].name, model.points[leader].name, arm, where)


def _take_equations(model: InputModel, scope: Scope, card: Card) -> None:
    """Take linear equations; an equation between sets becomes one equation per node."""
    words: list[str] = []
    where_of: list[str] = []
    for line, where in card.lines():
        fields = line[:-1] if not line[-1] else line
        words += fields
        where_of += [where] * len(fields)
    at = 0
    while at < len(words):
        where, count = where_of[at], words[at]
        n = int(count) if count.isdigit() else 0
        terms = words[at + 1 : at + 1 + 3 * n]
        if not 0 < n <= len(words) or len(terms) < 3 * n:
            raise MeshError(f"{where}: *EQUATION: expected a number of terms and a node, a direction and a coefficient for each")
        _add_equation(model, scope, terms, where)
        at += 1 + 3 * n


def _add_equation(model: InputModel, scope: Scope, words: list[str], where: str) -> None:
    parts: list[tuple[np.ndarray, int, float]] = []
    for name, dof, value in zip(words[::3], words[1::3], words[2::3], strict=True):
        coefficient = number(value)
        if not dof.isdigit() or coefficient is None:
            raise MeshError(
                f"{where}: *EQUATION holds {name}, {dof}, {value} where a node, a direction and a coefficient are expected"
            )
        parts.append((model.mesh.nodes(scope, name, where), int(dof), coefficient))
    n = max(len(nodes) for nodes, _, _ in parts)
    if any(len(nodes) not in (1, n) for nodes, _, _ in parts):
        raise MeshError(f"{where}: *EQUATION: its sets hold different numbers of nodes")
    if any(not _has(model, int(node), axis) for nodes, axis, _ in parts for node in nodes):
        effect = "an equation of quantities other than displacements and rotations of reference nodes"
        model.findings.add("*EQUATION", where, effect, True, "equations")
        return
    for i in range(n):
        terms: list[Term] = []
        for nodes, axis, factor in parts:
            terms += _term(model, int(nodes[min(i, len(nodes) - 1)]), axis, factor)
        model.terms.add(terms, f"*EQUATION, {where}")


def _has(model: InputModel, node: int, dof: int) -> bool:
    """Return whether a node has a degree of freedom, from 1; reference nodes also have rotations."""
    return 1 <= dof <= (6 if node in model.points else 3)


def _term(model: InputModel, node: int, dof: int, factor: float) -> list[Term]:
    """Return a degree of freedom of a node, from 1, times a factor, as terms; a reference node is replaced by its point."""
    turns, axis = divmod(dof - 1, 3)
    terms, leader = along_axis(model, node, axis + 1, factor), model.turns.get(node, node)
    if leader not in model.points:
        model.attached.add(node)
        return terms
    at, turns = model.terms.point(model.points[leader].name), turns or node in model.turns
    return [(at, i + 3 * turns, value) for _, i, value in terms]
