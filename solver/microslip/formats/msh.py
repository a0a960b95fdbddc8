"""Read Gmsh's format, versions 2.2 and 4.1, text and binary, with the user's numbers and all groups.

meshio also reads the format, but drops the numbers of nodes and elements.
"""

import re
from dataclasses import replace

import numpy as np

from ..messages.errors import MeshError
from .draft import cells_of
from .model import KINDS, FileModel, Group, index_of, names_of_tags
from .numbers import numbers_of

# Gmsh's element types 1, 2, ..., with the permutation to VTK's order where the order of mid-side nodes differs.
_NAMES = (
    "line2 tri3 quad4 tet4 hex8 wedge6 pyramid5 line3 tri6 quad9 tet10 hex27 wedge18 pyramid14 "
    "point quad8 hex20 wedge15 pyramid13"
)
_TYPES = dict(enumerate(_NAMES.split(), 1))
_TO_VTK = {
    "tet10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    "hex20": [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15],
    "wedge15": [0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11],
    "pyramid13": [0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12],
}


_COMMENTS = re.compile(rb"(?:\$Comments\b.*?\$EndComments\s*)*", re.DOTALL)
_LONGEST_HEADER = 1 << 16  # bytes of a view's names, times and counts


def read_msh(path: str) -> FileModel:
    """Read a Gmsh file.  Local.

    Raises
    ------
    MeshError without the file's name: the file is truncated, damaged or of another version.
    """
    with open(path, "rb") as file:
        content = file.read()
    version, order = _format(content)
    names = _physical_names(content)
    if version == "2.2":
        numbers, points = _nodes_2(_section(content, "Nodes"), order)
        blocks = _elements_2(_section(content, "Elements"), order)
    else:
        physical = {}
        if b"$Entities" in content:
            physical = _entities_4(_Cursor(_section(content, "Entities"), "Entities", order))
        numbers, points = _nodes_4(_Cursor(_section(content, "Nodes"), "Nodes", order))
        blocks = _elements_4(_Cursor(_section(content, "Elements"), "Elements", order), physical)
    model = _compose(points, numbers, blocks, names)
    return replace(model, fields=_fields(content, model.numbers, order))


def _fields(content: bytes, numbers: np.ndarray, order: str) -> dict[str, np.ndarray]:
    """Return the scalar views on nodes, $NodeData, (n_points,) each; a later view replaces one of the same name."""
    fields, at = {}, content.find(b"$NodeData")
    while at >= 0:
        name, n, header = _field_header(content[content.find(b"\n", at) + 1 : at + _LONGEST_HEADER])
        if name is not None:
            if order:  # in binary data a number may contain the bytes of $EndNodeData
                start = content.find(b"\n", at) + 1 + header
                kind = np.dtype([("node", order + "i4"), ("value", order + "f8")])
                rows = np.frombuffer(content[start : start + n * kind.itemsize], dtype=kind)
                nodes, values = rows["node"].astype(np.int64), rows["value"].astype(float)
            else:
                section = _section(content, "NodeData", at)
                table = _numbers(section[header:], "NodeData")
                at += len(section)
                nodes, values = table[: 2 * n : 2].astype(np.int64), table[1 : 2 * n : 2]
            if len(values) < n:
                raise MeshError(
                    f"$NodeData {name!r} ends early: it announces {n} nodes and holds {len(values)}; the file is damaged"
                )
            index, unknown = index_of(numbers, nodes)
            if len(unknown):
                raise MeshError(f"$NodeData {name!r} names node {unknown[0]}, which the file does not hold")
            fields[name] = np.full(len(numbers), np.nan)
            fields[name][index] = values
        at = content.find(b"$NodeData", at + 1)
    return fields


def _field_header(section: bytes) -> tuple[str | None, int, int]:
    """Return name, number of nodes and header length of a view; the name of vectors and tensors is None."""
    at = 0

    def line() -> str:
        nonlocal at
        end = section.find(b"\n", at)
        if end < 0:
            raise MeshError("the file is damaged: $NodeData has no header of texts, times and counts")
        text, at = section[at:end].decode(errors="replace").strip(), end + 1
        return text

    lines = [[line() for _ in range(int(line()))] for _ in range(3)]  # strings, real numbers, integers
    whole = [int(word) for word in lines[2]]
    if len(whole) < 3 or whole[2] < 0 or not lines[0]:
        raise MeshError("the file is damaged: $NodeData does not state its number of nodes")
    return lines[0][0].strip('"') if whole[1] == 1 else None, whole[2], at


