"""Read I-deas universal files: nodes (data sets 2411, 781, 15), elements (2412, 780), groups (2467, 2477, 2452, 2435, ...).

pyuff 2.5 reads nodes, but neither the groups that programs write today (2477) nor elements of more than eight nodes.
"""

from collections.abc import Iterator

import numpy as np

from ..messages.errors import MeshError
from .draft import cells_of
from .model import KINDS, Cells, FileModel, Finding, Group, index_of

_KINDS = {
    111: "tet4",
    118: "tet10",
    112: "wedge6",
    113: "wedge15",
    115: "hex8",
    116: "hex20",
    101: "pyramid5",
    91: "tri3",
    41: "tri3",
    92: "tri6",
    42: "tri6",
    94: "quad4",
    44: "quad4",
    95: "quad8",
    45: "quad8",
}
_BEAMS = (11, 21, 22, 23, 24, 31, 32)  # their records have one more line
# I-deas numbers corners and mid-side nodes of a face alternately; here the corners come first
_ORDER = {
    "tri6": [0, 2, 4, 1, 3, 5],
    "quad8": [0, 2, 4, 6, 1, 3, 5, 7],
    "tet10": [0, 2, 4, 9, 1, 3, 5, 6, 7, 8],
    "wedge15": [0, 2, 4, 9, 11, 13, 1, 3, 5, 10, 12, 14, 6, 7, 8],
    "hex20": [0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11],
}
_GROUPS = (2429, 2430, 2432, 2435, 2452, 2467, 2477)
_NODES, _ELEMENTS = 7, 8  # codes of the entries of a group
_HARMLESS = (151, 164, 2400, 55, 58, 2414, 18, 2448)
_EFFECTS = {773: "materials", 1710: "materials", 789: "properties", 2437: "properties", 755: "supports", 791: "supports"}


def read_unv(path: str) -> FileModel:
    """Read a universal file.  Local.

    Groups have their names; elements outside all groups form groups by their physical property, "property 1".

    Raises
    ------
    MeshError without the file's name: truncated, damaged, or no nodes and elements
    """
    points: dict[int, tuple[float, ...]] = {}
    rows: dict[str, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}  # by kind: numbers, properties, nodes of elements
    named: list[tuple[str, list[int], list[int]]] = []
    findings: list[Finding] = []
    for number, line, lines in _data_sets(path):
        if number in (2411, 781):
            _take_nodes(points, lines, line)
        elif number == 15:
            _take_old_nodes(points, lines, line)
        elif number in (2412, 780):
            _take_elements(rows, findings, lines, line)
        elif number == 2420:
            findings += _systems(lines, line)
        elif number in _GROUPS:
            named += _groups(lines, line)
        elif number not in _HARMLESS:
            effect = f"{_EFFECTS.get(number, 'data that this program does not know')}; state them in the scene"
            findings.append(
                Finding(word=f"data set {number}", where=f"line {line}", effect=effect, changes=number not in _EFFECTS)
            )
    if not points or not rows:
        raise MeshError("the file holds no nodes (2411) and elements (2412) that this program reads")
    return _composed(points, rows, named, findings)


def _data_sets(path: str) -> Iterator[tuple[int, int, list[str]]]:
    """Yield number, first line and lines of every data set."""
    with open(path, encoding="utf-8", errors="replace") as file:
        lines = [line.rstrip("\r\n") for line in file]
    marks = [i for i, line in enumerate(lines) if line.strip() == "-1"]
    if len(marks) % 2:
        raise MeshError("a data set does not end; the file is truncated")
    for first, last in zip(marks[::2], marks[1::2], strict=True):
        if last - first < 2:
            continue
        word = lines[first + 1].split()
        if not word or not word[0].rstrip("b").isdigit():
            raise MeshError(f"line {first + 2}: {lines[first + 1][:40]!r} where the number of a data set is expected")
        yield int(word[0].rstrip("b")), first + 2, lines[first + 2 : last]


def _values(line: str, where: int, kind=int) -> list:
    try:
        return list(map(kind, line.replace("D", "E").replace("d", "e").split()))
    except ValueError:
        raise MeshError(f"line {where}: {line[:60]!r} where numbers are expected") from None


def _table(lines: list[str], width: int, kind: type = int) -> np.ndarray | None:
    """Return the numbers of lines with equal fields of the format's width, (n, n_fields); None for other lines."""
    n_characters = len(lines[0]) if lines else 0
    if n_characters == 0 or n_characters % width or any(len(text) != n_characters for text in lines):
        return None
    try:
        fields = np.frombuffer("".join(lines).replace("D", "E").encode("ascii"), dtype=f"S{width}")
        return fields.astype(kind).reshape(len(lines), -1)
    except ValueError:
        return None


def _systems(lines: list[str], line: int) -> list[Finding]:
    """Report coordinate systems that are not Cartesian, in which nodes would be misplaced."""
    types = [_values(text, line + i + 3)[1:2] for i, text in enumerate(lines[2:]) if i % 6 == 0]
    if not any(kind != [0] for kind in types):
        return []
    effect = "cylindrical or spherical coordinate systems; write the nodes in the global one"
    return [Finding(word="data set 2420", where=f"line {line}", effect=effect, changes=True)]


def _take_nodes(points: dict, lines: list[str], line: int) -> None:
    heads, places = _table(lines[:-1:2], 10), _table(lines[1::2], 25, float)
    if heads is not None and places is not None and places.shape[1] == 3:
        read = dict(zip(heads[:, 0].tolist(), map(tuple, places.tolist()), strict=True))
        if len(read) == len(heads) and not read.keys() & points.keys():
            points.update(read)
            return
    for i in range(0, len(lines) - 1, 2):
        head, at = _values(lines[i], line + i + 1), _values(lines[i + 1], line + i + 2, float)
        _add_point(points, head[:1], at, line + i + 1)


