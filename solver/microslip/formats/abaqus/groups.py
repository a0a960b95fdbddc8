"""Cells and groups of a file model: from elements, sets and surfaces of the cards."""

import re
from dataclasses import dataclass, field

import numpy as np

from ...messages.errors import MeshError
from ..draft import face_of
from ..model import KINDS, NO_NODES, Cells, Group, family_of
from .mesh import FileMesh
from .names import Names
from .types import is_solid

# Faces S1, S2, ... of the solid elements by their corners (Abaqus and CalculiX agree).
_FACES = {
    "tet": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "hex": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
}


@dataclass(eq=False)
class Grouped:
    """Cells and groups, and the cell of each element."""

    mesh: FileMesh
    cells: list[Cells] = field(default_factory=list)
    groups: dict[str, Group] = field(default_factory=dict)
    block_of: np.ndarray = field(default_factory=lambda: NO_NODES)  # (n_elements,) block of cells; -1: none
    row_of: np.ndarray = field(default_factory=lambda: NO_NODES)
    of_solids: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n_nodes,) whether part of a solid
    _outer: dict[int, np.ndarray] = field(default_factory=dict)  # block: (n, n_faces) bool

    def add_elements(self, name: str, elements: np.ndarray) -> None:
        """Add elements, by position, to a group."""
        group = self.groups.setdefault(name, Group())
        blocks = self.block_of[elements]
        for block in np.unique(blocks[blocks >= 0]):
            group.add_cells(int(block), self.row_of[elements[blocks == block]])

    def nodes_of(self, name: str) -> np.ndarray:
        """Return the positions of all nodes of a group."""
        group = self.groups[name]
        parts = [self.cells[block].nodes[rows].ravel() for block, rows in group.cells.items()]
        return np.unique(np.concatenate([group.nodes, *parts]))

    def node_group(self, name: str, nodes: np.ndarray) -> str:
        """Return the name of a group of exactly these nodes: ``name`` if that group has them, otherwise a new group."""
        nodes = np.unique(nodes)
        candidate, n = name, 1
        while candidate in self.groups and not np.array_equal(self.nodes_of(candidate), nodes):
            n += 1
            candidate = f"{name} (nodes)" if n == 2 else f"{name} (nodes {n - 1})"
        self.groups.setdefault(candidate, Group()).add_nodes(nodes)
        return candidate

    def body_group(self, name: str, elements: np.ndarray) -> str:
        """Return the name of a group of exactly these solid elements: ``name`` or a new group."""
        candidate, n = name, 1
        while candidate in self.groups and not np.array_equal(self._solids_of(candidate), np.sort(elements)):
            n += 1
            candidate = f"{name} {n}"
        if candidate not in self.groups:
            self.add_elements(candidate, elements)
        return candidate

    def _solids_of(self, name: str) -> np.ndarray:
        parts = [NO_NODES]
        for block, rows in self.groups[name].cells.items():
            if KINDS[self.cells[block].kind][0] == 3:
                elements = np.flatnonzero(self.block_of == block)
                parts.append(elements[np.isin(self.row_of[elements], rows)])
        return np.sort(np.concatenate(parts))

    def has_faces(self, name: str) -> bool:
        """Return whether a group has cells of two dimensions.  Local."""
        group = self.groups.get(name)
        return group is not None and any(
            KINDS[self.cells[block].kind][0] == 2 for block, rows in group.cells.items() if len(rows)
        )

    def outer_faces(self, block: int) -> np.ndarray:
        """Return which faces of a block of solids belong to only one solid, (n, n_faces) bool."""
        if not self._outer:
            self._outer = _outer_faces(self.cells)
        return self._outer[block]

    def add_face(self, name: str, block: int, rows: np.ndarray, face: int) -> None:
        """Add face S1, S2, ... of some cells to a group, as separate cells."""
        cells = self.cells[block]
        made = face_of(cells.kind, _FACES[family_of(cells.kind)][face - 1])
        if made is None:
            return
        self.cells.append(Cells(made[0], cells.nodes[rows][:, made[1]], cells.numbers[rows]))
        self.groups.setdefault(name, Group()).add_cells(len(self.cells) - 1, np.arange(len(rows)))

    def free_name(self, name: str) -> str:
        """Return an unused name of a group: ``name`` or a name derived from it."""
        candidate, n = name, 1
        while candidate in self.groups:
            n += 1
            candidate = f"{name} ({n})"
        return candidate

    def add_faces_between(self, name: str, is_in: np.ndarray) -> None:
        """Add the outer faces of solids with all nodes in ``is_in`` (n_nodes,) bool to a group."""
        for block, cells in enumerate(list(self.cells)):  # faces are added to the list
            for i, corners in enumerate(_FACES.get(family_of(cells.kind), ())):
                made = face_of(cells.kind, corners)
                is_inside = is_in[cells.nodes[:, made[1]]].all(axis=1) if made is not None else np.zeros(0, dtype=bool)
                rows = np.flatnonzero(is_inside & self.outer_faces(block)[:, i]) if is_inside.any() else NO_NODES
                if len(rows):
                    self.add_face(name, block, rows, i + 1)