def _format(content: bytes) -> tuple[str, str]:
    """Return version and byte order of a file; "" for a text file."""
    before = _COMMENTS.match(content)
    start = before.end() if before else 0
    if not content.startswith(b"$MeshFormat", start):
        raise MeshError("this is not a Gmsh file: it does not begin with $MeshFormat")
    lines = content[start : start + 200].split(b"\n", 2)
    words = lines[1].split() if len(lines) > 2 else []
    if len(words) < 3:
        raise MeshError("the file is truncated in $MeshFormat")
    version, is_binary, size = words[0].decode(errors="replace"), words[1] == b"1", words[2]
    if version not in ("2.2", "4.1"):
        raise MeshError(
            f"Gmsh format {version} is not read, only 2.2 and 4.1; convert it: gmsh FILE.msh -save -format msh41 -o NEW.msh"
        )
    if is_binary and size != b"8":
        raise MeshError(f"a binary Gmsh file with {size.decode(errors='replace')}-byte numbers is not read, only 8")
    if b"\n$PartitionedEntities" in content:
        raise MeshError("the mesh is partitioned already; save it whole (this program partitions it by itself)")
    return version, "" if not is_binary else "<" if lines[2][:4] == b"\1\0\0\0" else ">"


def _section(content: bytes, name: str, first: int = 0) -> bytes:
    """Return the bytes between $Name and $EndName, searched from ``first`` on."""
    start = content.find(b"$" + name.encode(), first)
    if start < 0:
        raise MeshError(f"the file has no ${name} section; it is truncated, or not a mesh")
    start = content.find(b"\n", start) + 1
    end = content.find(b"$End" + name.encode(), start)
    if start == 0 or end < 0:
        raise MeshError(f"the file is truncated: ${name} is not closed by $End{name}")
    return content[start:end]


def _physical_names(content: bytes) -> dict[tuple[int, int], str]:
    """Return the names of the physical groups by dimension and tag."""
    names = {}
    if b"$PhysicalNames" in content:
        for line in _section(content, "PhysicalNames").decode(errors="replace").splitlines()[1:]:
            words = line.split(maxsplit=2)
            if len(words) == 3:
                names[int(words[0]), int(words[1])] = words[2].strip().strip('"')
    return names


class _Cursor:
    """Sequential reader of the numbers of a section: one number type in text (byte order ""), three in binary files."""

    def __init__(self, section: bytes, name: str, order: str):
        self.name, self.order, self.at = name, order, 0
        self.content = np.frombuffer(section, dtype=np.uint8) if order else _numbers(section, name)

    def doubles(self, n: int) -> np.ndarray:
        return self._take(n, "f8").astype(float)

    def ints(self, n: int) -> np.ndarray:
        return self._whole(n, "i4")

    def sizes(self, n: int) -> np.ndarray:
        return self._whole(n, "i8")

    def _whole(self, n: int, code: str) -> np.ndarray:
        taken = self._take(n, code)
        if not np.isfinite(taken).all():
            raise MeshError(f"${self.name} holds a number that is not finite where a count or a tag is expected")
        return taken.astype(np.int64)

    def _take(self, n: int, code: str) -> np.ndarray:
        length = int(n) * (np.dtype(code).itemsize if self.order else 1)
        taken = self.content[self.at : self.at + length]
        if n < 0 or len(taken) < length:
            raise MeshError(f"${self.name} ends early: it announces more than it holds; the file is damaged")
        self.at += length
        return taken.view(self.order + code) if self.order else taken

    def finish(self) -> None:
        """Raise MeshError where numbers are left."""
        left = self.content[self.at :]
        if len(left.tobytes().strip() if self.order else left):
            raise MeshError(f"${self.name} holds more than it announces; the file is damaged")


