"""Point masses, springs and dampers: *MASS, *ROTARY INERTIA, *SPRING and *DASHPOT with their elements."""

from collections.abc import Iterator, Sequence

import numpy as np

from ...messages.errors import MeshError
from ...messages.words import counted
from ...tables.structure import Mass, Spring
from ..draft import grounded, vector
from .cards import Card, number
from .input_model import InputModel
from .scopes import Scope
from .types import OF_DISCRETE


def take_discrete(model: InputModel) -> None:
    """Take masses, springs and dampers; those on the reference node of a point become part of the point.

    Raises
    ------
    MeshError : properties that are not numbers, or elements that do not exist
    """
    has_card = np.zeros(len(model.grouped.block_of), dtype=bool)
    for scope, card in model.cards:
        if card.keyword in _TAKEN:
            elements = model.mesh.elements(scope, card.parameter("ELSET"), card.where)
            has_card[elements] = True
            _TAKEN[card.keyword](model, scope, card, elements)
    for first, block, nodes in model.mesh.blocks:
        n = np.count_nonzero(~has_card[first : first + len(nodes)])
        if n and (block.word in OF_DISCRETE):
            effect = f"{counted(n, 'element')} without *{OF_DISCRETE[block.word]}: their properties are missing"
            part = "masses" if block.word in ("MASS", "ROTARYI") else "springs"
            model.findings.add(f"*ELEMENT, TYPE={block.word}", block.where, effect, True, part)


def _numbers(card: Card, n: int, n_first: int = 0) -> np.ndarray:
    """Return the first ``n`` numbers of the data line after ``n_first`` lines of directions.

    Fields that are blank or missing are 0, as in Abaqus, but one of them must be a number.

    Raises
    ------
    MeshError : no such line, no number on it, or an entry that is not a finite number
    """
    lines = list(card.lines())[n_first:]
    words, where = lines[0] if lines else ([], card.where)
    values = [number(word) if word else 0.0 for word in words[:n]]
    if not any(words[:n]) or None in values:
        held = f", found {','.join(words)[:60]!r}" if any(words) else ""
        raise MeshError(f"{where}: *{card.keyword}: expected {counted(n, 'finite number')}{held}")
    return np.array([*values, *[0.0] * (n - len(values))], dtype=float)


def _take_mass(model: InputModel, scope: Scope, card: Card, elements: np.ndarray) -> None:
    """Take a mass at each node of some elements."""
    if "TYPE" in card.parameters and card.parameter("TYPE") not in ("ISOTROPIC", "ISO"):
        model.findings.add("*MASS, TYPE", card.where, "a mass that differs between directions", True, "masses")
        return
    mass = float(_numbers(card, 1)[0])
    nodes = model.mesh.nodes_of(elements)
    at_points = np.isin(nodes, list(model.points))
    for node in nodes[at_points]:
        point = model.points[int(node)]
        model.points[int(node)] = point.with_keys(mass=point.mass + mass)
    at_nodes = nodes[~at_points]
    if len(at_nodes) and mass:
        model.attached.update(at_nodes.tolist())
        name = model.mesh.name_of(scope, card.parameters.get("ELSET", "")) or "*MASS"
        model.masses.append(Mass.of_file(group=model.grouped.node_group(name, at_nodes), mass=mass))


def _take_inertia(model: InputModel, scope: Scope, card: Card, elements: np.ndarray) -> None:
    """Take moments of inertia of points: I11, I22, I33, I12, I13, I23; blanks are 0."""
    values = _numbers(card, 6)
    nodes = model.mesh.nodes_of(elements)
    inertia = tuple(float(values[i]) for i in (0, 1, 2, 3, 5, 4))
    for node in nodes:
        point = model.points.get(int(node))
        if point is None or point.inertia is not None or "ORIENTATION" in card.parameters:
            effect = f"an inertia at node {model.mesh.numbers[node]}, which is not a reference node, or in its own axes"
            model.findings.add("*ROTARY INERTIA", card.where, effect, bool(values.any()), "points")
        elif values.any():
            model.points[int(node)] = point.with_keys(inertia=inertia)


def _take_spring(model: InputModel, scope: Scope, card: Card, elements: np.ndarray) -> None:
    """Take linear springs: SPRING1 to ground, SPRING2 between directions, SPRINGA along their line."""
    special = [key for key in ("NONLINEAR", "COMPLEXSTIFFNESS", "ORIENTATION", "RTOL") if key in card.parameters]
    _take_links(model, card, elements, special, "stiffness", "springs")


def _take_dashpot(model: InputModel, scope: Scope, card: Card, elements: np.ndarray) -> None:
    """Take linear dampers: DASHPOT1 to ground, DASHPOT2 between directions, DASHPOTA along their line."""
    special = [key for key in card.parameters if key != "ELSET"]
    _take_links(model, card, elements, special, "damping", "dampers")


def _take_links(model: InputModel, card: Card, elements: np.ndarray, special: Sequence[str], key: str, nouns: str) -> None:
    """Take linear springs or dampers; add a finding for others: with ``special`` parameters, or with a table of values."""
    links, lines = list(_ends(model, elements)), [words for words, _ in card.lines()]
    n_first = int(any(not word.endswith("A") for word, _ in links))  # a line of directions comes first
    values = lines[n_first:]
    if special or len(values) > 1 or any(word for words in values for word in words[1:]):
        keyword = f"*{card.keyword}, {special[0]}" if special else f"*{card.keyword}"
        effect = f"{nouns} that are not linear, depend on frequency or temperature, or are in their own axes"
        model.findings.add(keyword, card.where, effect, True, "springs")
        return
    (value,) = _numbers(card, 1, n_first)
    for word, ends in links:
        _add_spring(model, card, word, ends, lines[:n_first], Spring.of_file(groups=(), **{key: float(value)}))


def _ends(model: InputModel, elements: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the type and the nodes of each of some elements."""
    for first, block, nodes in model.mesh.blocks:
        for ends in nodes[elements[(elements >= first) & (elements < first + len(nodes))] - first]:
            yield block.word, ends


def _add_spring(model: InputModel, card: Card, word: str, ends: np.ndarray, lines: list, spring: Spring) -> None:
    """Add one spring or damper, with the stiffness and damping of ``spring``, between its ends."""
    dofs = [int(field) for field in lines[0][:2] if field.isdigit()] if not word.endswith("A") and lines else []
    of_points = [int(node) in model.points or int(node) in model.turns for node in ends]
    numbers = " and ".join(str(model.mesh.numbers[node]) for node in ends)
    if word == "SPRING1" and of_points == [True] and len(dofs) == 1 and 1 <= dofs[0] <= 6:
        node = model.turns.get(int(ends[0]), int(ends[0]))
        model.points[node] = grounded(model.points[node], dofs[0], spring.stiffness)
        return
    if any(of_points) or (dofs and not all(1 <= dof <= 3 for dof in dofs)) or len(set(dofs)) > 1:
        effect = f"a {card.keyword.lower()} at {numbers} on rotations, on a reference node or between different directions"
        model.findings.add(f"*{card.keyword}", card.where, effect, True, "springs")
        return
    direction = None
    if dofs:
        direction = vector(model.axes.get(int(ends[0]), np.eye(3))[dofs[0] - 1])
    groups = tuple(model.grouped.node_group(f"node {model.mesh.numbers[node]}", np.array([node])) for node in ends)
    model.attached.update(ends.tolist())
    model.springs.append(spring.with_keys(groups=groups, direction=direction))


_TAKEN = {"MASS": _take_mass, "ROTARY INERTIA": _take_inertia, "SPRING": _take_spring, "DASHPOT": _take_dashpot}