def grouped(mesh: FileMesh) -> Grouped:
    """Return the cells of all elements, and a group for every set and surface.

    A set and a surface of one name share a group.

    Raises
    ------
    MeshError : sets of entries that do not exist, faces that elements do not have
    """
    content = _with_cells(mesh)
    instances = [names for names in mesh.names.values() if names.scope.name]
    for names in mesh.names.values():
        prefixes = [names.scope.named("")] + [""] * (len(instances) == 1 and bool(names.scope.name))
        for prefix in prefixes:
            _group_sets(content, names, prefix)
    for names in mesh.names.values():
        prefixes = [names.scope.named("")] + [""] * (len(instances) == 1 and bool(names.scope.name))
        for name, entries in names.surfaces.items():
            for prefix in prefixes:
                _group_surface(content, names, prefix + mesh.spelled(name), entries)
    return content


def _with_cells(mesh: FileMesh) -> Grouped:
    """Return the cells, one block per kind."""
    n = sum(len(nodes) for _, _, nodes in mesh.blocks)
    content = Grouped(mesh, block_of=np.full(n, -1, dtype=np.int64), row_of=np.zeros(n, dtype=np.int64))
    kinds: dict[str, list[tuple[int, np.ndarray]]] = {}
    content.of_solids = np.zeros(len(mesh.points), dtype=bool)
    for first, block, nodes in mesh.blocks:
        if block.kind is not None:
            kinds.setdefault(block.kind, []).append((first, nodes))
        if is_solid(block.word):
            content.of_solids[nodes] = True
    for kind, parts in kinds.items():
        elements = np.concatenate([np.arange(first, first + len(nodes)) for first, nodes in parts])
        content.block_of[elements], content.row_of[elements] = len(content.cells), np.arange(len(elements))
        nodes = parts[0][1] if len(parts) == 1 else np.concatenate([nodes for _, nodes in parts])
        content.cells.append(Cells(kind, nodes, mesh.element_numbers[elements]))
    return content


def _group_sets(content: Grouped, names: Names, prefix: str) -> None:
    mesh, scope = content.mesh, names.scope
    for name in [name for name in names.sets["ELSET"] if name not in names.internal]:
        where = names.sets["ELSET"][name][0][2] if names.sets["ELSET"][name] else ""
        content.add_elements(prefix + mesh.spelled(name), mesh.elements(scope, name, where))
    for name in [name for name in names.sets["NSET"] if name not in names.internal]:
        where = names.sets["NSET"][name][0][2] if names.sets["NSET"][name] else ""
        content.groups.setdefault(prefix + mesh.spelled(name), Group()).add_nodes(mesh.nodes(scope, name, where))


def _group_surface(content: Grouped, names: Names, name: str, entries: list[tuple[str, str, str]]) -> None:
    """Make a group from the faces or the nodes of a surface."""
    mesh, scope = content.mesh, names.scope
    by_face: dict[str, list[np.ndarray]] = {}
    where_of: dict[str, str] = {}
    for word, face, where in entries:
        if face == "NODE":
            content.groups.setdefault(name, Group()).add_nodes(mesh.nodes(scope, word, where))
        elif not word and face:
            raise MeshError(f"{where}: *SURFACE names face {face} of no element")
        elif not word:  # all elements of the model
            by_face.setdefault("", []).append(np.arange(len(content.block_of)))
        else:
            by_face.setdefault(face, []).append(mesh.elements(scope, word, where))
        where_of.setdefault(face, where)
    for face, parts in by_face.items():
        add_faces(content, name, np.unique(np.concatenate(parts)), face, f"{where_of[face]}: *SURFACE")


def add_faces(content: Grouped, name: str, elements: np.ndarray, face: str, where: str) -> None:
    """Add faces "S1", "S2", ..., or the outer ones, of elements to a group; ``where`` begins messages: "line 12: *SURFACE"."""
    blocks = content.block_of[elements]
    number = re.fullmatch(r"S(\d)", face)
    for block in np.unique(blocks[blocks >= 0]):
        rows, cells = content.row_of[elements[blocks == block]], content.cells[block]
        family = family_of(cells.kind)
        if KINDS[cells.kind][0] == 2 and face in ("", "SPOS", "SNEG"):
            content.groups.setdefault(name, Group()).add_cells(int(block), rows)
        elif family in _FACES and number:
            if not 1 <= int(number[1]) <= len(_FACES[family]):
                raise MeshError(f"{where} names face {face} of element {cells.numbers[rows[0]]}, a {family}")
            content.add_face(name, int(block), rows, int(number[1]))
        elif family in _FACES and not face:
            outer = content.outer_faces(int(block))[rows]
            for i in range(outer.shape[1]):
                if outer[:, i].any():
                    content.add_face(name, int(block), rows[outer[:, i]], i + 1)


def _outer_faces(cells: list[Cells]) -> dict[int, np.ndarray]:
    """Return, for each block of solids, which faces belong to only one solid, (n, n_faces) bool."""
    solids = {i: family_of(block.kind) for i, block in enumerate(cells)}
    solids = {i: family for i, family in solids.items() if family in _FACES}
    keys = []
    for i, family in solids.items():
        for face in _FACES[family]:
            corners = np.sort(cells[i].nodes[:, face], axis=1)
            keys.append(np.column_stack([corners, np.full(len(corners), -1)]) if len(face) == 3 else corners)
    every = np.ascontiguousarray(np.concatenate(keys))
    labels, counts = np.unique(every.view([("", every.dtype)] * 4).ravel(), return_inverse=True, return_counts=True)[1:]
    is_outer, at, outer = counts[labels.ravel()] == 1, 0, {}
    for i, family in solids.items():
        n, n_faces = len(cells[i].nodes), len(_FACES[family])
        outer[i] = is_outer[at : at + n * n_faces].reshape(n_faces, n).T
        at += n * n_faces
    return outer
