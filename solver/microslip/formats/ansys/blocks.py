"""The blocks of an Ansys file: nodes, elements, components; a library reads archives, this module input files."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...messages.errors import MeshError

FIELDS = 10  # fields of an element before its nodes: material, type, real constants, ...
_WIDEST = 400  # characters of a line of a block
_FORMAT = re.compile(r"\(\s*(\d*)\s*i\s*(\d+)\s*(?:,\s*(\d*)\s*e\s*(\d+)\.\d+(?:e\d+)?)?\s*\)", re.IGNORECASE)


@dataclass(frozen=True)
class Blocks:
    """Nodes, elements and components, by the numbers of the file."""

    numbers: np.ndarray  # (n_nodes,)
    points: np.ndarray  # (n_nodes, 3) length
    angles: np.ndarray  # (n_nodes, 3) angles of the nodal axes [degrees]
    elements: np.ndarray  # (n_elements,)
    start: np.ndarray  # (n_elements + 1,) begin of each element in ``flat``
    flat: np.ndarray  # for each element FIELDS numbers (material, type, real constants, ...), then its nodes
    node_components: Mapping[str, np.ndarray] = field(default_factory=dict)
    element_components: Mapping[str, np.ndarray] = field(default_factory=dict)
    types: Mapping[int, int] = field(default_factory=dict)  # read by the library
    keys: Mapping[int, Mapping[int, int]] = field(default_factory=dict)
    constants: Mapping[int, list[float]] = field(default_factory=dict)


def blocks_of_library(path: str) -> Blocks:
    """Return the blocks of an archive by mapdl-archive.  Local, in a sandbox, which imports only this module."""
    try:
        import mapdl_archive
    except ImportError:
        raise MeshError("Ansys archives are read by mapdl-archive; install it: pip install mapdl-archive") from None
    return blocks_of_archive(mapdl_archive.Archive(path, parse_vtk=False))


def blocks_of_archive(archive: Any) -> Blocks:
    """Return the blocks of an archive read by mapdl-archive.  Local.  Raises MeshError: it has no node or no element."""
    if archive.nnum is None or not len(archive.nnum) or not archive.n_elem:
        raise MeshError("its NBLOCK or EBLOCK is empty or damaged")
    numbers = np.asarray(archive.nnum, dtype=np.int64)
    angles = np.zeros((len(numbers), 3)) if archive.node_angles is None else np.asarray(archive.node_angles, dtype=float)
    return Blocks(
        numbers,
        np.asarray(archive.nodes, dtype=float)[:, :3],
        angles,
        np.asarray(archive.enum, dtype=np.int64),
        np.asarray(archive._elem_off),
        np.asarray(archive._elem),
        {name: np.asarray(members, dtype=np.int64) for name, members in archive.node_components.items()},
        {name: np.asarray(members, dtype=np.int64) for name, members in archive.element_components.items()},
        {int(number): int(element) for number, element in archive.ekey},
        {int(number): {int(key): int(value) for key, value in keys} for number, keys in archive.key_option.items()},
        {int(n): list(values) for n, values in zip(archive.rlblock_num, archive.rlblock, strict=True)},
    )


def blocks_of_text(lines: list[str]) -> Blocks:
    """Return the blocks of an input file, in any of their formats.  Local.

    Raises
    ------
    MeshError : no node or no element; a block that ends early or holds no numbers
    """
    nodes, rows = [], []
    components: dict[str, dict[str, np.ndarray]] = {"NODE": {}, "ELEM": {}}
    i = 0
    while i < len(lines):
        word, *fields = (part.strip() for part in lines[i].partition("!")[0].split(","))
        word = word.upper()
        if word not in ("NBLOCK", "EBLOCK", "CMBLOCK"):
            i += 1
            continue
        end, block = _block(lines, i, int(fields[2]) if word == "CMBLOCK" else None)
        if word == "NBLOCK":
            nodes.append(_nodes(block))
        elif word == "EBLOCK":
            rows.append(_elements(block, fields[1].upper() == "SOLID" if len(fields) > 1 else False))
            _check_count(fields, len(rows[-1][0]), i + 1)
        else:
            components.setdefault(fields[1].upper(), {})[fields[0]] = _component(block)
        i = end
    if not nodes or not rows:
        raise MeshError("its NBLOCK or EBLOCK is empty or damaged")
    numbers, points, angles = (np.concatenate(column) for column in zip(*nodes, strict=True))
    elements, counts, flat = (np.concatenate(column) for column in zip(*rows, strict=True))
    start = np.concatenate([[0], np.cumsum(counts)])
    return Blocks(numbers, points, angles, elements, start, flat, components["NODE"], components["ELEM"])


def _check_count(fields: list[str], n_read: int, line: int) -> None:
    """Raise MeshError unless the number of elements in a block matches its count, if stated."""
    count = fields[-1] if len(fields) > 3 else ""
    if count.isdigit() and int(count) != n_read:
        raise MeshError(f"line {line}: EBLOCK counts {count} elements and holds {n_read}; the file is truncated or damaged")


@dataclass(frozen=True)
class _Block:
    """Lines of numbers and their format."""

    line: int  # number of the first line, from 1
    lines: list[str]
    n_whole: int  # whole numbers per line, and the width of each
    whole: int
    n_decimal: int
    decimal: int

    def wholes(self) -> np.ndarray:
        """Return the whole numbers of each line, (n_lines, n_whole), padded with -1."""
        return self._numbers(0, self.n_whole, self.whole, np.int64, b"-1")

    def decimals(self) -> np.ndarray:
        """Return the decimals of each line, (n_lines, n_decimal), padded with 0."""
        return self._numbers(self.n_whole * self.whole, self.n_decimal, self.decimal, float, b"0")

    def _numbers(self, first: int, n: int, width: int, kind: type, empty: bytes) -> np.ndarray:
        text = np.array([line[first : first + n * width] for line in self.lines], dtype=f"S{n * width}")
        parts = np.char.strip(text.view(f"S{width}").reshape(len(self.lines), n))
        parts[parts == b""] = empty
        try:
            return parts.astype(kind)
        except ValueError as problem:
            raise MeshError(f"line {self.line} and on: {problem}, where numbers in a given width are expected") from None


def _block(lines: list[str], at: int, count: int | None) -> tuple[int, _Block]:
    """Return the block that begins at a line, and the line after it; ``count`` numbers, or up to -1."""
    form = _FORMAT.match(lines[at + 1].strip()) if at + 1 < len(lines) else None
    if form is None:
        raise MeshError(f"line {at + 2}: a format like (1i9,3e20.9e3) is expected after {lines[at].split(',')[0].upper()}")
    n_whole, whole, n_decimal, decimal = (int(word or 1) if word is not None else 0 for word in form.groups())
    if not 0 < n_whole * whole <= _WIDEST or n_decimal * decimal > _WIDEST:
        raise MeshError(f"line {at + 2}: the format {lines[at + 1].strip()[:40]} is not a format of a block")
    first, end = at + 2, at + 2
    while end < len(lines) and lines[end].strip() != "-1" and not lines[end].lstrip()[:1].isalpha() and lines[end].strip():
        end += 1
    if count is not None:
        end = first + -(-count // n_whole)
    elif end == len(lines) or lines[end].strip()[:1] not in ("-", "N"):
        raise MeshError(f"line {end + 1}: the block of line {at + 1} ends without -1; the file is truncated or damaged")
    if count is not None and count < 0:
        raise MeshError(f"line {at + 1}: {count} numbers are counted; a number of at least 0 is expected")
    if end > len(lines):
        raise MeshError(f"line {at + 1}: {count} numbers are counted, and the file ends before; it is truncated")
    return end, _Block(first + 1, lines[first:end], n_whole, whole, n_decimal, decimal)


def _nodes(block: _Block) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return numbers, coordinates and angles of a block of nodes."""
    if block.n_decimal < 3:
        raise MeshError(f"line {block.line - 1}: a format of nodes with three coordinates is expected")
    values = np.zeros((len(block.lines), 6))
    values[:, : min(block.n_decimal, 6)] = block.decimals()[:, :6]
    return block.wholes()[:, 0], values[:, :3], values[:, 3:]