def _numbers(section: bytes, name: str) -> np.ndarray:
    """Return all numbers of a text section."""
    values = numbers_of(section)
    if values is None:
        word = next((word for word in section.split() if numbers_of(word) is None), b"")
        raise MeshError(f"${name} holds {word.decode(errors='replace')[:40]!r} where a number is expected")
    return values


def _entities_4(cursor: _Cursor) -> dict[tuple[int, int], np.ndarray]:
    """Return the physical tags of every entity, by dimension and tag."""
    physical = {}
    for dimension, n_entities in enumerate(cursor.sizes(4)):
        for _ in range(n_entities):
            tag = int(cursor.ints(1)[0])
            cursor.doubles(3 if dimension == 0 else 6)  # bounding box
            physical[dimension, tag] = np.abs(cursor.ints(cursor.sizes(1)[0]))
            if dimension > 0:
                cursor.ints(cursor.sizes(1)[0])  # bounding entities
    return physical


def _nodes_4(cursor: _Cursor) -> tuple[np.ndarray, np.ndarray]:
    """Return node numbers and coordinates."""
    n_blocks, n_nodes = cursor.sizes(4)[:2]
    numbers, points = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    for _ in range(n_blocks):
        dimension, _, is_parametric = cursor.ints(3)
        n = int(cursor.sizes(1)[0])
        numbers.append(cursor.sizes(n))
        width = 3 + (int(dimension) if is_parametric else 0)
        points.append(cursor.doubles(n * width).reshape(n, width)[:, :3])
    cursor.finish()
    if sum(map(len, numbers)) != n_nodes:
        raise MeshError(f"$Nodes announces {n_nodes} nodes and holds {sum(map(len, numbers))}; the file is damaged")
    return np.concatenate(numbers), np.concatenate(points)


def _elements_4(cursor: _Cursor, physical: dict[tuple[int, int], np.ndarray]) -> list[tuple]:
    """Return (kind, element numbers, node numbers, physical tags) of every entity's elements."""
    n_blocks, n_elements = cursor.sizes(4)[:2]
    blocks = []
    for _ in range(n_blocks):
        dimension, entity, gmsh_type = (int(value) for value in cursor.ints(3))
        n = int(cursor.sizes(1)[0])
        kind, n_nodes = _kind(gmsh_type)
        rows = cursor.sizes(n * (1 + n_nodes)).reshape(n, 1 + n_nodes)
        blocks.append((kind, rows[:, 0], rows[:, 1:], physical.get((dimension, entity), ())))
    cursor.finish()
    n_read = sum(len(numbers) for _, numbers, _, _ in blocks)
    if n_read != n_elements:
        raise MeshError(f"$Elements announces {n_elements} elements and holds {n_read}; the file is damaged")
    return blocks


def _nodes_2(section: bytes, order: str) -> tuple[np.ndarray, np.ndarray]:
    """Return node numbers and coordinates."""
    count, _, rest = section.partition(b"\n")
    n = _count(count, "Nodes")
    if order:
        record = np.dtype([("number", order + "i4"), ("point", order + "f8", 3)])
        if len(rest) < n * record.itemsize:
            raise MeshError(f"$Nodes announces {n} nodes and holds fewer; the file is damaged")
        records = np.frombuffer(rest[: n * record.itemsize], dtype=record)
        return records["number"].astype(np.int64), records["point"].astype(float)
    values = _numbers(rest, "Nodes")
    if len(values) != 4 * n:
        raise MeshError(f"$Nodes announces {n} nodes of 4 numbers and holds {len(values)} numbers; the file is damaged")
    if not np.isfinite(values[0::4]).all():
        raise MeshError("$Nodes holds a node number that is not a number; the file is damaged")
    return values[0::4].astype(np.int64), values.reshape(n, 4)[:, 1:]


def _elements_2(section: bytes, order: str) -> list[tuple]:
    """Return (kind, element numbers, node numbers, physical tags) of every run of elements of one type."""
    count, _, rest = section.partition(b"\n")
    n, blocks = _count(count, "Elements"), []
    cursor = _Cursor(rest, "Elements", order)
    while n > 0:
        kind, n_tags, rows = _run_in_binary(cursor) if order else _run_in_text(cursor, n)
        numbers, tags, nodes = rows[:, 0], rows[:, 1 : 1 + n_tags], rows[:, 1 + n_tags :]
        n -= max(len(rows), 1)
        physical = np.abs(tags[:, 0]) if n_tags else np.zeros(len(rows), dtype=np.int64)
        for tag in np.unique(physical):
            is_tagged = physical == tag
            blocks.append((kind, numbers[is_tagged], nodes[is_tagged], (tag,) if tag else ()))
    cursor.finish()
    return blocks


