"""Read the flat input files of Abaqus and CalculiX: nodes, solids, sets and surfaces, with the user's numbers."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field

import numpy as np

from ..parallel.errors import MeshError
from .model import KINDS, Cells, FileModel, Group, index_of

# Faces S1, S2, ... of the solid elements by their corners (Abaqus and CalculiX agree).
_FACES = {
    "tet": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "hex": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
}
_EDGES = {
    "tet": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hex": ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
    "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
}
_SOLIDS = {4: "tet4", 10: "tet10", 8: "hex8", 20: "hex20", 6: "wedge6", 15: "wedge15", 5: "pyramid5", 27: "hex27"}
_SHELLS = {3: "tri3", 6: "tri6", 4: "quad4", 8: "quad8", 65: "tri6", 9: "quad9"}
_LINES = {"T2D2": "line2", "T2D3": "line3", "T3D2": "line2", "T3D3": "line3", "B31": "line2", "B32": "line3"}
_LONGEST = 10**8  # numbers in a generated set
# Keywords that would change the mesh in ways that are not followed here.
_REFUSED = {
    "INCLUDE": "write one file with everything in it",
    "NGEN": "write the nodes out",
    "NFILL": "write the nodes out",
    "NCOPY": "write the nodes out",
    "ELGEN": "write the elements out",
    "ELCOPY": "write the elements out",
    "SYSTEM": "write the nodes in global axes",
}


@dataclass
class _Content:
    """What has been gathered so far; sets hold numbers of the file."""

    nodes: list[np.ndarray] = field(default_factory=list)  # (n, 4) number and point
    elements: dict[str, list[np.ndarray]] = field(default_factory=dict)  # kind: (n, 1 + n_nodes)
    sets: dict[str, dict[str, np.ndarray]] = field(default_factory=lambda: {"NSET": {}, "ELSET": {}})
    from_elements: list[tuple[str, str]] = field(default_factory=list)  # node set, element set it is made of
    surfaces: dict[str, list[tuple[np.ndarray, int]]] = field(default_factory=dict)  # elements, face number
    skipped: dict[str, int] = field(default_factory=dict)  # element type: how many
    names: dict[str, str] = field(default_factory=dict)  # upper case: as first written

    def add(self, kind_of_set: str, name: str, numbers: np.ndarray) -> None:
        key = self.names.setdefault(name.upper(), name)
        known = self.sets[kind_of_set].get(key, np.empty(0, dtype=np.int64))
        self.sets[kind_of_set][key] = np.union1d(known, numbers)


def read_inp(path: str) -> FileModel:
    """Read an Abaqus or CalculiX input file without parts, or with one part.  Local.

    Raises
    ------
    MeshError without the file's name: damaged, or it uses keywords that are not followed.
    """
    with open(path, encoding="utf-8", errors="replace") as file:
        content = _Content()
        n_parts = 0
        for keyword, parameters, lines in _blocks(file):
            n_parts += keyword == "PART"
            if keyword in _REFUSED or n_parts > 1:
                advice = _REFUSED.get(keyword, "write a flat input file, without parts and assembly")
                raise MeshError(f"the keyword *{keyword} is not followed here; {advice}")
            if keyword == "NODE":
                _take_nodes(content, parameters, lines)
            elif keyword == "ELEMENT":
                _take_elements(content, parameters, lines)
            elif keyword in ("NSET", "ELSET"):
                _take_set(content, keyword, parameters, lines)
            elif keyword == "SURFACE":
                _take_surface(content, parameters, lines)
    if not content.nodes or not content.elements:
        raise MeshError("the file holds no *NODE and *ELEMENT blocks that this program reads")
    return _compose(content)


def _blocks(file):
    """Yield (keyword, parameters, data lines) of every block."""
    keyword, parameters, lines = "", {}, []
    for line in file:
        line = line.strip()
        if line.startswith("**") or not line:
            continue
        if not line.startswith("*"):
            lines.append(line)
            continue
        if keyword:
            yield keyword, parameters, lines
        words = [word.strip() for word in line[1:].split(",")]
        pairs = (word.partition("=") for word in words[1:] if word)
        keyword, lines = words[0].upper(), []
        parameters = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
    if keyword:
        yield keyword, parameters, lines


def _numbers(lines: list[str], keyword: str) -> np.ndarray:
    """Return all numbers of some data lines; an empty field counts as none."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(" ".join(lines).replace(",", " "), sep=" ")
        except (ValueError, DeprecationWarning):
            line = next((line for line in lines if not _is_numeric(line)), lines[0])
            raise MeshError(f"*{keyword} holds {line[:60]!r} where numbers are due") from None