def _elements(block: _Block, is_solid: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return element numbers, the length of each element in ``Blocks.flat``, and its numbers there."""
    wholes = block.wholes()
    numbers, counts, flat = [], [], []
    rows, i = wholes.tolist(), 0
    before = FIELDS + 1 if is_solid else 5
    while i < len(rows):
        row = rows[i]
        i += 1
        if is_solid:
            while len(row) - before < row[8] and i < len(rows):
                row = row + rows[i]
                i += 1
        nodes = row[before : before + row[8]] if is_solid else [node for node in row[before:] if node >= 0]
        if len(row) <= before or (is_solid and (len(nodes) < row[8] or min(nodes, default=0) < 0)):
            raise MeshError(f"line {block.line + i - 1}: an element with fewer nodes than it states")
        attributes = row[:3] if is_solid else [row[3], row[1], row[2]]
        numbers.append(row[10] if is_solid else row[0])
        counts.append(FIELDS + len(nodes))
        flat.extend([*attributes, *[0] * (FIELDS - 3), *nodes])
    return np.array(numbers, dtype=np.int64), np.array(counts, dtype=np.int64), np.array(flat, dtype=np.int64)


def _component(block: _Block) -> np.ndarray:
    """Return the members of a component; a negative number ends a range from the preceding number."""
    members: list[np.ndarray] = []
    for number in np.concatenate(
        [np.array(line.split(), dtype=np.int64) for line in block.lines] or [np.zeros(0, dtype=np.int64)]
    ):
        if number < 0 and members:
            members.append(np.arange(members[-1][-1] + 1, -number + 1))
        else:
            members.append(np.array([number]))
    return np.concatenate(members) if members else np.zeros(0, dtype=np.int64)
