"""Nodes and elements generated from others: *NGEN, *NFILL, *NCOPY, *ELGEN, *ELCOPY."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ...messages.errors import MeshError
from ...messages.words import counted
from ..model import NO_NODES
from .cards import Card, number
from .mesh import FileMesh, add_to_set
from .names import Names, Places
from .nodes import Elements
from .scopes import rotation_about

_MOST = 10**7  # numbers that one line may generate
_HALF_TURN = 1e-9  # sine of the angle between the ends of an arc, below which its plane is undetermined


def _refuse(card: Card, *names: str) -> None:
    for name in names:
        if name in card.parameters:
            what = "nodes" if card.keyword[0] == "N" else "elements"
            raise MeshError(f"{card.where}: *{card.keyword}, {name} is not supported; write the {what} out")


def _rows(card: Card, n_least: int, n_words: int = 0) -> Iterator[tuple[list[str], list[float], str]]:
    """Yield the words of each data line, and the numbers after the first ``n_words`` words."""
    for words, where in card.lines():
        words = words[:-1] if words and not words[-1] else words
        values = [number(word) if word else math.nan for word in words[n_words:]]
        if len(words) < n_least or any(value is None for value in values):
            raise MeshError(f"{where}: *{card.keyword}: {','.join(words)[:60]!r}: expected {n_least} entries or more")
        yield words[:n_words], [value for value in values if value is not None], where


def _entry(values: list[float], i: int, default: int) -> int:
    """Return an entry of a line; the default for an empty entry."""
    return int(values[i]) if i < len(values) and not math.isnan(values[i]) else default


class _NodesSoFar:
    """The nodes that one scope has so far."""

    def __init__(self, names: Names):
        self.numbers = np.concatenate([NO_NODES, *(numbers for numbers, _, _ in names.given_nodes)])
        self.points = np.concatenate([np.zeros((0, 3)), *(points for _, points, _ in names.given_nodes)])
        self.places = Places(self.numbers)

    def at(self, wanted: np.ndarray, where: str) -> np.ndarray:
        """Return the points of some numbers, (n, 3)."""
        place, missing = self.places.find(np.asarray(wanted, dtype=np.int64))
        if len(missing):
            raise MeshError(f"{where}: node {missing[0]} is not defined before it is used")
        return self.points[place]


def _add_nodes(mesh: FileMesh, names: Names, card: Card, numbers: list[np.ndarray], points: list[np.ndarray], key: str) -> None:
    """Add nodes, and a set of all ``numbers``; the first numbers of each part, those with points, are new."""
    new = np.concatenate([NO_NODES, *(part[: len(at)] for part, at in zip(numbers, points, strict=True))])
    names.given_nodes.append((new, np.concatenate([np.zeros((0, 3)), *points]), card.where))
    if card.parameters.get(key):
        add_to_set(mesh, names, "NSET", card.parameters[key], ("numbers", np.concatenate([NO_NODES, *numbers]), card.where))


def _take_lines(mesh: FileMesh, names: Names, card: Card) -> None:
    """Take *NGEN: nodes along a line or an arc between two others."""
    shape = card.parameter("LINE")
    if shape not in ("", "C"):
        raise MeshError(f"{card.where}: *NGEN, LINE={shape} is not supported; write the nodes out")
    if shape == "C" and card.parameter("SYSTEM", "RC") != "RC":
        raise MeshError(f"{card.where}: *NGEN, SYSTEM={card.parameter('SYSTEM')} is not supported; write the nodes out")
    known = _NodesSoFar(names)
    numbers, points = [], []
    for _, values, where in _rows(card, 2):
        first, last, step = int(values[0]), int(values[1]), _entry(values, 2, 1)
        n = abs(last - first) // step if step > 0 else 0
        if n < 1 or abs(last - first) != n * step or n > _MOST:
            raise MeshError(f"{where}: *NGEN: from node {first} to {last} there are no whole steps of {step}")
        ends, s = known.at(np.array([first, last]), where), np.arange(1, n)[:, None] / n
        between = ends[0] + s * (ends[1] - ends[0]) if not shape else _arc(names, known, ends, s, values, where)
        numbers.append(np.concatenate([first + np.sign(last - first) * step * np.arange(1, n), [first, last]]))
        points.append(between)
    _add_nodes(mesh, names, card, numbers, points, "NSET")


def _arc(names: Names, known: _NodesSoFar, ends: np.ndarray, s: np.ndarray, values: list[float], where: str) -> np.ndarray:
    """Return points at fractions ``s`` (n, 1) of the angle between two ends, about the centre in ``values``."""
    if _entry(values, 3, 0):
        centre = known.at(np.array([_entry(values, 3, 0)]), where)[0]
    elif len(values) >= 5 and not names.scope.name and (names.system[0] == np.eye(3)).all() and not names.system[1].any():
        centre = np.nan_to_num(np.array([*values[4:7], 0.0, 0.0, 0.0][:3]))
    else:
        raise MeshError(f"{where}: *NGEN, LINE=C: the centre must be a node, or in the axes of the model; write the nodes out")
    a, b = ends - centre
    normal = np.cross(a, b)
    spans_plane = np.linalg.norm(normal) > _HALF_TURN * np.linalg.norm(a) * np.linalg.norm(b)
    if len(values) > 7 or not spans_plane or not a.any():
        raise MeshError(f"{where}: *NGEN, LINE=C: an arc of half a turn or more is not supported; write the nodes out")
    normal /= np.linalg.norm(normal)
    angle = math.atan2(np.cross(a, b) @ normal, a @ b)
    radius = np.linalg.norm(a) + s * (np.linalg.norm(b) - np.linalg.norm(a))
    x = a / np.linalg.norm(a)
    return centre + radius * (np.cos(s * angle) * x + np.sin(s * angle) * np.cross(normal, x))


def _take_fill(mesh: FileMesh, names: Names, card: Card) -> None:
    """Take *NFILL: nodes on straight lines between corresponding nodes of two sets."""
    _refuse(card, "BIAS", "SINGULAR", "TWOSTEP")
    known = _NodesSoFar(names)
    numbers, points = [], []
    for words, values, where in _rows(card, 3, 2):
        bounds = [_members(names, "NSET", word, where) for word in words]
        n, step = _entry(values, 0, 1), _entry(values, 1, 1)
        if len(bounds[0]) != len(bounds[1]) or n < 1 or step < 1 or n * len(bounds[0]) > _MOST:
            raise MeshError(
                f"{where}: *NFILL: {words[0]} has {counted(len(bounds[0]), 'node')} and {words[1]} {len(bounds[1])}, to "
                f"be joined by {n} "
                f"intervals; expected equal numbers of nodes and at least one interval"
            )
        ends = [known.at(bound, where) for bound in bounds]
        s = np.arange(1, n)[:, None, None] / n
        points.append((ends[0] + s * (ends[1] - ends[0])).reshape(-1, 3))
        numbers.append(np.concatenate([(bounds[0] + step * np.arange(1, n)[:, None]).ravel(), *bounds]))
    _add_nodes(mesh, names, card, numbers, points, "NSET")


def _take_copies(mesh: FileMesh, names: Names, card: Card) -> None:
    """Take *NCOPY, SHIFT: nodes moved, then turned about an axis."""
    _refuse(card, "REFLECT", "POLE", "MULTIPLE")
    if names.scope.name:
        raise MeshError(f"{card.where}: *NCOPY in a part that has instances is not supported; write the nodes out")
    rows = [values for _, values, _ in _rows(card, 1)]
    values = np.nan_to_num(np.array([*(rows[0] if rows else []), 0.0, 0.0, 0.0][:3]))
    old = _members(names, "NSET", card.parameter("OLDSET"), card.where)
    points = _NodesSoFar(names).at(old, card.where) + values
    if len(rows) > 1:
        axis = np.nan_to_num(np.array([*rows[1], *[0.0] * 7][:7]))
        turn = rotation_about(axis[3:6] - axis[:3], np.deg2rad(axis[6]), card.where)
        points = (points - axis[:3]) @ turn.T + axis[:3]
    shift = number(card.parameters.get("CHANGENUMBER", ""))
    if shift is None:
        raise MeshError(f"{card.where}: *NCOPY: CHANGE NUMBER is missing")
    _add_nodes(mesh, names, card, [old + int(shift)], [points], "NEWSET")


def _take_rows(mesh: FileMesh, names: Names, card: Card) -> None:
    """Take *ELGEN: rows and layers of copies of one element."""
    made = [NO_NODES]
    for _, values, where in _rows(card, 2):
        entries = [_entry(values, i, 1) for i in range(10)]
        counts, steps = (entries[1], entries[4], entries[7]), [(entries[i], entries[i + 1]) for i in (2, 5, 8)]
        if len(values) > 10 or min(counts) < 1 or math.prod(counts) > _MOST:
            raise MeshError(f"{where}: *ELGEN: rows of {counts} elements; expected one or more in each direction")
        i, j, k = (axis.ravel() for axis in np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"))
        nodes, elements = (i * steps[0][m] + j * steps[1][m] + k * steps[2][m] for m in (0, 1))
        master, row = _element(names, entries[0], where)
        new = replace(master, numbers=entries[0] + elements[1:], nodes=row + nodes[1:, None] * (row > 0), where=where)
        names.blocks.append(new)
        made += [np.array([entries[0]]), new.numbers]
    if card.parameters.get("ELSET"):
        add_to_set(mesh, names, "ELSET", card.parameters["ELSET"], ("numbers", np.concatenate(made), card.where))


def _take_element_copies(mesh: FileMesh, names: Names, card: Card) -> None:
    """Take *ELCOPY: copies of elements with shifted element and node numbers."""
    _refuse(card, "REFLECT")
    shifts = [number(card.parameters.get(name, "")) for name in ("ELEMENTSHIFT", "SHIFTNODES")]
    if None in shifts or not card.parameters.get("OLDSET"):
        raise MeshError(f"{card.where}: *ELCOPY: expected ELEMENT SHIFT, OLD SET and SHIFT NODES")
    by_element, by_node = (int(shift) for shift in shifts if shift is not None)
    old = _members(names, "ELSET", card.parameter("OLDSET"), card.where)
    made = [NO_NODES]
    for block in list(names.blocks):
        is_old = np.isin(block.numbers, old)
        if is_old.any():
            rows = block.nodes[is_old]
            nodes = rows + by_node * (rows > 0)
            names.blocks.append(replace(block, numbers=block.numbers[is_old] + by_element, nodes=nodes, where=card.where))
            made.append(names.blocks[-1].numbers)
    if card.parameters.get("NEWSET"):
        add_to_set(mesh, names, "ELSET", card.parameters["NEWSET"], ("numbers", np.concatenate(made), card.where))


def _element(names: Names, wanted: int, where: str) -> tuple[Elements, np.ndarray]:
    """Return the block of an element, and its nodes."""
    for block in reversed(names.blocks):
        at = np.flatnonzero(block.numbers == wanted)
        if len(at) and not block.named:
            return block, block.nodes[at[0]]
    raise MeshError(f"{where}: *ELGEN: element {wanted} is not defined before it is used")


def _members(names: Names, kind: str, word: str, where: str, depth: int = 0) -> np.ndarray:
    """Return the numbers of a set so far: ascending, or in the stated order for an unsorted set."""
    word = word.upper()
    if word.isdigit():
        return np.array([int(word)])
    if word not in names.sets[kind] or depth > 20:
        raise MeshError(f"{where}: *{kind} {word!r} is not defined before it is used")
    parts = [NO_NODES]
    for how, what, _ in names.sets[kind][word]:
        if isinstance(what, str) and how == "set":
            parts.append(_members(names, kind, what, where, depth + 1))
        elif how == "numbers" and isinstance(what, (range, np.ndarray)):
            parts.append(np.asarray(what, dtype=np.int64))
        else:
            raise MeshError(f"{where}: *{kind} {word!r} is made of other sets in a way that is not supported")
    every = np.concatenate(parts)
    return every if word in names.unsorted else np.unique(every)


GENERATING_CARDS: dict[str, Callable[[FileMesh, Names, Card], None]] = {
    "NGEN": _take_lines,
    "NFILL": _take_fill,
    "NCOPY": _take_copies,
    "ELGEN": _take_rows,
    "ELCOPY": _take_element_copies,
}
