"""Read a mesh file, and select the parts that the structure uses."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..formats.csv_table import read_table
from ..formats.model import KINDS, Equations, FileModel, Group
from ..formats.read import read_model
from ..messages.errors import CaseError, Faults, MeshError, prefixed
from ..messages.words import counted, hint, verb
from ..tables.structure import Body, Model
from ..tables.structure_tables import StructureTables
from .data import ElementBlock, FaceBlock, Mesh, Outside
from .touching import with_touching_surfaces

SOLIDS = ("tet4", "tet10", "hex8", "hex20", "wedge6", "wedge15", "pyramid5", "pyramid13")
_EVERYTHING = "all elements of the file"
_ADVICE = {
    "hex27": "; in Gmsh set Mesh.SecondOrderIncomplete = 1 for hex20",
    "wedge18": "; in Gmsh set Mesh.SecondOrderIncomplete = 1 for wedge15",
    "pyramid14": "; in Gmsh set Mesh.SecondOrderIncomplete = 1 for pyramid13",
}


def read_mesh(tables: StructureTables, file: FileModel | None = None) -> Mesh:
    """Read, check and scale a mesh.  Local; to be called on rank 0 only, through ``on_root``.

    ``file`` is the model file from ``read_model``, if already read.

    Volume elements in a named group but in no body are omitted, with a note in ``Mesh.notes``.

    Raises
    ------
    MeshError, CaseError : one message with the file and the cause
    """
    path = os.path.normpath(tables.model.file_of("mesh") or "")
    file = read_model(path, tables.model.step) if file is None else file
    try:
        _check_groups(file, tables)
        return with_touching_surfaces(_compose(path, file, tables), tables)
    except MeshError as problem:
        raise prefixed(problem, path) from None


def read_whole(path: Path) -> Mesh:
    """Return the complete mesh of a file in its unit, with all solid elements in one unnamed body.  Local.

    Raises
    ------
    MeshError, CaseError : the file is faulty or has no solid elements
    """
    file = read_model(path)
    everything = Group()
    for i, cells in enumerate(file.cells):
        if KINDS.get(cells.kind, (0, 0))[0] == 3:
            everything.add_cells(i, np.arange(len(cells.nodes)))
    if not everything.cells:
        raise MeshError(f"{path}: the file has no solid elements")
    file = replace(file, groups={**file.groups, _EVERYTHING: everything}, equations=None)
    tables = StructureTables.of_file(model=Model.of_file(mesh=str(path)), bodies={_EVERYTHING: Body.of_file(group=_EVERYTHING)})
    try:
        return _compose(str(path), file, tables)
    except MeshError as problem:
        raise type(problem)(f"{path}: {problem}") from None


def _check_groups(file: FileModel, tables: StructureTables) -> None:
    """Raise MeshError unless all named groups exist; one error for all missing groups."""
    faults = Faults()
    of_file = [(f"[bodies.{name}] group", body.group) for name, body in tables.bodies.items()] + tables.attached
    known = [*file.groups, *(surface.name for surface in tables.surfaces)]
    for names, used in ((list(file.groups), of_file), (known, tables.groups_on_bodies)):
        for key, group in used:
            if group not in names:
                faults.add([MeshError(f"{key} = {group!r}: there is no such group in the mesh{_existing(group, names)}")])
    faults.refuse()


def _existing(word: str, names: list[str]) -> str:
    if not names:
        return "; it has no named groups at all (in Gmsh: Physical Volume and Physical Surface with names)"
    shown = ", ".join(names[:30]) + (f", ... ({len(names)} in all)" if len(names) > 30 else "")
    return f"{hint(word, names, repr)}; it has: {shown}"


def _compose(path: str, file: FileModel, tables: StructureTables) -> Mesh:
    """Return the mesh of the elements of bodies and their nodes."""
    notes = list(file.notes)
    elements = []
    for name, body in tables.bodies.items():
        _check_kinds(name, body.group, file)
    for kind in SOLIDS:
        elements += _elements_of_kind(kind, file, tables, notes)
    used = np.zeros(len(file.points), dtype=bool)
    for block in elements:
        used[block.nodes] = True
    new = np.cumsum(used) - 1
    elements = [ElementBlock(block.kind, block.group, new[block.nodes], block.numbers) for block in elements]
    faces, node_groups = [], {}
    for name, group in file.groups.items():
        faces += _faces(name, group, file, used, new)
        node_groups[name] = new[_group_nodes(group, file, used)]
    outside = _outside(file, tables, used)
    n_left_out = np.count_nonzero(~used) - len(outside)
    if n_left_out:
        notes.append(f"{counted(n_left_out, 'node')} that no element of a body uses {verb(n_left_out, 'are')} left out")
    mesh = Mesh(
        path,
        file.points[used] * float(tables.model.metres),
        file.numbers[used],
        tuple(elements),
        tuple(faces),
        node_groups,
        tuple(notes),
        {name: values[used] for name, values in file.fields.items()},
        _outside_nodes(file, float(tables.model.metres), outside),
        _equations(file, tables, new, outside),
    )
    _check_groups_on_bodies(mesh, tables)
    return mesh


def _outside(file: FileModel, tables: StructureTables, used: np.ndarray) -> np.ndarray:
    """Return the nodes of masses, springs or equations in no element of a body, ascending."""
    named = np.zeros(len(used), dtype=bool)
    if file.equations is not None and tables.has_equations:
        named[file.equations.nodes[file.equations.nodes >= 0]] = True
    for _, group in tables.attached:
        named[_all_nodes(file.groups[group], file)] = True
    return np.flatnonzero(named & ~used)


def _outside_nodes(file: FileModel, scale: float, outside: np.ndarray) -> Outside:
    groups = {}
    for name, group in file.groups.items() if len(outside) else ():
        members = np.flatnonzero(np.isin(outside, _all_nodes(group, file)))
        if len(members):
            groups[name] = members
    return Outside(file.points[outside] * scale, file.numbers[outside], groups)


def _equations(file: FileModel, tables: StructureTables, new: np.ndarray, outside: np.ndarray) -> Equations | None:
    """Return the file's equations between nodes of the mesh, with rotations of points in the scene's unit of length."""
    if file.equations is None or not tables.has_equations:
        return None
    places = new.copy()
    places[outside] = new[-1] + 1 + np.arange(len(outside))  # new[-1] + 1 nodes are used
    given = file.equations
    scale = np.where(given.axes < 3, 1.0, float(tables.model.metres))
    nodes = np.where(given.nodes < 0, given.nodes, places[given.nodes])
    return replace(given, nodes=nodes, coefficients=scale * given.coefficients)


def _check_kinds(body: str, group: str, file: FileModel) -> None:
    """Raise MeshError unless the group has volume elements, all of supported kinds."""
    counts: dict[str, int] = {}
    for block, rows in file.groups[group].cells.items():
        if len(rows):
            counts[file.cells[block].kind] = counts.get(file.cells[block].kind, 0) + len(rows)
    solids = {kind: n for kind, n in counts.items() if kind not in KINDS or KINDS[kind][0] == 3}
    if not solids:
        contents = ", ".join(f"{n} {kind}" for kind, n in counts.items()) or "nodes only"
        raise MeshError(f"[bodies.{body}] group = {group!r} holds no volume elements ({contents})")
    for kind, n in solids.items():
        if kind not in SOLIDS:
            raise MeshError(
                f"[bodies.{body}] group = {group!r} holds {counted(n, 'element')} of kind {kind}, which is not supported "
                f"(supported: {', '.join(SOLIDS)}){_ADVICE.get(kind, '')}"
            )


def _elements_of_kind(kind: str, file: FileModel, tables: StructureTables, notes: list[str]) -> list[ElementBlock]:
    """Return the elements of one kind, one block per body, without duplicates."""
    blocks = [i for i, cells in enumerate(file.cells) if cells.kind == kind and len(cells.nodes)]
    if not blocks:
        return []
    nodes = np.concatenate([file.cells[i].nodes for i in blocks])
    numbers = np.concatenate([file.cells[i].numbers for i in blocks])
    start = dict(zip(blocks, np.cumsum([0] + [len(file.cells[i].nodes) for i in blocks]), strict=False))
    same = _same_elements(nodes)
    names, n_unique = list(tables.bodies), same.max() + 1
    body = np.full(n_unique, -1)
    for i, name in enumerate(names):
        members = same[_rows(file.groups[tables.bodies[name].group], start)]
        if (body[members] >= 0).any():
            first = members[np.argmax(body[members] >= 0)]
            raise MeshError(
                f"{kind} element {numbers[same == first][0]} belongs to body {names[body[first]]!r} and to "
                f"body {name!r}; each element must belong to one body"
            )
        body[members] = i
    if (body < 0).any():
        notes.append(_left_out(kind, numbers, same, body, file, start))
    first = np.unique(same, return_index=True)[1]  # the first copy of each element, in the order of the file
    first = np.sort(first)
    of_groups = []
    for i, name in enumerate(names):
        members = first[body[same[first]] == i]
        if len(members):
            of_groups.append(ElementBlock(kind, tables.bodies[name].group, nodes[members], numbers[members]))
    return of_groups


def _same_elements(nodes: np.ndarray) -> np.ndarray:
    """Return a label per element, equal for equal nodes (one element in several groups)."""
    key = np.ascontiguousarray(np.sort(nodes, axis=1))
    key = key.view(np.dtype((np.void, key.dtype.itemsize * key.shape[1]))).ravel()
    return np.unique(key, return_inverse=True)[1].ravel()


def _rows(group: Group, start: dict[int, int]) -> np.ndarray:
    parts = [start[block] + rows for block, rows in group.cells.items() if block in start]
    return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)


def _left_out(kind: str, numbers: np.ndarray, same: np.ndarray, body: np.ndarray, file: FileModel, start: dict[int, int]) -> str:
    """Return a note on elements of groups that are not bodies; raise MeshError for elements without a group."""
    left_out = body < 0
    holders, is_named = [], np.zeros(len(body), dtype=bool)
    for name, group in file.groups.items():
        members = same[_rows(group, start)]
        is_named[members] = True
        if left_out[members].any():
            holders.append(name)
    lost = np.flatnonzero(left_out & ~is_named)
    if len(lost):
        raise MeshError(
            f"{len(lost)} {kind} elements, the first of them element {numbers[same == lost[0]][0]}, are in no named "
            "group; name a group and a body for them, or delete them from the mesh"
        )
    return f"{np.count_nonzero(left_out)} {kind} elements of {', '.join(map(repr, holders))} belong to no body and are left out"


def _faces(name: str, group: Group, file: FileModel, used: np.ndarray, new: np.ndarray) -> list[FaceBlock]:
    """Return the named faces of a group on elements of bodies."""
    blocks = []
    for block, rows in group.cells.items():
        cells = file.cells[block]
        if KINDS.get(cells.kind, (0, 0))[0] == 2 and len(rows):
            nodes = cells.nodes[rows]
            nodes = nodes[used[nodes].all(axis=1)]
            if len(nodes):
                blocks.append(FaceBlock(cells.kind, name, new[nodes]))
    return blocks


def _group_nodes(group: Group, file: FileModel, used: np.ndarray) -> np.ndarray:
    nodes = _all_nodes(group, file)
    return nodes[used[nodes]]


def _all_nodes(group: Group, file: FileModel) -> np.ndarray:
    named = np.zeros(len(file.points), dtype=bool)
    named[group.nodes] = True
    for block, rows in group.cells.items():
        named[file.cells[block].nodes[rows]] = True
    return np.flatnonzero(named)


def _check_groups_on_bodies(mesh: Mesh, tables: StructureTables) -> None:
    """Raise MeshError for a support, surface or load group without a node on a body."""
    faults = Faults()
    on_bodies = {surface.name for surface in tables.surfaces}  # groups of faces on bodies
    for key, group in tables.groups_on_bodies:
        if group not in on_bodies and len(mesh.node_groups[group]) == 0 and group not in mesh.outside.groups:
            faults.add([MeshError(f"{key} = {group!r}: no node of this group belongs to an element of a body")])
    faults.refuse()


_LARGEST = 2.0**53  # largest integer that a float represents exactly


def read_nodes(path: Path) -> Mesh:
    """Return the nodes of a file: a table node,x,y,z in metres without elements, or a mesh with all solids and groups.

    Local.

    Raises
    ------
    CaseError, MeshError : the file is faulty
    """
    if path.suffix.lower() != ".csv":
        return read_whole(path)
    columns, lines = read_table(path, ("node", "x", "y", "z"), what="node")
    if (columns["node"] % 1.0).any() or columns["node"].min() < 1 or columns["node"].max() > _LARGEST:
        raise CaseError(f"{path}: node numbers must be whole and above 0")
    numbers = columns["node"].astype(np.int64)
    order = np.argsort(numbers, kind="stable")
    twice = np.flatnonzero(np.diff(numbers[order]) == 0)
    if len(twice):
        raise CaseError(f"{path}, line {lines[order[twice[0] + 1]]}: node {numbers[order][twice[0]]} appears twice")
    return Mesh(str(path), np.column_stack([columns[axis] for axis in "xyz"]), numbers, (), (), {})


def nodes_alone(path: Path, numbers: np.ndarray) -> Mesh:
    """Return nodes (n,) with unknown positions.  Local."""
    return Mesh(str(path), np.full((len(numbers), 3), np.nan), np.asarray(numbers), (), (), {})
