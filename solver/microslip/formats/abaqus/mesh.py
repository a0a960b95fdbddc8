"""Nodes, elements, sets and surfaces of all instances, and the lookup of names and numbers of the file."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from ...messages.errors import MeshError
from ...messages.words import counted, hint
from ..model import NO_NODES
from .cards import Card, values_of
from .names import Names, Places
from .nodes import Elements, read_elements, read_nodes, system_of
from .scopes import Scope

_DIGITS = 18  # digits of the longest number
_DEEPEST = 100  # depth of nested sets


@dataclass(eq=False)
class FileMesh:
    """The mesh from the cards.  Positions of nodes and elements count through all instances."""

    names: dict[str, Names] = field(default_factory=dict)  # by the scope's name in upper case
    spelling: dict[str, str] = field(default_factory=dict)  # upper case: as first written
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    numbers: np.ndarray = field(default_factory=lambda: NO_NODES)
    element_numbers: np.ndarray = field(default_factory=lambda: NO_NODES)
    blocks: list[tuple[int, Elements, np.ndarray]] = field(default_factory=list)  # first element, its card, nodes (n, k)
    known: dict[tuple[str, str, str], np.ndarray] = field(default_factory=dict)  # scope, kind of set, name: members
    missing: dict[str, tuple[str, str, int]] = field(default_factory=dict)  # place: kind of set, message, first missing number
    short: dict[str, int] = field(default_factory=dict)  # place of a *NODE: lines with fewer coordinates than others
    offsets: tuple[int, int] = (0, 0)  # node and element number offset per instance; 0: none

    def of(self, scope: Scope) -> Names:
        """Return the names of a scope, added if they are new.  Local."""
        key = scope.name.upper()
        if key not in self.names:
            self.names[key] = Names(scope)
        return self.names[key]

    def spelled(self, name: str) -> str:
        """Return a name as it was written first; upper and lower case are the same.  Local."""
        return self.spelling.setdefault(name.upper(), name)

    # names of nodes, elements, sets in the file
    def find(self, scope: Scope, word: str) -> tuple[Names, str]:
        """Return the scope in which a word of another scope is looked up, and its name there in upper case."""
        word = word.upper()
        if "." in word and word not in self.of(scope).sets["NSET"] and word not in self.of(scope).sets["ELSET"]:
            instance, _, rest = word.partition(".")
            while instance not in self.names and "." in rest:  # the name of an instance may contain dots
                more, _, rest = rest.partition(".")
                instance += "." + more
            if instance in self.names:
                return self.names[instance], rest
            if instance == "ASSEMBLY":
                return self.of(scope), rest
        return self.of(scope), word

    def nodes(self, scope: Scope, word: str, where: str) -> np.ndarray:
        """Return the positions of the nodes given by a number or the name of a set.

        Raises
        ------
        MeshError : no set or node has that name or number
        """
        names, word = self.find(scope, word)
        return self._members(names, "NSET", word, where, ())

    def elements(self, scope: Scope, word: str, where: str) -> np.ndarray:
        """Return the positions of the elements given by a number or the name of a set."""
        names, word = self.find(scope, word)
        return self._members(names, "ELSET", word, where, ())

    def name_of(self, scope: Scope, word: str) -> str:
        """Return the name of the group of a set or surface."""
        names, word = self.find(scope, word)
        return names.scope.named(self.spelled(word))

    def _members(self, names: Names, kind: str, word: str, where: str, within: tuple[tuple[str, str, str], ...]) -> np.ndarray:
        """Return the members of a set, or a single member by its number; ``within``: scope, kind, name of the enclosing sets."""
        if word.isdigit():
            if len(word) > _DIGITS:
                raise MeshError(f"{where}: {word[:40]} is not a number of the file")
            return self._positions(names, kind, np.array([int(word)]), where)
        if word not in names.sets[kind]:
            other = "ELSET" if kind == "NSET" else "NSET"
            near = hint(word, names.sets[kind], lambda near: repr(self.spelled(near)))
            near = f"; there is an *{other} of this name" if word in names.sets[other] else near
            raise MeshError(f"{where}: *{kind} {self.spelled(word)!r} is used but not defined{near}")
        key = (names.scope.name.upper(), kind, word)
        if key in within or len(within) > _DEEPEST:
            what = "contains itself" if key in within else f"contains sets nested within more than {_DEEPEST} others"
            raise MeshError(f"{where}: *{kind} {self.spelled(word)!r} {what}")
        if key not in self.known:
            parts = [self._part(names, kind, word, part, (*within, key)) for part in names.sets[kind][word]]
            self.known[key] = np.unique(np.concatenate([NO_NODES, *parts]))
        return self.known[key]

    def _part(self, names: Names, kind: str, word: str, part: tuple, within: tuple) -> np.ndarray:
        """Return one entry of a set: numbers, another set, the nodes of an element set, or numbers of an instance."""
        how, what, where = part
        if how == "elements":
            return self.nodes_of(self._members(names, "ELSET", what, where, within))
        if how == "instance":
            instance, what = what
            if instance not in self.names:
                raise MeshError(f"{where}: *{kind} {self.spelled(word)!r}: there is no instance {instance!r}")
            names = self.names[instance]
        if isinstance(what, str):
            other, member = (names, what) if how == "instance" else self.find(names.scope, what)
            return self._members(other, kind, member, where, within)
        places, first = names.places(kind)
        members, n_missing, missing = places.present(what)
        if n_missing:
            what = "nodes" if kind == "NSET" else "elements"
            self.missing[where] = (kind, f"{self.spelled(word)!r} names {n_missing} {what} that the file does not hold", missing)
        return first + members

    def _positions(self, names: Names, kind: str, numbers: np.ndarray, where: str) -> np.ndarray:
        places, first = names.places(kind)
        index, missing = places.find(numbers)
        if len(missing):
            what, card = ("node", "*NODE") if kind == "NSET" else ("element", "*ELEMENT")
            raise MeshError(f"{where} names {what} {missing[0]}, which no {card} block holds")
        return first + index

    def nodes_of(self, elements: np.ndarray) -> np.ndarray:
        """Return the positions of the nodes of some elements."""
        parts = [NO_NODES]
        for first, _, nodes in self.blocks:
            rows = elements[(elements >= first) & (elements < first + len(nodes))] - first
            parts.append(nodes[rows].ravel())
        members = np.unique(np.concatenate(parts))
        return members[members >= 0]


def _take_nodes(mesh: FileMesh, names: Names, card: Card) -> None:
    numbers, points, n_short = read_nodes(card)
    if n_short:
        mesh.short[card.where] = n_short
    axes, origin = names.system
    points = names.scope.placed(points @ axes + origin)
    names.given_nodes.append((numbers, points, card.where))
    if card.parameters.get("NSET"):
        add_to_set(mesh, names, "NSET", card.parameters["NSET"], ("numbers", numbers, card.where))


def _take_system(mesh: FileMesh, names: Names, card: Card) -> None:
    names.system = system_of(card)


def _take_elements(mesh: FileMesh, names: Names, card: Card) -> None:
    block = read_elements(card)
    names.blocks.append(block)
    if card.parameters.get("ELSET"):
        add_to_set(mesh, names, "ELSET", card.parameters["ELSET"], ("numbers", block.numbers, card.where))


def add_to_set(mesh: FileMesh, names: Names, kind: str, name: str, part: tuple) -> None:
    """Add an entry to a set: form of the members, the members, place of the statement."""
    names.sets[kind].setdefault(mesh.spelled(name).upper(), []).append(part)


def _take_set(mesh: FileMesh, names: Names, card: Card) -> None:
    """Take a set of numbers and names; an entry of an instance is looked up in the instance."""
    kind, name = card.keyword, card.parameters.get(card.keyword)
    if not name:
        raise MeshError(f"{card.where}: *{kind} without a name")
    mesh.spelled(name)
    names.sets[kind].setdefault(name.upper(), [])
    if "INTERNAL" in card.parameters:
        names.internal.add(name.upper())
    if "UNSORTED" in card.parameters:
        names.unsorted.add(name.upper())
    if kind == "NSET" and "ELSET" in card.parameters:
        add_to_set(mesh, names, kind, name, ("elements", card.parameter("ELSET"), card.where))
        return
    instance = card.parameter("INSTANCE")

    def add(what) -> None:
        how = "set" if isinstance(what, str) else "numbers"
        part = ("instance", (instance, what), card.where) if instance else (how, what, card.where)
        add_to_set(mesh, names, kind, name, part)

    if "GENERATE" in card.parameters:
        for words, where in card.lines():
            add(_generated(words, where, kind))
        return
    words = [word for line, _ in card.lines() for word in line if word]
    plain = [word for word in words if word.isdigit()]
    if any(len(word) > _DIGITS for word in plain):
        raise MeshError(f"{card.where}: *{kind} {name!r} holds {max(plain, key=len)[:40]}, which is not a number of the file")
    add(np.array(plain, dtype=np.int64))
    for word in words:
        if not word.isdigit():
            mesh.spelled(word)
            add(word.upper())


def _generated(words: list[str], where: str, kind: str) -> range:
    """Return the numbers of a line of a generated set."""
    values = values_of(",".join(words).encode())
    first, last, step = (-1.0, -1.0, 1.0) if values is None or len(values) not in (2, 3) else (*values, 1.0)[:3]
    if not (0 <= first <= last <= 2**53 and 1 <= step <= 2**53):
        raise MeshError(f"{where}: *{kind}, GENERATE: {','.join(words)!r} is not a range of numbers; the file is damaged")
    return range(int(first), int(last) + 1, int(step))


def _take_surface(mesh: FileMesh, names: Names, card: Card) -> None:
    """Store the entries of a surface; surfaces of kinds without faces have no entries."""
    name = mesh.spelled(card.parameters.get("NAME", ""))
    entries = names.surfaces.setdefault(name.upper(), [])
    kind = card.parameter("TYPE", "ELEMENT")
    if kind not in ("ELEMENT", "NODE") or {"COMBINE", "CROP"} & set(card.parameters):
        return
    for words, where in card.lines():
        face = "NODE" if kind == "NODE" else (words[1].upper() if len(words) > 1 else "")
        entries.append((words[0], face, where))


CARDS = {
    "NODE": _take_nodes,
    "SYSTEM": _take_system,
    "ELEMENT": _take_elements,
    "NSET": _take_set,
    "ELSET": _take_set,
    "SURFACE": _take_surface,
}


def finish(mesh: FileMesh) -> None:
    """Assign unique numbers to nodes and elements of all scopes, and find the nodes of the elements.

    The numbers of the file remain if no two instances share one; otherwise the numbers of instance k, from 0, are raised by k
    times a power of ten above all numbers; the assembly comes last.

    Raises
    ------
    MeshError : repeated numbers, or nodes that do not exist
    """
    scopes = sorted(mesh.names.values(), key=lambda names: names.scope.name == "")  # the assembly last
    for names in scopes:
        names.node_numbers = _joined(part[0] for part in names.given_nodes)
        names.element_numbers = _joined(block.numbers for block in names.blocks)
        _refuse_twice([(numbers, where) for numbers, _, where in names.given_nodes], "NODE", "node")
        _refuse_twice([(block.numbers, block.where) for block in names.blocks], "ELEMENT", "element")
        names.blocks = _merged(names.blocks)
        names.node_places, names.element_places = Places(names.node_numbers), Places(names.element_numbers)
    mesh.points = np.concatenate([np.zeros((0, 3)), *(points for names in scopes for _, points, _ in names.given_nodes)])
    mesh.numbers, raised_nodes = _unique_numbers([names.node_numbers for names in scopes])
    mesh.element_numbers, raised_elements = _unique_numbers([names.element_numbers for names in scopes])
    mesh.offsets = raised_nodes, raised_elements
    n_nodes = n_elements = 0
    for names in scopes:
        names.first_node, names.first_element = n_nodes, n_elements
        n_nodes += len(names.node_numbers)
        for block in names.blocks:
            nodes, missing = names.node_places.find(block.nodes)
            nodes += names.first_node
            if block.kind is None:
                nodes[block.nodes == 0] = -1
                missing = missing[missing != 0]
            if len(missing):
                raise MeshError(f"{block.where}: *ELEMENT names node {missing[0]}, which no *NODE block holds")
            for row, column, word in block.named:
                nodes[row, column] = _single_node(mesh, names.scope, word, block.where)
            mesh.blocks.append((n_elements, block, nodes))
            n_elements += len(nodes)
        names.given_nodes.clear()


def _single_node(mesh: FileMesh, scope: Scope, word: str, where: str) -> int:
    """Return the position of the single node that an element of the assembly names."""
    members = mesh.nodes(scope, word, where)
    if len(members) != 1:
        raise MeshError(f"{where}: *ELEMENT names {word!r}, which holds {counted(len(members), 'node')} where one is expected")
    return int(members[0])


def _merged(blocks: list[Elements]) -> list[Elements]:
    """Join the elements of consecutive cards of one type."""
    runs: list[list[Elements]] = []
    for block in blocks:
        last = runs[-1][0] if runs else None
        if (
            last is not None
            and not (block.named or last.named)
            and last.word == block.word
            and last.nodes.shape[1] == block.nodes.shape[1]
        ):
            runs[-1].append(block)
        else:
            runs.append([block])
    return [
        replace(
            parts[0],
            numbers=np.concatenate([part.numbers for part in parts]),
            nodes=np.concatenate([part.nodes for part in parts]),
        )
        if len(parts) > 1
        else parts[0]
        for parts in runs
    ]


def _joined(parts: Iterable[np.ndarray]) -> np.ndarray:
    return np.concatenate([NO_NODES, *parts])


def _refuse_twice(parts: list[tuple[np.ndarray, str]], keyword: str, what: str) -> None:
    """Raise MeshError for a repeated number, with the card of the repetition."""
    numbers = _joined(part[0] for part in parts)
    if len(numbers) < 2 or (np.diff(numbers) > 0).all():
        return
    order = np.argsort(numbers, kind="stable")
    repeated = order[1:][np.diff(numbers[order]) == 0]
    if len(repeated):
        row = repeated.min()
        part = int(np.searchsorted(np.cumsum([len(part_numbers) for part_numbers, _ in parts]), row, side="right"))
        raise MeshError(f"{parts[part][1]}: *{keyword} gives {what} number {numbers[row]} more than once")


def _unique_numbers(scopes: list[np.ndarray]) -> tuple[np.ndarray, int]:
    """Return numbers that are unique over all scopes, and the offset per scope."""
    numbers = _joined(scopes)
    nonempty = [part for part in scopes if len(part)]
    if len(nonempty) < 2 or len(np.unique(numbers)) == len(numbers):
        return numbers, 0
    raised = 10 ** len(str(int(numbers.max())))
    count = np.cumsum([0] + [len(part) > 0 for part in scopes])[:-1]
    return _joined(part + raised * k for part, k in zip(scopes, count, strict=True)), raised