def _take_old_nodes(points: dict, lines: list[str], line: int) -> None:
    for i, text in enumerate(lines):
        words = text.split()
        _add_point(
            points, _values(" ".join(words[:1]), line + i + 1), _values(" ".join(words[4:]), line + i + 1, float), line + i + 1
        )


def _add_point(points: dict, head: list[int], at: list[float], where: int) -> None:
    if len(head) < 1 or len(at) != 3:
        raise MeshError(f"line {where}: a node needs a number and three coordinates; the file is damaged or truncated")
    if head[0] in points:
        raise MeshError(f"line {where}: node number {head[0]} is given more than once")
    points[head[0]] = tuple(at)


def _take_elements(rows: dict, findings: list[Finding], lines: list[str], line: int) -> None:
    """Take elements by kind: number, physical property, nodes."""
    i, other_types, n_ahead = 0, dict[int, int](), 1
    while i < len(lines):
        start = i
        head = _values(lines[i], line + i + 1)
        if len(head) < 6:
            raise MeshError(f"line {line + i + 1}: an element needs six numbers; the file is damaged or truncated")
        number, descriptor, prop, n_nodes = head[0], head[1], head[2], head[5]
        first = i + (2 if descriptor in _BEAMS else 1)
        i, nodes = first, list[int]()
        while len(nodes) < n_nodes and i < len(lines):
            nodes += _values(lines[i], line + i + 1)
            i += 1
        if len(nodes) != n_nodes:
            raise MeshError(f"line {line + first + 1}: element {number} needs {n_nodes} nodes; the file is damaged or truncated")
        kind = _KINDS.get(descriptor)
        if kind is None:
            other_types[descriptor] = other_types.get(descriptor, 0) + 1
        elif n_nodes != KINDS[kind][1]:
            raise MeshError(f"line {line + first}: element {number} of kind {kind} has {n_nodes} nodes")
        else:
            of_kind = rows.setdefault(kind, [])
            of_kind.append((np.array([number]), np.array([prop]), np.array([nodes])))
            alike = _alike(lines, start, i - start, descriptor, n_ahead)
            if alike is not None:
                of_kind.append(alike)
                i += len(alike[0]) * (i - start)
            n_ahead = 2 * n_ahead if alike is not None and len(alike[0]) == n_ahead else 1
    for descriptor, n in other_types.items():
        effect = "elements that are neither solids nor faces here"
        word = f"element descriptor {descriptor}"
        findings.append(Finding(word=word, where=f"{n} elements", effect=effect, changes=descriptor not in (136, 137, 138, 139)))


def _alike(
    lines: list[str], start: int, n_lines: int, descriptor: int, n_most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return numbers, properties and nodes of up to ``n_most`` elements in the form of the element at ``start``, or None.

    Parameters
    ----------
    start, n_lines : first line and number of lines of that element
    """
    n = min(n_most, (len(lines) - start) // n_lines - 1)
    tables = [_table(lines[start + k : start + (n + 1) * n_lines : n_lines], 10) for k in range(n_lines)]
    fixed = [table for table in tables if table is not None]
    if len(fixed) < n_lines:
        return None
    heads, nodes = fixed[0], np.hstack(fixed[1:])
    differs = (heads[:, [1, 5]] != [descriptor, nodes.shape[1]]).any(axis=1) if heads.shape[1] > 5 else np.ones(1, dtype=bool)
    alike = slice(1, int(np.argmax(differs)) if differs.any() else n + 1)
    return (heads[alike, 0], heads[alike, 2], nodes[alike]) if len(heads[alike]) else None


def _groups(lines: list[str], line: int) -> Iterator[tuple[str, list[int], list[int]]]:
    """Yield name, node numbers and element numbers of every group."""
    i = 0
    while i + 1 < len(lines):
        head = _values(lines[i], line + i + 1)
        count = head[7] if len(head) > 7 else 0
        name, i = lines[i + 1].strip() or f"group {head[0]}", i + 2
        table = _table(lines[i : i + count // 2], 10)
        entries: list[int] = [] if table is None or table.shape[1] != 8 else table.ravel().tolist()
        i += len(entries) // 8
        while len(entries) < 4 * count and i < len(lines):
            entries += _values(lines[i], line + i + 1)
            i += 1
        if len(entries) < 4 * count:
            raise MeshError(f"line {line + i}: group {name!r} needs {count} entries; the file is truncated")
        pairs = [(entries[k], entries[k + 1]) for k in range(0, 4 * count, 4)]
        yield name, [tag for code, tag in pairs if code == _NODES], [tag for code, tag in pairs if code == _ELEMENTS]


def _composed(points: dict, rows: dict, named: list, findings: list[Finding]) -> FileModel:
    numbers = np.array(list(points), dtype=np.int64)
    cells: list[Cells] = []
    groups: dict[str, Group] = {}
    for kind, blocks in rows.items():
        elements, properties, wanted = (np.concatenate(column) for column in zip(*blocks, strict=True))
        cells.append(cells_of(kind, elements, wanted[:, _ORDER[kind]] if kind in _ORDER else wanted, numbers))
        for value in np.unique(properties):
            groups.setdefault(f"property {value}", Group()).add_cells(len(cells) - 1, np.flatnonzero(properties == value))
    for name, nodes, members in named:
        group = groups.setdefault(name, Group())
        index, missing = index_of(numbers, np.array(nodes, dtype=np.int64))
        if len(missing):
            raise MeshError(f"group {name!r} names node {missing[0]}, which the file does not hold")
        group.add_nodes(index)
        group.add_elements(cells, np.array(members))
    return FileModel(np.array(list(points.values())), numbers, tuple(cells), groups, findings=tuple(findings))