def _is_numeric(line: str) -> bool:
    try:
        [float(word) for word in line.split(",") if word.strip()]
    except ValueError:
        return False
    return True


def _take_nodes(content: _Content, parameters: dict, lines: list[str]) -> None:
    if parameters.get("SYSTEM", "R").upper() != "R":
        raise MeshError("*NODE in cylindrical or spherical axes is not followed here; write the nodes in global axes")
    n_fields = len([word for word in lines[0].split(",") if word.strip()]) if lines else 4
    values = _numbers(lines, "NODE")
    if n_fields < 4 or len(values) != n_fields * len(lines):
        raise MeshError("*NODE: every line must hold a number and three coordinates; the file is damaged or truncated")
    table = values.reshape(len(lines), n_fields)[:, :4]
    if not np.isfinite(table[:, 0]).all():
        raise MeshError("*NODE: a node number is not a number; the file is damaged")
    content.nodes.append(table)
    if "NSET" in parameters:
        content.add("NSET", parameters["NSET"], content.nodes[-1][:, 0].astype(np.int64))


def _take_elements(content: _Content, parameters: dict, lines: list[str]) -> None:
    word = parameters.get("TYPE", "").upper()
    kind = _kind(word)
    if kind is None:
        content.skipped[word] = content.skipped.get(word, 0) + len(lines)
        return
    width = 1 + KINDS[kind][1]
    values = _numbers(lines, "ELEMENT")
    if len(values) % width or not np.isfinite(values).all():
        raise MeshError(
            f"*ELEMENT, TYPE={word}: {len(values)} numbers do not make elements of a number and {width - 1} nodes; "
            "the file is damaged or truncated"
        )
    rows = values.astype(np.int64).reshape(-1, width)
    content.elements.setdefault(kind, []).append(rows)
    if "ELSET" in parameters:
        content.add("ELSET", parameters["ELSET"], rows[:, 0])


def _kind(word: str) -> str | None:
    """Return the kind of an Abaqus element type; None for what has no place in a solid mesh (springs, beams, ...)."""
    solid = re.match(r"C3D(\d+)", word)
    shell = re.match(r"(?:CPS|CPE|CAX|M3D|SFM3D|R3D|STRI|S|DS)(\d+)", word)
    if solid:
        if int(solid[1]) not in _SOLIDS:
            raise MeshError(f"*ELEMENT, TYPE={word} is not read; known solids: C3D4, C3D6, C3D8, C3D10, C3D15, C3D20")
        return _SOLIDS[int(solid[1])]
    if shell:
        return _SHELLS.get(int(shell[1]))
    return _LINES.get(word.rstrip("RHI"))


def _take_set(content: _Content, keyword: str, parameters: dict, lines: list[str]) -> None:
    name = parameters.get(keyword)
    if not name:
        raise MeshError(f"*{keyword} without a name")
    if keyword == "NSET" and "ELSET" in parameters:
        content.add("NSET", name, np.empty(0, dtype=np.int64))
        content.from_elements.append((content.names[name.upper()], parameters["ELSET"].upper()))
        return
    if "GENERATE" in parameters:
        for line in lines:
            first, last, *step = _numbers([line], keyword).astype(np.int64)
            if not 0 <= first <= last <= first + _LONGEST:
                raise MeshError(f"*{keyword}, GENERATE: {line!r} is not a range of numbers; the file is damaged")
            content.add(keyword, name, np.arange(first, last + 1, step[0] if step else 1))
        return
    words = [word.strip().strip('"') for line in lines for word in line.split(",") if word.strip()]
    content.add(keyword, name, np.array([int(word) for word in words if word.isdigit()], dtype=np.int64))
    for word in words:
        if not word.isdigit():
            content.add(keyword, name, _members(content, keyword, word))