def _run_in_binary(cursor: _Cursor) -> tuple[str, int, np.ndarray]:
    """Return kind, number of tags and rows (number, tags, nodes) of the next block of elements."""
    gmsh_type, n_run, n_tags = (int(value) for value in cursor.ints(3))
    kind, n_nodes = _kind(gmsh_type)
    return kind, n_tags, cursor.ints(n_run * (1 + n_tags + n_nodes)).reshape(n_run, 1 + n_tags + n_nodes)


def _run_in_text(cursor: _Cursor, n_left: int) -> tuple[str, int, np.ndarray]:
    """Return kind, number of tags and rows (number, tags, nodes) of the next elements of one type."""
    start = cursor.at
    _, gmsh_type, n_tags = (int(value) for value in cursor.ints(3))
    kind, n_nodes = _kind(gmsh_type)
    width = 3 + n_tags + n_nodes
    cursor.at = start
    rows, n_try = cursor.ints(width).reshape(1, width), 64
    while len(rows) < n_left:
        n_ready = min(n_try, n_left - len(rows), (len(cursor.content) - cursor.at) // width)
        ahead = cursor.ints(n_ready * width).reshape(n_ready, width)
        alike = (ahead[:, 1] == gmsh_type) & (ahead[:, 2] == n_tags)
        n_alike = n_ready if alike.all() else int(np.argmin(alike))
        rows = np.concatenate([rows, ahead[:n_alike]])
        cursor.at -= (n_ready - n_alike) * width
        if n_alike < n_ready or n_ready == 0:
            break
        n_try *= 4
    return kind, n_tags, np.delete(rows, (1, 2), axis=1)


def _count(word: bytes, name: str) -> int:
    try:
        return int(word)
    except ValueError:
        raise MeshError(f"${name} does not begin with a count; the file is damaged") from None


def _kind(gmsh_type: int) -> tuple[str, int]:
    if gmsh_type not in _TYPES:
        raise MeshError(
            f"$Elements holds Gmsh's element type {gmsh_type}, of order 3 or higher or not a finite element; "
            "mesh with Mesh.ElementOrder 1 or 2"
        )
    kind = _TYPES[int(gmsh_type)]
    return kind, KINDS[kind][1]


def _compose(points: np.ndarray, numbers: np.ndarray, blocks: list[tuple], names: dict) -> FileModel:
    """Join the blocks of elements of one type and group them by their physical tags."""
    if len(np.unique(numbers)) != len(numbers):
        twice = np.sort(numbers)[:-1][np.diff(np.sort(numbers)) == 0][0]
        raise MeshError(f"$Nodes gives node number {twice} more than once")
    cells, groups = [], {}
    for name in names.values():
        groups[name] = Group()
    tagged = {(KINDS[kind][0], int(tag)) for kind, _, _, physical in blocks for tag in physical}
    names = {**names_of_tags(tagged - set(names)), **names}
    for kind in dict.fromkeys(block[0] for block in blocks):
        same = [block for block in blocks if block[0] == kind]
        nodes = np.concatenate([block[2] for block in same])
        elements = np.concatenate([block[1] for block in same])
        cells.append(cells_of(kind, elements, nodes[:, _TO_VTK.get(kind, slice(None))], numbers))
        rows: dict[str, list[np.ndarray]] = {}
        start = 0
        for _, of_block, _, physical in same:
            for tag in physical:
                rows.setdefault(names[KINDS[kind][0], int(tag)], []).append(np.arange(start, start + len(of_block)))
            start += len(of_block)
        for name, parts in rows.items():
            groups.setdefault(name, Group()).add_cells(len(cells) - 1, np.concatenate(parts))
    return FileModel(points, numbers, tuple(cells), groups)