def _members(content: _Content, keyword: str, name: str) -> np.ndarray:
    """Return the numbers of a set defined before."""
    known = content.sets[keyword].get(content.names.get(name.upper(), name))
    if known is None:
        raise MeshError(f"*{keyword} {name!r} is used but not defined before")
    return known


def _take_surface(content: _Content, parameters: dict, lines: list[str]) -> None:
    name = parameters.get("NAME", "")
    if parameters.get("TYPE", "ELEMENT").upper() == "NODE":
        _take_set(content, "NSET", {"NSET": name}, [line.split(",")[0] for line in lines])
        return
    for line in lines:
        what, _, face = (word.strip() for word in line.partition(","))
        if not re.fullmatch(r"[sS]\d", face):
            continue  # shell sides, trimming: no face of a solid
        elements = np.array([int(what)]) if what.isdigit() else _members(content, "ELSET", what.strip('"'))
        key = content.names.setdefault(name.upper(), name)
        content.surfaces.setdefault(key, []).append((elements, int(face[1])))


def _compose(content: _Content) -> FileModel:
    """Turn numbers of the file into positions, and surfaces into cells."""
    table = np.concatenate(content.nodes)
    numbers, points = table[:, 0].astype(np.int64), table[:, 1:]
    if len(np.unique(numbers)) != len(numbers):
        twice = np.sort(numbers)[:-1][np.diff(np.sort(numbers)) == 0][0]
        raise MeshError(f"*NODE gives node number {twice} more than once")
    cells = []
    for kind, parts in content.elements.items():
        rows = np.concatenate(parts)
        index, missing = index_of(numbers, rows[:, 1:])
        if len(missing):
            raise MeshError(f"*ELEMENT names node {missing[0]}, which no *NODE block holds")
        cells.append(Cells(kind, index, rows[:, 0]))
    groups: dict[str, Group] = {}
    for name, members in content.sets["ELSET"].items():
        for block, own in enumerate(cells):
            groups.setdefault(name, Group()).add_cells(block, np.flatnonzero(np.isin(own.numbers, members)))
    for name, members in content.sets["NSET"].items():
        index, missing = index_of(numbers, members)
        if len(missing):
            raise MeshError(f"*NSET {name!r} names node {missing[0]}, which no *NODE block holds")
        groups.setdefault(name, Group()).add_nodes(index)
    for name, elset in content.from_elements:
        source = groups.get(content.names.get(elset, elset), Group())
        for block, members in source.cells.items():
            groups[name].add_nodes(np.unique(cells[block].nodes[members]))
    for name, faces in content.surfaces.items():
        _add_surface(cells, groups.setdefault(name, Group()), faces)
    notes = tuple(f"{n} lines of *ELEMENT, TYPE={word} are not read" for word, n in content.skipped.items())
    return FileModel(points, numbers, tuple(cells), groups, notes)


def _add_surface(cells: list[Cells], group: Group, parts: list[tuple[np.ndarray, int]]) -> None:
    """Add the faces of a surface as cells of their own."""
    for block in range(len(cells)):
        family = cells[block].kind.rstrip("0123456789")
        for elements, face in parts:
            rows = np.flatnonzero(np.isin(cells[block].numbers, elements))
            if family not in _FACES or len(rows) == 0:
                continue
            if not 1 <= face <= len(_FACES[family]):
                raise MeshError(f"*SURFACE names face S{face} of element {cells[block].numbers[rows[0]]}, a {family}")
            local = _face_nodes(cells[block].kind, family, face)
            kind = {3: "tri3", 4: "quad4", 6: "tri6", 8: "quad8"}[len(local)]
            cells.append(Cells(kind, cells[block].nodes[rows][:, local], cells[block].numbers[rows]))
            group.add_cells(len(cells) - 1, np.arange(len(rows)))


def _face_nodes(kind: str, family: str, face: int) -> list[int]:
    """Return the local nodes of face S1, S2, ...: corners, then mid-sides."""
    corners = list(_FACES[family][face - 1])
    n_corners = {"tet": 4, "hex": 8, "wedge": 6}[family]
    if KINDS[kind][1] == n_corners:
        return corners
    edges = [set(edge) for edge in _EDGES[family]]
    around = zip(corners, corners[1:] + corners[:1], strict=True)
    return corners + [n_corners + edges.index({first, second}) for first, second in around]
